#!/usr/bin/env bash
# The processor and every device that the doctor lists train the same city with the same settings: PSNR of held-out
# photos is within 0.2 dB. Small, for devices in software.
# usage: learning.sh CONURB MAKE_PHOTOS CITY
#   fox                    photos of a fox, 300 steps; needs CONURB_DATA/fox
#   effects                photos of a made city, every effect on
. "$(dirname "${BASH_SOURCE[0]}")/../flow/lib.sh"
unset CONURB_DEVICE
mapfile -t devices < <("$conurb" doctor "$work" 2>/dev/null | grep '^good  device' | grep -o 'gpu:[0-9]*')
[ ${#devices[@]} -gt 0 ] || { echo "skipped: no device of Vulkan here"; exit 77; }
export VK_INSTANCE_LAYERS=VK_LAYER_KHRONOS_validation

# make FOLDER: a city of these photos.
make() {
    "$conurb" init "$work/city" --photos "$1" --import "$1/transforms.json" --width 48 2>/dev/null
    sed -i "s/^field:.*/field:\n  log2_table: 13\n  levels: 8\n  density_width: 16\n  colour_width: 16/
        s/^train:/train:\n  steps: $steps\n  samples_per_step: 4096\n  precision: float/" "$work/city/city.yaml"
}
score() {
    "$conurb" eval "$work/city" --json 2>/dev/null |
        python3 -c 'import json, sys; print(json.load(sys.stdin)["psnr"])'
}

if [ "$3" = fox ]; then
    fox=${CONURB_DATA:-$(dirname "${BASH_SOURCE[0]}")/../../../shared/data}/fox
    [ -e "$fox/transforms.json" ] || { echo "skipped: no fox photos under CONURB_DATA"; exit 77; }
    steps=300
    make "$(realpath "$fox")"
else
    steps=100
    mkdir "$work/photos"
    "$photos" "$work/photos" 17 all
    make "$work/photos"
    sed -i -E '/^effects:/,/^$/s/^  # ([a-z_]+): auto /  \1: on /' "$work/city/city.yaml"
fi
expect 0 "photos posed" "poses" "$conurb" poses "$work/city"
expect 0 "view_dependence" "plan" "$conurb" plan "$work/city" --no-forecast
effects=$(grep -c " on  city.yaml" "$work/out")
[ "$3" = fox ] && wanted=0 || wanted=8
[ "$effects" = "$wanted" ] && good || bad "the plan has $effects effects of city.yaml, not $wanted"
expect 0 "training PSNR" "the processor" "$conurb" train "$work/city"
by_processor=$(score)
for device in "${devices[@]}"; do
    rm -rf "$work"/city/{tiles,eval}
    expect 0 "training on " "$device" "$conurb" train "$work/city" --device "$device"
    grep -q "Validation Error\|VUID-" "$work/out" && bad "$device: the validation layer complains" || good
    by_device=$(score)
    echo "$3, $steps steps: $by_device dB by $device, $by_processor dB by the processor"
    if awk -v a="$by_device" -v b="$by_processor" 'BEGIN { exit !(a > 10 && a - b < 0.2 && b - a < 0.2) }'; then
        good
    else
        bad "$device: held-out photos have another PSNR"
    fi
done
finish
