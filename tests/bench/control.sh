#!/usr/bin/env bash
# Check points of synthetic cities whose GPS is 3 m off: with five control points, and by GPS alone. COLMAP finds the
# poses in photos that conurb-synth renders; marks are 0.3 px off.
# usage: control.sh CONURB SYNTH OUT [SEED ...]
set -euo pipefail
conurb=$1
synth=$2
out=$3
shift 3
flow=$(cd "$(dirname "${BASH_SOURCE[0]}")/../flow" && pwd)
checks="G6, G7, G8, G9, G10, G11, G12, G13"

# city FOLDER NAME CHECKS: the check points' rms by axis
city() {
    "$conurb" init "$1/$2" --photos "$1/made/photos" 2>"$1/$2.log"
    sed -i "/^poses:/a\  control: $1/marks\n  check: \"$3\"\n  control_heights: sea_level" "$1/$2/city.yaml"
    "$conurb" poses "$1/$2" 2>>"$1/$2.log"
    grep -E 'photos posed|control points: |check points: ' "$1/$2.log" | sed "s/^/$(basename "$1"), $2: /"
}
for seed in "${@:-3}"; do
    of=$out/seed-$seed
    mkdir -p "$of"
    "$synth" "$of/made" --seed "$seed" --photos 40 --size 40 --width 640 --height 432 --gps-noise 3 --empty \
        2>"$of/synth.log"
    python3 "$flow/marks.py" "$of/made/truth" "$of/marks" 13 0.3 list
    city "$of" five "$checks"
    city "$of" none "G1, G2, G3, G4, G5, $checks"
done
