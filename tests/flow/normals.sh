#!/usr/bin/env bash
# Normal maps: a synthetic city of few photos is trained with its normals, 4 degrees off in the mean. Its depth is then
# better. Maps that cannot be used are named in one line.
# usage: normals.sh CONURB MAKE_PHOTOS SYNTH COMPARE
source "$(dirname "$0")/lib.sh"
synth=$3 compare=$4

"$synth" "$work/made" --seed 3 --photos 7 --size 40 --width 96 --height 64 --gps-noise 0 --plain 2>"$work/out" ||
    bad "conurb-synth"
views=$work/made/truth/views maps=$work/maps
mkdir "$maps"
"$compare" normals "$work/made/truth/model" "$views" "$maps" 0.1 || bad "normal maps"

# normal_city NAME [LINE...]: a city with these lines below `photos:`.
normal_city() {
    local name=$1 lines=
    shift
    "$conurb" init "$work/$name" --photos "$work/made/photos" --import "$work/made/truth/model" --width 96 2>/dev/null
    for line in "$@"; do lines="$lines\n  $line"; done
    sed -i "s|^photos:|photos:$lines|; s/^plan:/plan:\n  spacing_m: 300/" "$work/$name/city.yaml"
    sed -i "s/^train:/train:\n  steps: $(steps_of 600)\n  samples_per_step: 8192/
        s/^field:.*/field:\n  log2_table: 15\n  levels: 8\n  finest_resolution: 512/
        s/^effects:.*/effects:\n  appearance: off\n  transient: off\n  pose_refinement: off\n  stereo_depth: off/" \
        "$work/$name/city.yaml"
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

normal_city plain
normal_city normal "normal: $maps"
expect 0 "all 7 photos have a normal map" "a plan says what it found" "$conurb" plan --no-forecast "$work/normal"
expect 0 "" "a plan without normal maps" "$conurb" plan --no-forecast "$work/plain"
expect 0 "" "a city without normal maps trains" "$conurb" train "$work/plain"
expect 0 "" "a city with normal maps trains" "$conurb" train "$work/normal"
plain=$(error plain) normal=$(error normal)
echo "median error of depth: $plain without normal maps, $normal with them"
if sanitized || awk -v a="$plain" -v b="$normal" 'BEGIN { exit !(b > 0 && b < 0.8 * a) }'; then good; else
    bad "depth: $plain without normal maps, $normal with them"
fi

# With the same maps the stage is done; with other axes it is due, and the maps then look wrong.
expect 0 "the plan is done" "the plan goes by the maps" "$conurb" plan --no-forecast "$work/normal"
sed -i "s|^  normal: .*|&\n  normal_axes: opencv|" "$work/normal/city.yaml"
expect 0 "most normals point away from the camera" "wrong axes" "$conurb" plan --no-forecast "$work/normal"

# Bad maps.
mkdir "$work/none"
normal_city bad "normal: $work/none"
expect 4 "no photo has a normal map in $work/none; name it as the photo, such as run0-clear_air_0000.jpg.png" \
    "no map at all" "$conurb" plan --no-forecast "$work/bad"
cp "$maps"/* "$work/none"
rm "$work/none/run0-clear_air_0000.exr"
expect 0 "6 of 7 photos have a normal map in $work/none; run0-clear_air_0000.jpg has none" "a map is missing" \
    "$conurb" plan --no-forecast "$work/bad"
head -c 2000 "$maps/run0-clear_air_0000.exr" >"$work/none/run0-clear_air_0000.exr"
expect 5 "$work/none/run0-clear_air_0000.exr" "a map that ends too early" "$conurb" plan --no-forecast "$work/bad"
finish
