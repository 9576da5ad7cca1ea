#!/usr/bin/env bash
# Control points of a synthetic city whose GPS is 3 m off: five place it within 5 cm, whatever file they come in; check
# points tell by how much, and faults of the file are one line.
# usage: control.sh CONURB MAKE_PHOTOS SYNTH
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
synth=$3
here=$(dirname "${BASH_SOURCE[0]}")
town=$work/made
"$synth" "$town" --seed 3 --photos 40 --size 40 --width 96 --height 64 --gps-noise 3 --empty 2>"$work/out" ||
    { bad "conurb-synth"; exit 1; }
for kind in list table json; do python3 "$here/marks.py" "$town/truth" "$work/marks-$kind" 13 0.02 $kind; done
checks="G6, G7, G8, G9, G10, G11, G12, G13"

# make NAME LINES: a city of the photos, with the true poses imported and these lines in its poses.
make() {
    "$conurb" init "$work/$1" --photos "$town/photos" --import "$town/truth/model" --width 48 2>/dev/null
    printf '%b' "$2" >"$work/lines"
    sed -i "/^poses:/r $work/lines" "$work/$1/city.yaml"
}
# check_rms FILE: the check points' error that poses.json states.
check_rms() { python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["check_rms_m"])' "$1"; }
below() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a < b) }'; }

for kind in list table json; do
    make "$kind" "  control: $work/marks-$kind\n  check: \"$checks\"\n  control_heights: sea_level\n"
    expect 0 "8 check points: " "control points of a $kind" "$conurb" poses "$work/$kind"
    rms=$(check_rms "$work/$kind/poses/poses.json")
    expect 0 "the page holds" "the report on a $kind" python3 "$here/report.py" "$work/$kind/poses"
    if below "$rms" 0.05; then good; else bad "$kind: check points are $rms m off"; fi
done
expect 0 "poses are done" "a second run" "$conurb" poses "$work/list"
sed -i 's/"G6, /"/' "$work/list/city.yaml"
expect 0 "7 check points: " "another list of check points" "$conurb" poses "$work/list"

# Without control points the photos' GPS alone places the city.
make none "  control: $work/marks-list\n  check: \"G1, G2, G3, G4, G5, $checks\"\n  control_heights: sea_level\n"
expect 0 "13 check points: " "check points alone" "$conurb" poses "$work/none"
rms=$(check_rms "$work/none/poses/poses.json")
if below 0.15 "$rms"; then good; else bad "GPS with 3 m of noise is as good as $rms m"; fi

make faults "  control: $work/broken\n"
expect 6 "broken" "a file that is not there" "$conurb" poses "$work/faults"
sed "5s/ .*//" "$work/marks-list" >"$work/broken"
expect 5 "line 5: x y z px py photo" "a damaged line" "$conurb" poses "$work/faults"
[ -e "$work/faults/poses/poses.json" ] && bad "poses were written in spite of a damaged file"
sed -i 's/^  control:.*/  check: "G1"/' "$work/faults/city.yaml"
expect 3 "poses.check names points, but poses.control names no file" "check points without a file" \
    "$conurb" poses "$work/faults"
make unknown "  control: $work/marks-list\n  check: \"G99\"\n"
expect 3 "has no point G99" "an unknown check point" "$conurb" poses "$work/unknown"
finish
