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
finish
