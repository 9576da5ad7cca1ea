#!/usr/bin/env bash
# Depth maps: a synthetic city of few photos is trained with its true depth. Its depth is then better in held-out views.
# Maps that cannot be used are named in one line.
# usage: depth.sh CONURB MAKE_PHOTOS SYNTH COMPARE
source "$(dirname "$0")/lib.sh"
synth=$3 compare=$4

"$synth" "$work/made" --seed 3 --photos 7 --size 40 --width 96 --height 64 --gps-noise 0 --plain 2>"$work/out" ||
    bad "conurb-synth"
views=$work/made/truth/views

# depth_city NAME [LINE...]: a city with these lines below `photos:`.
depth_city() {
    local name=$1 lines=
    shift
    "$conurb" init "$work/$name" --photos "$work/made/photos" --import "$work/made/truth/model" --width 96 2>/dev/null
    for line in "$@"; do lines="$lines\n  $line"; done
    sed -i "s|^photos:|photos:$lines|; s/^plan:/plan:\n  spacing_m: 300/" "$work/$name/city.yaml"
    sed -i "s/^train:/train:\n  steps: $(steps_of 600)\n  samples_per_step: 8192/
        s/^field:.*/field:\n  log2_table: 15\n  levels: 8\n  finest_resolution: 512/
        s/^effects:.*/effects:\n  appearance: off\n  transient: off\n  pose_refinement: off/" "$work/$name/city.yaml"
    "$conurb" poses "$work/$name" >"$work/out" 2>&1 || bad "$name: poses"
}

# error NAME: the median over the views of each view's median relative depth error.
error() {
    local view
    for view in $(ls "$work/made/photos" | sed "s,.jpg,,"); do
        "$conurb" render "$work/$1" --photo "$view.jpg" --width 96 --out "$work/$1-$view" >"$work/out" 2>&1 ||
            bad "$1: render"
        "$compare" depth "$views/$view.exr" "$work/$1-$view/00000.exr"
    done | sort -g | sed -n 4p
}

depth_city plain
depth_city ray "depth: $views" "depth_along: ray"
expect 0 "all 7 photos have a depth map" "a plan says what it found" "$conurb" plan --no-forecast "$work/ray"
expect 0 "" "a plan without depth maps" "$conurb" plan --no-forecast "$work/plain"
expect 0 "" "a city without depth maps trains" "$conurb" train "$work/plain"
expect 0 "" "a city with depth maps trains" "$conurb" train "$work/ray"
plain=$(error plain) ray=$(error ray)
echo "median error of depth: $plain without depth maps, $ray with them"
if sanitized || awk -v a="$plain" -v b="$ray" 'BEGIN { exit !(b > 0 && b < a / 2) }'; then good; else
    bad "depth: $plain, $ray"
fi

# Maps of unknown scale and shift, with noise, as networks give them. Wrong ones are left out, so they cost nothing.
cues=$work/cues wrong=$work/wrong
mkdir "$cues" "$wrong" "$work/normals"
"$compare" cue "$work/made/truth/model" "$views" "$cues" 0.05 0.4 0.1 || bad "cues"
"$compare" cue "$work/made/truth/model" "$views" "$wrong" 0 1 0.8 || bad "wrong cues"
depth_city cue "depth: $cues" "depth_along: ray" "depth_kind: cue"
expect 0 "all 7 photos have a depth map" "a plan with cues" "$conurb" plan --no-forecast "$work/cue"
expect 0 "" "a city with cues trains" "$conurb" train "$work/cue"
# The same with normals, 4 degrees off in the mean.
"$compare" normals "$work/made/truth/model" "$views" "$work/normals" 0.1 || bad "normal maps"
depth_city both "depth: $cues" "depth_along: ray" "depth_kind: cue" "normal: $work/normals"
expect 0 "all 7 photos have a normal map" "a plan with cues and normals" "$conurb" plan --no-forecast "$work/both"
expect 0 "" "a city with cues and normals trains" "$conurb" train "$work/both"
cue=$(error cue) both=$(error both)
# Three seeds of each: one differs from the next by a tenth.
sanitized && seeds= || seeds="2 3"
for seed in $seeds; do
    for name in plain cue both; do
        cp -r "$work/$name" "$work/$name$seed"
        sed -i "s/^train:/train:\n  seed: $seed/" "$work/$name$seed/city.yaml"
        "$conurb" train "$work/$name$seed" >"$work/out" 2>&1 || bad "$name$seed: train"
    done
    plain="$plain $(error plain$seed)" cue="$cue $(error cue$seed)" both="$both $(error both$seed)"
done
echo "median errors of depth by seed: $plain without depth maps, $cue with cues, $both with cues and normals"
for with in "$cue" "$both"; do
    if sanitized || awk -v a="$plain" -v b="$with" '
        function sum(list, f, n, s) { n = split(list, f, " "); while (n) s += f[n--]; return s }
        BEGIN { exit !(sum(b) > 0 && sum(b) < 0.5 * sum(a)) }'; then good; else bad "cue: $plain, $with"; fi
done
depth_city noise "depth: $wrong" "depth_along: ray" "depth_kind: cue"
expect 0 "" "a plan with wrong cues" "$conurb" plan --no-forecast "$work/noise"
expect 0 "the depth maps of 6 photos are left out" "wrong cues" "$conurb" train "$work/noise"
psnr() { "$conurb" eval "$work/$1" --json 2>"$work/out" | sed -n 's/^{"psnr": \([0-9.]*\),.*/\1/p'; }
without=$(psnr plain) with=$(psnr noise)
echo "PSNR of the held-out photo: $without dB without depth maps, $with dB with wrong cues"
if sanitized || awk -v a="$without" -v b="$with" 'BEGIN { exit !(a > 0 && b > a - 0.3) }'; then good; else
    bad "wrong cues: $without, $with"
fi

# With the same maps the stage is done; with another map it is due.
expect 0 "the plan is done" "the plan goes by the maps" "$conurb" plan --no-forecast "$work/ray"

# Bad maps.
maps=$work/maps
mkdir "$maps"
depth_city bad "depth: $maps"
expect 4 "no photo has a depth map in $maps; name it as the photo, such as run0-clear_air_0000.jpg.png" \
    "no map at all" "$conurb" plan --no-forecast "$work/bad"
for view in "$views"/*; do cp "$view" "$maps"; done
rm "$maps/run0-clear_air_0000.exr"
expect 0 "6 of 7 photos have a depth map in $maps; run0-clear_air_0000.jpg has none" "a map is missing" \
    "$conurb" plan --no-forecast "$work/bad"
head -c 2000 "$views/run0-clear_air_0000.exr" >"$maps/run0-clear_air_0000.exr"
expect 5 "$maps/run0-clear_air_0000.exr" "a map that ends too early" "$conurb" plan --no-forecast "$work/bad"
sed -i "s|  depth: .*|  depth: $work/made/photos/depth|" "$work/bad/city.yaml"
expect 3 "photos.depth lies inside photos.folder" "maps among the photos" "$conurb" plan --no-forecast "$work/bad"
finish
