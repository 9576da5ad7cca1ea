#!/usr/bin/env bash
# Peak memory of training one tile from 18 photos and from 400 (the fox photos again under other names): within 10 %.
# usage: tests/bench/memory.sh CONURB        needs python3 and CONURB_DATA/fox
set -euo pipefail
conurb=$1
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
fox=${CONURB_DATA:-$root/../shared/data}/fox
[ -f "$fox/transforms.json" ] || { echo "skipped: no fox photos under CONURB_DATA"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

python3 - "$fox" "$work" <<'PY'
import json, os, sys
fox, work = sys.argv[1:]
root = json.load(open(fox + "/transforms.json"))
frames = [f for f in root["frames"] if os.path.exists(os.path.join(fox, f["file_path"]))]
for n in (18, 400):
    out = f"{work}/photos{n}"
    os.makedirs(out)
    made = dict(root, frames=[])
    for i in range(n):
        f = frames[i % len(frames)]
        # A byte after the end of the JPEG makes it another file: copies with the same bytes are left out as duplicates.
        data = open(os.path.join(fox, f["file_path"]), "rb").read() + b"x" * (i // len(frames))
        open(f"{out}/{i:03}.jpg", "wb").write(data)
        made["frames"].append(dict(f, file_path=f"{i:03}.jpg"))
    json.dump(made, open(out + "/transforms.json", "w"))
PY

declare -A peak
for n in 18 400; do
    city=$work/city$n
    "$conurb" init "$city" --photos "$work/photos$n" --import "$work/photos$n/transforms.json" --width 270 2>/dev/null
    sed -i 's/^train:/train:\n  steps: 300/' "$city/city.yaml"
    "$conurb" poses "$city" 2>/dev/null
    "$conurb" plan "$city" --no-forecast 2>/dev/null
    peak[$n]=$(python3 - "$conurb" train "$city" <<'PY'
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stderr=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
PY
)
    echo "$n photos: peak memory ${peak[$n]} KiB"
done
awk -v a="${peak[18]}" -v b="${peak[400]}" \
    'BEGIN { d = 100 * (b - a) / a; printf "difference %.1f %%\n", d; exit !(d < 10 && d > -10) }'
