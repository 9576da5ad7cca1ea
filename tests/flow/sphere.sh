#!/usr/bin/env bash
# Photos of all directions: conurb-synth takes them, a short training learns from them, and a photo that it did not see
# is rendered. Other pictures of all directions are rendered from any path. What cannot be used is named in one line.
# usage: sphere.sh CONURB MAKE_PHOTOS SYNTH
source "$(dirname "$0")/lib.sh"
synth=$3

"$synth" "$work/made" --360 --seed 3 --photos 14 --size 40 --width 128 --height 64 --gps-noise 0 --plain \
    2>"$work/out" || bad "conurb-synth"
"$conurb" init "$work/city" --photos "$work/made/photos" --import "$work/made/truth/transforms.json" --width 128 \
    2>/dev/null
sed -i 's/^plan:/plan:\n  spacing_m: 300/; s/^train:/train:\n  steps: 700\n  samples_per_step: 8192/
    s/^field:.*/field:\n  log2_table: 15\n  levels: 8\n  finest_resolution: 512/
    s/^effects:.*/effects:\n  appearance: off\n  transient: off\n  pose_refinement: off/' "$work/city/city.yaml"
expect 0 "14 photos posed" "poses of a transforms.json" "$conurb" poses "$work/city"
expect 0 "" "a plan" "$conurb" plan --no-forecast "$work/city"
expect 0 "" "training" "$conurb" train "$work/city"
expect 0 "psnr" "scores of held-out photos" "$conurb" eval "$work/city" --json
psnr=$(python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["psnr"])' "$work/city/eval/eval.json")
echo "PSNR of held-out photos of all directions: $psnr dB"
if awk -v p="$psnr" 'BEGIN { exit !(p > 17) }'; then good; else bad "PSNR of held-out photos: $psnr"; fi

# size_is FILE WIDTH HEIGHT NAME: of a PNG
size_is() {
    local got
    got=$(python3 -c 'import struct, sys; print(*struct.unpack(">2I", open(sys.argv[1], "rb").read(24)[16:]))' "$1")
    if [ "$got" = "$2 $3" ]; then good; else bad "$4 has $got pixels"; fi
}
photo=$(basename "$(find "$work/made/photos" -name '*.jpg' | sort | head -n 1)")
expect 0 "" "a photo's own view" "$conurb" render "$work/city" --photo "$photo" --width 96 --out "$work/own"
size_is "$work/own/00000.png" 96 48 "a photo's own view"
echo '{"camera": "equirectangular", "fps": 1, "keyframes": [{"local": [0, 0, 3], "heading_deg": 0, "pitch_deg": -20},
    {"time_s": 1, "local": [3, 0, 3], "heading_deg": 0, "pitch_deg": -20}]}' >"$work/path.json"
expect 0 "2 frames" "a film of all directions" "$conurb" render "$work/city" --path "$work/path.json" --width 64 \
    --out "$work/film"
size_is "$work/film/00001.png" 64 32 "a frame of the film"
if [ -s "$work/film/flight.mp4" ]; then good; else bad "no film"; fi
expect 0 "1 frames" "the option" "$conurb" render "$work/city" --camera equirectangular --frames 1 --width 64 \
    --out "$work/option"
size_is "$work/option/00000.png" 64 32 "a frame by the option"
expect 2 "" "another camera" "$conurb" render "$work/city" --camera round --frames 1
expect 2 "is odd" "an odd width" "$conurb" render "$work/city" --camera equirectangular --frames 1 --width 65
expect 2 "shows all directions" "no such camera in a file" "$conurb" export "$work/city" --camera "$work/x.chan" \
    --path "$work/path.json"
finish
