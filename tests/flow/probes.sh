#!/usr/bin/env bash
# The plan tries an effect in doubt by short trainings: within the budget, and not when city.yaml decides. After kill -9
# it resumes and gives the same plan.
# usage: probes.sh CONURB MAKE_PHOTOS SYNTH
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
synth=$3

expect 0 "" "a synthetic city" "$synth" "$work/synth" --seed 3 --photos 40 --size 40 --width 96 --height 64 \
    --gps-noise 0
"$conurb" init "$work/town" --photos "$work/synth/photos" --import "$work/synth/truth/model" --width 96 2>/dev/null
sed -i 's/^train:/train:\n  steps: 3600/; s/^plan:/plan:\n  spacing_m: 300\n  probe_share: 0.1/
    s/^effects:.*/effects:\n  transient: off\n  sky: on\n  exposure: on\n  view_dependence: off/' \
    "$work/town/city.yaml"
expect 0 "posed" "poses" "$conurb" poses "$work/town"
expect 0 "in doubt: appearance. Probes: up to 2 trainings" "what it would do" \
    "$conurb" plan "$work/town" --no-forecast --dry-run
[ ! -e "$work/town/probes" ] && good || bad "a dry run trained"

for kind in alone forced none; do cp -r "$work/town" "$work/$kind"; done
expect 0 "appearance: probe: " "a plan with a probe" "$conurb" plan "$work/alone" --no-forecast
[ "$(ls "$work"/alone/probes/*.json | wc -l)" = 2 ] && good || bad "not two trainings"
grep -q 'probe: ' "$work/alone/plan/plan.json" && good || bad "plan.json does not say why"
before=$(digest "$work/alone")
expect 0 "the plan is done" "again" "$conurb" plan "$work/alone" --no-forecast
[ "$before" = "$(digest "$work/alone")" ] && good || bad "a second call made something anew"

# Under the sanitizers the trainings take minutes, and a second time they find nothing new.
if ! sanitized; then
    "$conurb" plan "$work/town" --no-forecast >"$work/out" 2>&1 &
    run=$!
    for ((i = 0; i < 1200; i++)); do
        [ -n "$(ls "$work"/town/probes/*.json 2>/dev/null)" ] && break
        sleep 0.1
    done
    kill -9 "$run"
    wait "$run" 2>/dev/null
    kept=$(ls "$work"/town/probes/*.json | head -n 1)
    inode=$(stat -c %i "$kept")
    expect 0 "appearance: probe: " "on after a kill" "$conurb" plan "$work/town" --no-forecast
    [ "$inode" = "$(stat -c %i "$kept")" ] && good || bad "a training that was done was done again"
    cmp -s "$work/town/plan/plan.json" "$work/alone/plan/plan.json" && good || bad "another plan after a kill"
fi

sed -i 's/^effects:/effects:\n  appearance: on/' "$work/forced/city.yaml"
sed -i 's/probe_share: 0.1/probe_share: 0/' "$work/none/city.yaml"
for kind in forced none; do
    expect 0 "appearance" "$kind: the plan" "$conurb" plan "$work/$kind" --no-forecast
    [ ! -e "$work/$kind/probes" ] && good || bad "$kind: something was trained"
done
finish
