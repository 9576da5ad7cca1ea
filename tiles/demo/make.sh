#!/usr/bin/env bash
# Makes this city again: photographs a synthetic city and trains small tiles of it. It keeps what a render reads, and
# deletes the photos.
# usage: tiles/demo/make.sh CONURB SYNTH [OUT]        OUT: by default this folder
# Only when the format of tiles changes for good: until then these tiles hold the program to opening what it wrote.
set -euo pipefail
here=$(realpath "$(dirname "${BASH_SOURCE[0]}")")
conurb=$(realpath "$1") synth=$(realpath "$2") out=$(realpath "${3:-$here}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

"$synth" made --seed 7 --photos 96 --size 60 --width 320 --height 214 --gps-noise 0 --empty
mkdir demo
cp -r made/photos demo/photos
cp "$here"/{city.yaml,centres.geojson} demo
# Every eighth sparse point says enough of what is near and far.
python3 - made/truth/model demo/truth <<'PY'
import os
import struct
import sys

source, target = sys.argv[1:]
os.makedirs(target)
open(f"{target}/cameras.bin", "wb").write(open(f"{source}/cameras.bin", "rb").read())
data, at, index, out = open(f"{source}/images.bin", "rb").read(), 8, {}, []
for _ in range(struct.unpack_from("<Q", data)[0]):
    (image,) = struct.unpack_from("<I", data, at)
    end = data.index(b"\0", at + 64) + 1
    (n,) = struct.unpack_from("<Q", data, end)
    seen = [struct.unpack_from("<ddq", data, end + 8 + 24 * i) for i in range(n)]
    kept = [i for i in range(n) if seen[i][2] >= 0 and seen[i][2] % 8 == 0]
    index.update({(image, old): new for new, old in enumerate(kept)})
    out.append(data[at:end] + struct.pack("<Q", len(kept)) + b"".join(struct.pack("<ddq", *seen[i]) for i in kept))
    at = end + 8 + 24 * n
open(f"{target}/images.bin", "wb").write(data[:8] + b"".join(out))
data, at, out = open(f"{source}/points3D.bin", "rb").read(), 8, []
for _ in range(struct.unpack_from("<Q", data)[0]):
    point, n = struct.unpack_from("<Q", data, at)[0], struct.unpack_from("<Q", data, at + 43)[0]
    track = [struct.unpack_from("<II", data, at + 51 + 8 * i) for i in range(n)]
    if point % 8 == 0:
        out.append(data[at:at + 51] + b"".join(struct.pack("<II", t[0], index[t]) for t in track))
    at += 51 + 8 * n
open(f"{target}/points3D.bin", "wb").write(struct.pack("<Q", len(out)) + b"".join(out))
PY
for stage in poses "plan --no-forecast" train; do "$conurb" $stage demo; done
# Renders step twice as finely as training did: streets seen from the air have no holes then, and few photos are from
# there.
python3 - demo/tiles/*/tile.safetensors <<'PY'
import re
import sys

for path in sys.argv[1:]:
    data = open(path, "rb").read()
    step = re.search(rb'\\"step\\":([0-9.]+)', data)
    digits = len(step[1]) - 2
    data = data[:step.start(1)] + b"%.*f" % (digits, float(step[1]) / 2) + data[step.end(1):]
    open(path, "wb").write(data)
PY
for stage in match "eval --json"; do "$conurb" $stage demo; done | cut -c 1-150
day=run0-clear_street_0006.jpg night=run3-night_street_0010.jpg view=run0-clear_air_0003.jpg
"$conurb" relight demo --photo "$view" --from "$day" --to "$night" --frames 2 --out lights

cd demo
mv ../lights/00000.png day.png
mv ../lights/00001.png night.png
find . -name '*.json' -exec sed -i "s|$PWD/||" {} + # where it was made is nobody's business
rm -rf photos truth pixels.bin eval plan/plan.svg plan/tiles.geojson tiles/*/log.jsonl
rm -rf "$out"/{day.png,night.png,frame.json,photos.json,plan,poses,tiles,match}
cp -r . "$out"
du -sh "$out"
