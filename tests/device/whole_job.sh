#!/usr/bin/env bash
# The whole job with --device: no Vulkan, Vulkan too old, only software devices, too little memory, or none that the
# processor shares or caches, a device that is lost in mid-training, kill -9 on one device with a resume on the other,
# and two devices at once. And which device the program takes without --device.
# usage: whole_job.sh CONURB MAKE_PHOTOS LOADER     LOADER: the folder of libvulkan.so.1 made of loader.c
. "$(dirname "${BASH_SOURCE[0]}")/../flow/lib.sh"
loader=$3
real=$(ldconfig -p | awk '$1 == "libvulkan.so.1" { print $NF; exit }')
unset CONURB_DEVICE

# small NAME: a city whose only tile trains in a moment, also on a software device.
small() {
    city "$1" 9 all
    sed -i 's/^plan:/plan:\n  hold_out_every: 4/; s/steps: 40/steps: 24/
        s/samples_per_step: 8192/samples_per_step: 4096/
        s/^train:/train:\n  precision: float\n  checkpoint_every_s: 0.05/
        s/^field:/field:\n  density_width: 16\n  colour_width: 16/' "$work/$1/city.yaml"
}

# with_loader SETTINGS COMMAND...: the program sees the loader of the tests.
with_loader() {
    local settings=$1
    shift
    # shellcheck disable=SC2086 # several settings
    env LD_LIBRARY_PATH="$loader" CONURB_TEST_LOADER="$real" $settings "$@"
}

# says TEXT NAME: the last answer has this line.
says() { if grep -qF -- "$1" "$work/out"; then good; else bad "$2: the answer lacks '$1'"; fi; }
says_not() { if grep -qF -- "$1" "$work/out"; then bad "$2: the answer has '$1'"; else good; fi; }
# In this order, and the first only once.
says_before() {
    local first then
    first=$(grep -nF -- "$1" "$work/out" | head -n 1 | cut -d: -f1)
    then=$(grep -nF -- "$2" "$work/out" | head -n 1 | cut -d: -f1)
    [ -n "$first" ] && [ -n "$then" ] && [ "$first" -lt "$then" ] && good || bad "$3: '$1' does not come before '$2'"
}

