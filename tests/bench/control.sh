#!/usr/bin/env bash
# Check points of a synthetic city whose GPS is 3 m off: with five control points, and by GPS alone. COLMAP finds the
# poses in photos that conurb-synth renders; marks are 0.3 px off.
# usage: control.sh CONURB SYNTH OUT
set -euo pipefail
conurb=$1
synth=$2
out=$3
flow=$(cd "$(dirname "${BASH_SOURCE[0]}")/../flow" && pwd)
mkdir -p "$out"
"$synth" "$out/made" --seed 3 --photos 40 --size 40 --width 640 --height 432 --gps-noise 3 --empty 2>"$out/synth.log"
python3 "$flow/marks.py" "$out/made/truth" "$out/marks" 13 0.3 list
checks="G6, G7, G8, G9, G10, G11, G12, G13"

# city NAME CHECKS: the check points' rms by axis
city() {
    "$conurb" init "$out/$1" --photos "$out/made/photos" 2>"$out/$1.log"
    sed -i "/^poses:/a\  control: $out/marks\n  check: \"$2\"\n  control_heights: sea_level" "$out/$1/city.yaml"
    "$conurb" poses "$out/$1" 2>>"$out/$1.log"
    grep -E 'photos posed|control points: |check points: ' "$out/$1.log" | sed "s/^/$1: /"
}
city five "$checks"
city none "G1, G2, G3, G4, G5, $checks"
