#!/usr/bin/env bash
# Accuracy against time: every experiment has a row and a dot, a second call measures nothing again, and with a budget
# the next call does the rest.
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"

city town 17 all
# One photo is held out: codes fitted in the fog of a field that has hardly begun to train take most of the time.
sed -i 's/^plan:/plan:\n  hold_out_every: 16/' "$work/town/city.yaml"
expect 0 "17 photos posed" "poses" "$conurb" poses "$work/town"
expect 0 "tile" "plan" "$conurb" plan "$work/town" --no-forecast
cp -r "$work/town" "$work/other"
# 25 trials. Under the sanitizers they take minutes; the budget and the fields below run most of their code there.
if ! sanitized; then
    expect 0 "dB" "tradeoff" "$conurb" tradeoff "$work/town" --steps 20
    rows=$(($(wc -l <"$work/town/tradeoff.csv") - 1))
    [ "$rows" -ge 17 ] && good || bad "$rows trials, not 17 or more"
    for name in base steps-half table-quarter mlp-32 march-fine photos-half; do
        grep -q "^$name," "$work/town/tradeoff.csv" && good || bad "no row for $name"
        grep -q "$name" "$work/town/tradeoff.svg" && good || bad "no name $name in the plot"
    done
    [ -z "$(find "$work/town/tradeoff" -name pixels.bin)" ] && good || bad "the photos of a trial are left"
    before=$(digest "$work/town")
    expect 0 "dB" "tradeoff again" "$conurb" tradeoff "$work/town" --steps 20
    [ "$before" = "$(digest "$work/town")" ] && good || bad "a second call measured anew"
    expect 0 "dB" "effects" "$conurb" tradeoff "$work/other" --effects --steps 20
    n=$(wc -l <"$work/other/tradeoff-effects.csv")
    [ "$n" = 10 ] && good || bad "not a row for the plan and each of eight effects"
fi
expect 0 "the next call does it" "a budget" "$conurb" tradeoff "$work/other" --steps 20 --time-budget 1s
sanitized && few=2 || few=20
expect 0 "for a small file take" "fields" "$conurb" tradeoff "$work/other" --fields --quality preview --steps "$few"
for type in hash dense voxels nerf sdf points kilo; do
    grep -q "^$type," "$work/other/tradeoff-fields.csv" && good || bad "no row for $type"
    grep -q "$type" "$work/other/tradeoff-fields.svg" && good || bad "no name $type in the plot"
done
before=$(digest "$work/other")
expect 0 "dB" "fields again" "$conurb" tradeoff "$work/other" --fields --quality preview --steps "$few"
[ "$before" = "$(digest "$work/other")" ] && good || bad "a second call trained the fields anew"
[ "$(head -1 "$work/other/tradeoff-fields.csv" | tr , '\n' | wc -l)" = 11 ] && good || bad "not eleven columns"
expect 2 "goes with --fields" "a truth without fields" "$conurb" tradeoff "$work/other" --truth "$work"
expect 2 "not both" "two kinds of trials" "$conurb" tradeoff "$work/other" --fields --effects
finish
