#!/usr/bin/env bash
# A lens that darkens the corners: the plan finds it from the sparse points, and training and eval take it into account.
# usage: vignetting.sh CONURB MAKE_PHOTOS SYNTH COMPARE
source "$(dirname "$0")/lib.sh"
synth=$3 compare=$4

"$synth" "$work/made" --seed 3 --photos 16 --size 40 --width 96 --height 64 --gps-noise 0 --plain 2>"$work/out" ||
    bad "conurb-synth"
# So dark that the gain, 1.7 to 2.1 dB with four seeds, stands clear of chance. With 1.2 it is 0.6 to 1.5 dB.
mkdir "$work/dark"
for photo in "$work"/made/photos/*.jpg; do
    "$compare" darken "$photo" "$work/dark/${photo##*/}" 1.6 || bad "darker corners"
done

# lens_city NAME PHOTOS WANTED: a city whose effect is WANTED; others would explain dark corners in their own way.
lens_city() {
    local effect off=
    for effect in appearance exposure transient pose_refinement stereo_depth; do off="$off\n  $effect: off"; done
    "$conurb" init "$work/$1" --photos "$2" --import "$work/made/truth/model" --width 96 2>/dev/null
    sed -i "s/^plan:/plan:\n  spacing_m: 300\n  probe_share: 0/
        s/^train:/train:\n  steps: $(steps_of 500)\n  samples_per_step: 8192/
        s/^field:.*/field:\n  log2_table: 15\n  levels: 8\n  finest_resolution: 512/
        s/^effects:.*/effects:\n  vignetting: $3$off/" "$work/$1/city.yaml"
    "$conurb" poses "$work/$1" >"$work/out" 2>&1 || bad "$1: poses"
}

# decided PATTERN TEXT: the last plan's line on vignetting.
decided() {
    if grep -qE "vignetting +$1" "$work/out"; then good; else bad "$2"; fi
}

# psnr NAME: of the held-out photos.
psnr() {
    "$conurb" train "$work/$1" >"$work/out" 2>&1 || bad "$1: train"
    "$conurb" eval "$work/$1" 2>"$work/out" | awk '/^mean/ { print $2 }'
}

lens_city clear "$work/made/photos" auto
lens_city with "$work/dark" auto
lens_city without "$work/dark" off
expect 0 "" "a plan of clear photos" "$conurb" plan --no-forecast "$work/clear"
decided "0\.0[0-9]+ +[0-9.]+ +off" "no vignetting is found in clear photos"
expect 0 "" "a plan of dark corners" "$conurb" plan --no-forecast "$work/with"
decided "[01]\.[0-9]+ +[0-9.]+ +on +evidence" "dark corners are found"
expect 0 "" "a plan without the effect" "$conurb" plan --no-forecast "$work/without"
with=$(psnr with) without=$(psnr without)
echo "held-out photos: $without dB without vignetting, $with dB with it"
if sanitized || awk -v a="$without" -v b="$with" 'BEGIN { exit !(b > a + 1) }'; then good; else
    bad "held-out photos: $without dB without vignetting, $with dB with it"
fi
finish
