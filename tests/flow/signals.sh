#!/usr/bin/env bash
# Signals while COLMAP runs: how the program ends, and that COLMAP ends with it. COLMAP is a script here.
# usage: signals.sh CONURB MAKE_PHOTOS
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
mkdir "$work/photos"
"$photos" "$work/photos" 4 none
rm -f "$work/photos/transforms.json"
"$conurb" init "$work/town" --photos "$work/photos" 2>/dev/null
printf '#!/bin/sh\necho $$ >%s/pid\nexec sleep 1000\n' "$work" >"$work/colmap"
chmod +x "$work/colmap"
sed -i "s|^poses:|poses:\n  colmap: $work/colmap|" "$work/town/city.yaml"

# until_true COMMAND...: waits until the command succeeds. Only a failing test reaches the limit.
until_true() {
    local i
    for ((i = 0; i < 600 * slow; i++)); do
        "$@" && return 0
        sleep 0.1
    done
    return 1
}
alive() { [ -e "/proc/$1" ] && ! grep -q '^State:.*Z' "/proc/$1/status" 2>/dev/null; }
gone() { ! alive "$1"; }

# begin [COMMAND WORDS before the run]: starts a run in the background and waits until COLMAP runs.
begin() {
    rm -f "$work/pid"
    "$@" "$conurb" poses "$work/town" >"$work/out" 2>&1 &
    run=$!
    until_true test -s "$work/pid" || bad "COLMAP was not started"
    colmap=$(cat "$work/pid")
}

# ends NAME CODE: the run ends with that code, and COLMAP with it.
ends() {
    local code=0
    wait "$run" 2>/dev/null || code=$?
    if [ "$code" = "$2" ]; then good; else bad "$1: exit code $code, not $2"; fi
    if until_true gone "$colmap"; then good; else
        bad "$1: COLMAP lives on"
        kill -9 "$colmap" 2>/dev/null
    fi
}

for signal in TERM INT HUP; do
    begin
    kill -"$signal" "$run"
    ends "SIG$signal" 75
done

begin nohup
kill -HUP "$run"
sleep 0.5
if alive "$run"; then good; else bad "nohup: a hangup ended the run"; fi
kill -TERM "$run"
ends "nohup, then SIGTERM" 75

begin
kill -KILL "$run"
ends "kill -9" 137

# A COLMAP that ignores SIGTERM: the second Ctrl-C does not wait for it.
printf '#!/bin/sh\ntrap "" TERM\necho $$ >%s/pid\nwhile :; do sleep 1000; done\n' "$work" >"$work/colmap"
begin
kill -INT "$run"
sleep 0.5
kill -INT "$run"
ends "two Ctrl-C" 130
finish
