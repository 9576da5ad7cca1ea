#!/usr/bin/env bash
# What effects that are off cost: the instructions of the same training steps by this source and by a copy that never
# had any effect but view dependence. usage: tests/bench/off.sh [STEPS]        needs valgrind, cmake, ninja and
# CONURB_DATA/fox; builds in a temporary folder
set -euo pipefail
steps=${1:-12}
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
fox=${CONURB_DATA:-$root/../shared/data}/fox
[ -f "$fox/transforms.json" ] || { echo "skipped: no fox photos under CONURB_DATA"; exit 77; }
command -v valgrind >/dev/null || { echo "skipped: valgrind is not installed"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

mkdir "$work/with" "$work/never"
git -C "$root" archive HEAD | tar -x -C "$work/with"
cp -r "$work/with/." "$work/never"
for effect in appearance sky exposure transient pose_refinement; do
    sed -i "/cn_effect_$effect;/d; /&cn_effect_$effect,/d" "$work/never/src/effect/registry.c"
    sed -i "s/\b$effect\.c\b//" "$work/never/src/effect/CMakeLists.txt"
done
# Evidence of effects that are not there has no use.
declare -A count
for kind in with never; do
    cmake -S "$work/$kind" -B "$work/$kind/build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCONURB_TESTS=OFF >/dev/null
    cmake --build "$work/$kind/build" >/dev/null
    conurb=$work/$kind/build/src/app/conurb city=$work/city-$kind
    "$conurb" init "$city" --photos "$fox" --import "$fox/transforms.json" --width 64 2>/dev/null
    sed -i "s/^train:/train:\n  steps: $steps\n  samples_per_step: 8192/; s/^field:.*/field:\n  log2_table: 12/" \
        "$city/city.yaml"
    "$conurb" poses "$city" 2>/dev/null
    "$conurb" plan "$city" --no-forecast 2>/dev/null
    valgrind --tool=callgrind --callgrind-out-file="$work/$kind.out" --toggle-collect=cn_trainer_step \
        --separate-threads=no \
        "$conurb" train "$city" --threads 1 >"$work/$kind.log" 2>&1 || { cat "$work/$kind.log"; exit 1; }
    count[$kind]=$(awk '/^(summary|totals):/ { print $2; exit }' "$work/$kind.out")
    echo "$kind the effects in the source, all off: ${count[$kind]} instructions in $steps steps"
done
awk -v a="${count[with]}" -v b="${count[never]}" \
    'BEGIN { d = 100 * (a - b) / b; printf "difference %+.3f %%\n", d; exit !(d < 0.5 && d > -0.5) }'