# The tile of a city, and its score.
tile() { echo "$work/$1"/tiles/*/tile.safetensors; }
psnr() {
    "$conurb" eval "$work/$1" --json 2>/dev/null |
        python3 -c 'import json, sys; print(json.load(sys.stdin)["psnr"])'
}
# near A B NAME: within 0.2 dB.
near() {
    if awk -v a="$1" -v b="$2" 'BEGIN { d = a - b; exit !(a != "" && b != "" && d < 0.2 && d > -0.2) }'; then
        good
    else
        bad "$3: $1 dB and $2 dB"
    fi
}
same_tile() { if cmp -s "$(tile "$1")" "$(tile "$2")"; then good; else bad "$3: not the tile of $2"; fi; }

# again NAME: the city without its tiles.
again() {
    rm -rf "${work:?}/$1"
    cp -a "$work/new" "$work/$1"
}

small new
expect 0 "flight" "a run without --device" "$conurb" run "$work/new"
cp -a "$work/new" "$work/processor"
says_not "device" "a run that names none"
rm -rf "$work"/new/{tiles,match,eval,renders}

# No loader: a file that is no library stands before it.
mkdir "$work/none"
: >"$work/none/libvulkan.so.1"
again none-city
expect 0 "the Vulkan loader is not installed (Debian: libvulkan1); the processor does the work" "no Vulkan" \
    env LD_LIBRARY_PATH="$work/none" "$conurb" run "$work/none-city" --device gpu
same_tile none-city processor "no Vulkan"
again none-city
sed -i 's/^train:/train:\n  device: gpu/' "$work/none-city/city.yaml"
expect 0 "train.device: the Vulkan loader is not installed (Debian: libvulkan1); the processor does the work" \
    "no Vulkan, train.device" env LD_LIBRARY_PATH="$work/none" "$conurb" run "$work/none-city"
same_tile none-city processor "no Vulkan, train.device"
env LD_LIBRARY_PATH="$work/none" "$conurb" doctor "$work" >"$work/out" 2>&1
says "good  device      none, the processor does all: the Vulkan loader is not installed (Debian: libvulkan1)" "doctor"

if [ -z "$real" ]; then
    finish
    echo "the rest is skipped: no Vulkan loader here"
    exit $((failed ? 1 : 0))
fi
with_loader CONURB_TEST_VERSION=2 "$conurb" doctor "$work" >"$work/out" 2>&1
says "good  device      none, the processor does all: the Vulkan loader has version 1.2; 1.3 is needed" "an old loader"
no=$work/none/no.json
env VK_DRIVER_FILES="$no" VK_ICD_FILENAMES="$no" "$conurb" doctor "$work" >"$work/out" 2>&1
says "good  device      none, the processor does all: Vulkan " "doctor, no driver"

"$conurb" doctor "$work" >"$work/out" 2>&1
if ! grep -q "device .*gpu:0 .*software" "$work/out"; then
    finish
    echo "the rest is skipped: gpu:0 is no software device"
    exit $((failed ? 1 : 0))
fi
# A layer that looks for wrong use of Vulkan; its complaints are in the answers.
export VK_INSTANCE_LAYERS=VK_LAYER_KHRONOS_validation
: >"$work/complaints"
complaints() { grep -h "Validation Error\|VUID-" "$work/out" >>"$work/complaints"; }

again software
expect 0 "Vulkan finds no graphics processor here (only software devices); see conurb doctor; the processor does" \
    "only software devices" "$conurb" run "$work/software" --device gpu
same_tile software processor "only software devices"

# By itself, the program takes hardware and leaves software alone. What city.yaml names comes before.
again chosen
expect 0 "found here; with --device cpu the processor does the work" "hardware, without --device" \
    with_loader CONURB_TEST_HARDWARE=1 "$conurb" train "$work/chosen"
complaints
says "training on " "hardware, without --device"
again yaml
sed -i 's/^train:/train:\n  device: cpu/' "$work/yaml/city.yaml"
expect 0 "device: the processor" "hardware, and train.device" \
    with_loader CONURB_TEST_HARDWARE=1 "$conurb" train "$work/yaml"
says_not "training on " "hardware, and train.device"
same_tile yaml processor "hardware, and train.device"
again auto
expect 0 "24 steps" "auto, with software only" "$conurb" train "$work/auto" --device auto
says_not "training on " "auto, with software only"
expect 0 "" "a command that does not compute" with_loader CONURB_TEST_HARDWARE=1 "$conurb" status "$work/yaml"
says_not "device" "a command that does not compute"

# The same device, chosen by its number.
again device
expect 0 "device: " "a software device that is asked for" "$conurb" run "$work/device" --device gpu:0
complaints
says "training on " "a software device that is asked for"
if cmp -s "$(tile device)" "$(tile processor)"; then bad "the device has not trained"; else good; fi
near "$(psnr device)" "$(psnr processor)" "held-out photos, the device and the processor"

again little
expect 0 "the processor trains it" "too little memory" with_loader CONURB_TEST_MB=8 \
    "$conurb" run "$work/little" --device gpu:0
complaints
says "has 0.008 GB of memory free, and tile " "too little memory"
says_before "the processor trains it" "train " "too little memory"
says_not "training on " "too little memory"
same_tile little processor "too little memory"

again lost
expect 0 "was lost; the processor trains tile " "a lost device" with_loader CONURB_TEST_LOSE=40 \
    "$conurb" run "$work/lost" --device gpu:0
complaints
says " from its last checkpoint on" "a lost device"
says "resumes at step" "a lost device"
near "$(psnr lost)" "$(psnr processor)" "held-out photos, a lost device"

# Memory that both see: none that the processor caches, and too little of it for the trainer's arrays.
again uncached
expect 0 "training on " "no cached memory" with_loader CONURB_TEST_UNCACHED=1 \
    "$conurb" train "$work/uncached" --device gpu:0
complaints
same_tile uncached device "no cached memory"
again unshared
expect 0 "has too little memory that it shares with the processor" "too little shared memory" \
    with_loader CONURB_TEST_MOST_KB=12000 "$conurb" train "$work/unshared" --device gpu:0
complaints
says_not "training on " "too little shared memory"

# The training takes 70 MB, its arrays 40 MB beside them: the photos have room in 140 MB.
again budget
expect 0 "training on " "a budget of memory" with_loader CONURB_TEST_BUDGET_KB=140000 \
    "$conurb" train "$work/budget" --device gpu:0
complaints
says_not "has no room for the photos" "a budget of memory"
same_tile budget device "a budget of memory"
again spent
expect 0 "has no room for the photos" "a budget that is spent" with_loader CONURB_TEST_BUDGET_KB=100000 \
    "$conurb" train "$work/spent" --device gpu:0
complaints

# kill -9 in the middle, and the rest on the other device. The scalar kernels leave time for it.
until_true() {
    local i
    for ((i = 0; i < 3000; i++)); do
        "$@" && return 0
        sleep 0.02
    done
    return 1
}
# has NAME FILE: the tile of the city has it.
has() { compgen -G "$work/$1/tiles/*/$2" >/dev/null; }
begun_or_gone() { has "$1" checkpoint.safetensors || [ ! -e "/proc/$2" ]; }
# killed NAME DEVICE: a run that is killed between its first checkpoint and its end.
killed() {
    local run
    again "$1"
    CONURB_CPU=ref "$conurb" train "$work/$1" --device "$2" >"$work/out" 2>&1 &
    run=$!
    until_true begun_or_gone "$1" "$run"
    kill -KILL "$run" 2>/dev/null
    wait "$run" 2>/dev/null
    complaints
    has "$1" checkpoint.safetensors && ! has "$1" DONE
}
# changes NAME FROM TO
changes() {
    local i
    # A busy machine may let a run end first.
    for ((i = 0; i < 5; i++)); do killed "$1" "$2" && break; done
    expect 0 "resumes at step" "$1: after the kill" env CONURB_CPU=ref "$conurb" train "$work/$1" --device "$3"
    complaints
    near "$(psnr "$1")" "$(psnr processor)" "$1: held-out photos"
    [ -z "$(find "$work/$1" -name '*.tmp-*' -o -name 'checkpoint*' -o -name 'good*')" ] && good || bad "$1: left-overs"
}
changes from-device gpu:0 cpu
changes from-processor cpu gpu:0

# Two devices train two tiles at once, and give the bytes that one gives.
three_tiles trio
sed -i 's/samples_per_step: 8192/samples_per_step: 4096/; s/steps: 24/steps: 12/
    s/^field:/field:\n  density_width: 16\n  colour_width: 16/' "$work/trio/city.yaml"
expect 0 "posed" "three tiles" "$conurb" poses "$work/trio"
expect 0 " MB on " "memory on a device" "$conurb" plan "$work/trio" --no-forecast --device gpu:0
cp -a "$work/trio" "$work/duo"
tiles() { (cd "$work/$1/tiles" && sha256sum ./*/tile.safetensors); }
expect 0 "12 steps" "three tiles on one device" "$conurb" train "$work/trio" --device gpu:0
expect 0 "12 steps" "three tiles on two devices" with_loader "CONURB_TEST_DEVICES=2 CONURB_TEST_HARDWARE=1" \
    "$conurb" train "$work/duo" --device gpu:all
complaints
[ "$(grep -c '^device: ' "$work/out")" = 2 ] && good || bad "gpu:all is not two devices"
[ "$(sed '/: 12 steps in/,$d' "$work/out" | grep -c '^training on ')" = 2 ] && good ||
    bad "not two tiles in training when the first is done"
tiles trio >"$work/trio.sums"
tiles duo >"$work/duo.sums"
[ "$(wc -l <"$work/trio.sums")" = 3 ] && cmp -s "$work/trio.sums" "$work/duo.sums" && good ||
    bad "two devices make other tiles than one"
rm -rf "$work/duo/tiles"
expect 0 "12 steps" "a device and the processor" "$conurb" train "$work/duo" --device cpu,gpu:0
[ "$(tiles duo | wc -l)" = 3 ] && good || bad "a device and the processor have not trained three tiles"
expect 2 "--device: there is no device ''" "a list" "$conurb" train "$work/duo" --device gpu:0,,
expect 0 "Vulkan finds no graphics processor here" "gpu:all without any" "$conurb" train "$work/duo" --device gpu:all

if [ -s "$work/complaints" ]; then
    cp "$work/complaints" "$work/out"
    bad "the validation layer complains"
else good; fi
finish
