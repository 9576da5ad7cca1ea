#!/usr/bin/env bash
# However a run is ended, the next run gives the same bytes as one without interruption, and leaves no extra files.
# usage: kill.sh CONURB MAKE_PHOTOS [SYNCED]     SYNCED: the library made of synced.c; without, power losses are skipped
# How often: CONURB_KILLS (kill -9), CONURB_TERMS (SIGTERM), CONURB_LOSSES (power), CONURB_FULL (disk full);
# CONURB_SEED: the moments.
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
synced=${3:-}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
RANDOM=${CONURB_SEED:-1}
: >"$work/out"
often=2 terms=1
# Sanitized, a run takes a minute; stopping and signals have tests of their own.
sanitized && often=1 terms=0

# The files to compare: all but logs, clock readings, and what a stopped run may leave for the next.
worth() { (cd "$1" && find . -type f ! -name log.jsonl ! -name metrics.json -print0 | sort -z | xargs -0 sha256sum); }

fresh() { rm -rf "$work/town" && cp -a "$work/new" "$work/town"; }

# same NAME: the city equals the one that was never interrupted.
same() {
    worth "$work/town" >"$work/out"
    if cmp -s "$work/whole" "$work/out"; then good; else
        diff "$work/whole" "$work/out" >"$work/diff"
        mv "$work/diff" "$work/out"
        bad "$1: not the same bytes"
    fi
}

# moment: seconds from now, within the length of a run.
moment() { awk -v t="$length" -v r="$RANDOM" 'BEGIN { printf "%.3f", t * r / 32768 }'; }

# cut_short SIGNAL [COMMAND WORDS before the run]: a run that gets the signal at a random moment.
cut_short() {
    local signal=$1 code=0
    shift
    "$@" "$conurb" run "$work/town" --threads 2 >"$work/out" 2>&1 &
    local pid=$!
    sleep 0.1 # before the program has started, the signal would end the shell that starts it
    sleep "$(moment)"
    kill -"$signal" "$pid" 2>/dev/null
    wait "$pid" 2>/dev/null || code=$?
    return "$code"
}

stage_reached() {
    if compgen -G "$work/town/renders/flight/*" >/dev/null; then echo render
    elif compgen -G "$work/town/tiles/*" >/dev/null; then echo train
    elif [ -e "$work/town/poses/stage.json" ]; then echo plan
    else echo poses; fi
}

finish_town() { expect 0 "flight" "$1: the run after it" "$conurb" run "$work/town" --threads 2; }

three_tiles town
cp -a "$work/town" "$work/new"
began=$(date +%s.%N)
expect 0 "flight" "a run that is left alone" "$conurb" run "$work/town" --threads 2
length=$(awk -v a="$began" -v b="$(date +%s.%N)" 'BEGIN { print b - a }')
worth "$work/town" >"$work/whole"
[ "$failed" = 0 ] || { finish; exit 1; }
size=$(du -sk "$work/town" | cut -f1)

# A run that ends between its last file and its lock leaves the lock, in every folder that it works in.
fresh
expect 0 "flight" "a run that ends" "$conurb" run "$work/town" --threads 2
for folder in poses plan "$work/town"/tiles/*/ match eval renders/flight; do
    folder=${folder#"$work/town/"}
    [ -d "$work/town/$folder" ] && touch "$work/town/$folder/LOCK"
done
finish_town "locks left behind"
same "locks left behind"

declare -A hits
for ((i = 1; i <= ${CONURB_KILLS:-$often}; i++)); do
    fresh
    cut_short KILL
    stage=$(stage_reached)
    hits[$stage]=$((${hits[$stage]:-0} + 1))
    # Every second time the next run is interrupted too.
    [ $((i % 2)) = 0 ] && cut_short KILL
    finish_town "kill $i ($stage)"
    same "kill $i ($stage)"
done
echo "kill -9: $(for s in "${!hits[@]}"; do printf '%s in %s, ' "${hits[$s]}" "$s"; done) run of $length s"

for ((i = 1; i <= ${CONURB_TERMS:-$terms}; i++)); do
    fresh
    code=0
    cut_short TERM || code=$?
    # 143: the signal came before the handler was set; 0: the run had ended.
    case $code in 75 | 0 | 143) good ;; *) bad "SIGTERM $i: exit code $code, not 75" ;; esac
    finish_town "SIGTERM $i"
    same "SIGTERM $i"
done

if [ -n "$synced" ] && [ -e "$synced" ]; then
    lost=0
    kept=0
    for ((i = 1; i <= ${CONURB_LOSSES:-2}; i++)); do
        fresh
        rm -rf "$work/store"
        python3 "$here/power_loss.py" begin "$work/store" "$work/town"
        before=$(find "$work/store" -type f | wc -l)
        cut_short KILL env LD_PRELOAD="$synced" CONURB_SYNCED="$work/store" CONURB_SYNCED_ROOT="$work/town"
        kept=$((kept + $(find "$work/store" -type f | wc -l) - before))
        # Every third time, only synced data survive.
        lost=$((lost + $(python3 "$here/power_loss.py" cut "$work/store" "$work/town" $((i % 3 ? i : 0)))))
        finish_town "power loss $i"
        same "power loss $i"
    done
    # One or two may happen before anything is synced.
    [ "$kept" -gt 0 ] || [ "${CONURB_LOSSES:-2}" -lt 5 ] && good || bad "power losses: the layer saw no fsync"
    echo "power losses: $lost files and folders lost what was not synced, $kept times something was synced"
else
    echo "power losses: skipped, the program is built without the layer for them"
fi

# A full disk: a file system too small by a random amount, which then grows.
mkdir "$work/disk"
if [ "$(id -u)" = 0 ] && mount -t tmpfs -o size=1m tmpfs "$work/disk" 2>/dev/null; then
    trap 'umount "$work/disk" 2>/dev/null; rm -rf "$work"' EXIT
    rm -rf "$work/town"
    mkdir "$work/town"
    umount "$work/disk"
    for ((i = 1; i <= ${CONURB_FULL:-$often}; i++)); do
        mount -t tmpfs -o "size=$((size * (RANDOM % 90 + 5) / 100 + 64))k" tmpfs "$work/town"
        trap 'umount "$work/town" 2>/dev/null; rm -rf "$work"' EXIT
        cp -a "$work/new/." "$work/town"
        expect 6 "cannot" "disk full $i" "$conurb" run "$work/town" --threads 2
        mount -o remount,size=1g "$work/town"
        finish_town "disk full $i"
        same "disk full $i"
        umount "$work/town"
    done
else
    echo "disk full: skipped, this user may not mount a small file system"
fi
rm -rf "$work/town"
finish
