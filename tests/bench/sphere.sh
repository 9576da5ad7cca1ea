#!/usr/bin/env bash
# Photos of all directions of a synthetic city: their poses by COLMAP (six views of each) against the truth, and what
# a photo that training did not see scores.
# usage: sphere.sh CONURB SYNTH OUT [PHOTOS [WIDTH [STEPS]]]
set -euo pipefail
conurb=$1
synth=$2
out=$3
photos=${4:-24}
width=${5:-1024}
steps=${6:-3000}
bench=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
mkdir -p "$out"
"$synth" "$out/made" --360 --seed 3 --photos "$photos" --size 40 --width "$width" --height $((width / 2)) --aerial 0.2 \
    --gps-noise 1 --plain 2>"$out/synth.log"
"$conurb" init "$out/city" --photos "$out/made/photos" 2>"$out/log"
"$conurb" poses "$out/city" 2>>"$out/log"
grep -E 'photos posed|views joined|attempt' "$out/log"
python3 "$bench/rig_truth.py" "$out/city/poses/model" "$out/made/truth/model"
sed -i "s/^train:/train:\n  steps: $steps/" "$out/city/city.yaml"
for step in plan train eval; do "$conurb" "$step" "$out/city" >>"$out/log" 2>&1; done
python3 -c 'import json, sys; print("PSNR of held-out photos: %.2f dB" % json.load(open(sys.argv[1]))["psnr"])' \
    "$out/city/eval/eval.json"
