#!/usr/bin/env bash
# The table of commands: options in both forms, help, man pages, and completion in bash.
# command_line.sh CONURB MAKE_PHOTOS
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
commands='init poses plan train match render relight appearance eval steady tradeoff export run status submit doctor'

# Parsing. tiles/demo has no photos, so that a command ends early.
cp -r "$root/tiles/demo" "$work/demo"
expect 0 "made" "--photos=DIR" "$conurb" init "$work/city" --photos="$work" --width=640
grep -q 'width_px: 640' "$work/city/city.yaml" && good || bad "--width=640 is not in city.yaml"
"$conurb" train "$work/demo" --tile nowhere >"$work/apart" 2>&1
code=$?
expect "$code" "nowhere" "--tile=X" "$conurb" train "$work/demo" --tile=nowhere
cmp -s "$work/out" "$work/apart" && good || bad "--tile=X does something else than --tile X"
expect 0 "conurb" "--threads=1, before the folder" "$conurb" doctor --threads=1 "$work/demo"
expect 2 "no option '--colour=red'" "an unknown option with a value" "$conurb" plan "$work/demo" --colour=red
expect 2 "no option '-x'" "a letter" "$conurb" plan "$work/demo" -x
expect 2 "--tile needs a value" "a value that is missing" "$conurb" train "$work/demo" --tile
expect 2 "--json takes no value" "a flag with a value" "$conurb" status "$work/demo" --json=yes
expect 2 "--width needs a number, not '3m'" "a length is no time" "$conurb" render "$work/demo" --width 3m
expect 2 "--quality best: give preview, standard, high, reference or compact" "a choice" \
    "$conurb" run "$work/demo" --quality=best
expect 2 "--threads: give 1 to 1024" "no threads" "$conurb" plan "$work/demo" --threads=0
expect 2 "--device: there is no device 'tpu'; give auto, cpu, gpu" "no device" \
    "$conurb" status "$work/demo" --device tpu
expect 2 "CONURB_DEVICE: there is no device 'tpu'" "no device, by the environment" \
    env CONURB_DEVICE=tpu "$conurb" status "$work/demo"
expect 0 "device: the processor" "--device before the environment" \
    env CONURB_DEVICE=tpu "$conurb" status "$work/demo" --device=cpu
expect 0 "the processor does the work" "a device that is not there: one line, and the processor" \
    env VK_DRIVER_FILES=/nowhere VK_ICD_FILENAMES=/nowhere "$conurb" status "$work/demo" --device=gpu:99
expect 2 "too many words" "a second city" "$conurb" plan "$work/demo" "$work/city"
expect 2 "give the city's folder" "no city" "$conurb" plan

# Help.
for command in $commands; do
    "$conurb" "$command" --help >"$work/out" 2>&1 || bad "$command --help fails"
    for line in "usage: conurb $command" "--threads N" "example: conurb "; do
        grep -qF -- "$line" "$work/out" && good || bad "$command --help lacks '$line'"
    done
    awk 'length > 80 { exit 1 }' "$work/out" && good || bad "$command --help is wider than 80 columns"
done

# Man pages: one for each command, without a warning.
"$conurb" help --write "$work/pages" >"$work/out" 2>&1 && good || bad "man pages are not written"
for command in '' $commands; do
    page=$work/pages/man1/conurb${command:+-$command}.1
    [ -s "$page" ] && good || bad "$page is missing"
    if command -v groff >/dev/null; then
        groff -ww -man -Tutf8 -z "$page" >"$work/out" 2>&1
        [ ! -s "$work/out" ] && good || bad "groff warns of conurb-$command.1"
    fi
    if command -v man >/dev/null; then
        man --warnings -l "$page" 2>"$work/out" >/dev/null
        [ ! -s "$work/out" ] && good || bad "man warns of conurb-$command.1"
    fi
done

# offers LINE...: what completion offers for the last word of a command line.
offers() {
    bash -c '. "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _conurb; echo "${COMPREPLY[@]}"' \
        bash "$work/pages/completions/conurb" "$@"
}

# completes WANTED LINE...
completes() {
    local wanted=$1
    shift
    offers "$@" >"$work/out" 2>&1
    [ "$(cat "$work/out")" = "$wanted" ] && good || bad "completion of '$*' is not '$wanted'"
}
completes 'train tradeoff' conurb tr
completes '--quality' conurb train beach --q
completes 'standard' conurb train beach --quality st
completes 'standard' conurb train beach --quality = st
completes '--path --photo' conurb render beach --p
completes 'show sheet' conurb appearance beach s
completes '' conurb render beach --out ''
completes 'kubernetes' conurb submit --engine k

# Progress stays in one row of a terminal: of a longer line, the first rows would be left behind at every update.
if command -v script >/dev/null; then
    script -qec "stty cols 40; '$conurb' render '$work/demo' --frames 2 --width 16 --out '$work/narrow'" \
        "$work/out" >/dev/null 2>&1
    tr '\r' '\n' <"$work/out" | sed -n 's/^\x1b\[K//p' >"$work/rows"
    grep -q "^render 100%, 2 of 2" "$work/rows" && good || bad "no progress on a narrow terminal"
    grep -q '.\{40\}' "$work/rows" && bad "progress is wider than the terminal" || good
fi

finish
