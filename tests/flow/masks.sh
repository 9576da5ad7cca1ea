#!/usr/bin/env bash
# A mask that is painted anew reaches the training; and two processes do not build one pixel store.
# usage: masks.sh CONURB MAKE_PHOTOS
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"

# mask WHITE FILE [WIDTH HEIGHT]: a grey PNG of 2 x 2 pixels, white in its first WHITE rows and black below.
mask() {
    python3 - "$1" "$2" "${3:-2}" "${4:-2}" <<'PY'
import struct, sys, zlib
width, height = int(sys.argv[3]), int(sys.argv[4])
def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
rows = b"".join(b"\0" + (b"\xff" if y < int(sys.argv[1]) else b"\0") * width for y in range(height))
open(sys.argv[2], "wb").write(b"\x89PNG\r\n\x1a\n" +
                              chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)) +
                              chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
PY
}

city town 8 all
town=$work/town
sed -i 's/steps: 40/steps: 4/' "$town/city.yaml"
photo=$(find "$town-photos" -maxdepth 1 -type f ! -name '*.json' | sort | head -n 1)
mkdir "$town-photos/masks"
mask=$town-photos/masks/$(basename "$photo").png
mask 1 "$mask"
expect 0 "" "poses" "$conurb" poses "$town"
expect 0 "tile" "a plan with a mask" "$conurb" plan "$town" --no-forecast
expect 0 "" "training" "$conurb" train "$town"
expect 0 "the plan is done" "the same mask" "$conurb" plan "$town" --no-forecast
stamps() { cat "$town"/tiles/*/DONE; }
before=$(stamps)
mask 2 "$mask"
expect 4 "run \`conurb plan" "training alone does not take the old mask's pixels" "$conurb" train "$town"
expect 0 "the masks" "a dry run names what changed" "$conurb" run "$town" --dry-run
expect 0 "tile" "a plan by the new mask" "$conurb" plan "$town" --no-forecast
expect 0 "" "training by the new mask" "$conurb" train "$town"
[ "$before" != "$(stamps)" ] && good || bad "tiles stayed as they were trained by the old mask"
expect 0 "the plan is done" "the new mask" "$conurb" plan "$town" --no-forecast

sed -i 's/width_px: 48 /width_px: 40 /' "$town/city.yaml"
expect 4 "at the width in city.yaml" "training alone does not take pixels of another width" "$conurb" train "$town"
sed -i 's/width_px: 40 /width_px: 48 /' "$town/city.yaml"
expect 0 "is done" "the width of the pixels" "$conurb" train "$town"

# The plan is done, and its store is not there: another process that holds the plan's lock may be making it.
rm "$town/pixels.bin"
touch "$town/plan/LOCK"
expect 10 "" "a store that another process makes" python3 - "$conurb" "$town" <<'PY'
import fcntl, subprocess, sys
lock = open(sys.argv[2] + "/plan/LOCK", "r+")
fcntl.lockf(lock, fcntl.LOCK_EX)
sys.exit(subprocess.call([sys.argv[1], "plan", sys.argv[2], "--no-forecast"]))
PY
[ ! -e "$town/pixels.bin" ] && good || bad "the store was built without the lock"
expect 0 "the plan is done" "the store is made again" "$conurb" plan "$town" --no-forecast
[ -s "$town/pixels.bin" ] && good || bad "no store"
[ ! -e "$town/plan/LOCK" ] && good || bad "a lock is left"

# Renders of photos that are black all over are equal to them: their score is the highest one, a number.
city night 8 all
for jpeg in "$work"/night-photos/*.jpg; do
    mask 0 "${jpeg%.jpg}.png" 48 36
    echo "$jpeg" >>"${jpeg%.jpg}.png" # no two files alike
    rm "$jpeg"
done
sed -i 's/\.jpg/.png/' "$work/night-photos/transforms.json"
expect 0 "of one colour all over, such as black or white: 8 of 8" "black photos" "$conurb" run "$work/night"
grep -Eq 'mean of held-out photos +150\.00 dB' "$work/out" && good || bad "scores of black photos"
finish
