#!/usr/bin/env bash
# Training, validation and held-out photos are three lists without common photos.
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"

# trained CITY: number of photos that its tile was trained on.
trained() {
    python3 - "$work/$1"/tiles/*/tile.safetensors <<'PY'
import json, struct, sys
with open(sys.argv[1], "rb") as f:
    meta = json.loads(f.read(struct.unpack("<Q", f.read(8))[0]))["__metadata__"]
found = {}
for text in meta.values():
    try:
        value = json.loads(text)
    except ValueError:
        continue
    if isinstance(value, dict):
        found.update(value)
print(int(found["trained_photos"]))
PY
}

city plain 25 all
expect 0 "25 photos posed" "poses" "$conurb" poses "$work/plain"
expect 0 "tile" "plan" "$conurb" plan "$work/plain" --no-forecast
cp -r "$work/plain" "$work/stopped"
sed -i 's/^train:/train:\n  stop_gain_db: 0.1/' "$work/stopped/city.yaml"
expect 0 "steps" "train" "$conurb" train "$work/plain"
expect 0 "steps" "train with stop_gain_db" "$conurb" train "$work/stopped"
all=$(trained plain) some=$(trained stopped)
[ "$all" -gt 16 ] && good || bad "only $all photos train"
[ "$some" = $((all - all / 8)) ] && good || bad "of $all photos, $some train where an eighth should decide when to stop"
expect 0 "dB" "eval" "$conurb" eval "$work/stopped"

# A mask over the right half of a held-out photo: it has no score there, and the means are over the others.
mkdir "$work/plain-photos/masks"
python3 - "$work/stopped/eval/eval.json" "$work/plain-photos/masks" <<'PY'
import json, struct, sys, zlib
def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
name = json.load(open(sys.argv[1]))["photos"][0]["name"]
with open(f"{sys.argv[2]}/{name.rsplit('.', 1)[0]}.png", "wb") as file: # two pixels: white, black
    file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", 2, 1, 8, 0, 0, 0, 0)) +
               chunk(b"IDAT", zlib.compress(b"\0\xff\0")) + chunk(b"IEND", b""))
PY
rm -r "$work/plain/poses" "$work/plain/plan" "$work/plain/tiles" "$work/plain/pixels.bin"
expect 0 "tile" "run with a mask" "$conurb" run "$work/plain"
expect 0 "lack a score" "eval with a mask" "$conurb" eval "$work/plain"
python3 - "$work/plain/eval/eval.json" <<'PY' >"$work/out" 2>&1 && good || bad "the means count a photo without a score"
import json, sys
scores = json.load(open(sys.argv[1]))
halves = [p["half"]["psnr"] for p in scores["photos"]]
assert halves[0] is None and None not in halves[1:] and len(halves) > 2, halves
assert abs(scores["half"]["psnr"] - sum(halves[1:]) / (len(halves) - 1)) < 1e-9, scores["half"]
PY
finish
