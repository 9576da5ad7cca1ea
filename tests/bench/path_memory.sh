#!/usr/bin/env bash
# Peak memory of a flight over 16 tiles: no more than two tiles beside the cache of open ones, which is
# compose.max_tiles + 1.
# usage: tests/bench/path_memory.sh CONURB MAKE_PHOTOS        makes 16 large tiles of hardly any training in a temporary
# folder (0.6 GB)
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
. "$here/../flow/lib.sh"
max_tiles=4

city town 24 all
sed -i "s/^plan:/plan:\n  hold_out_every: 0\n  min_photos: 1\n  layout: centres\n  centres: centres.geojson/" \
    "$work/town/city.yaml"
sed -i "s/steps: 40/steps: 2/; s/log2_table: 12/log2_table: 19/; s/levels: 6/levels: 16/; 
    s/^compose:/compose:\n  max_tiles: $max_tiles\n  match: off/" "$work/town/city.yaml"
python3 - "$work/town" <<'PY'
import json, sys
# 2 m apart, in and around the photos' place.
step = 2 / 111195
places = [(8.54 + (i % 4 - 1.5) * step / 0.677, 47.37 + (i // 4 - 1.5) * step) for i in range(16)]
json.dump({"type": "FeatureCollection", "features": [
    {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": p}} for p in places]},
    open(sys.argv[1] + "/centres.geojson", "w"))
PY
"$conurb" poses "$work/town" 2>/dev/null
"$conurb" plan "$work/town" --no-forecast 2>/dev/null
"$conurb" train "$work/town" 2>/dev/null

# Paths: over every centre, row by row, and on one spot.
python3 - "$work/town" <<'PY'
import json, sys
town = sys.argv[1]
tiles = json.load(open(town + "/plan/plan.json"))["tiles"]
assert len(tiles) == 16, f"the plan has {len(tiles)} tiles, not 16"
def path(name, places):
    keys = [{"time_s": i, "local": [x, y, 6], "look_at": {"local": [x, y + 0.5, 0]}} for i, (x, y) in enumerate(places)]
    json.dump({"fps": 1, "keyframes": keys}, open(f"{town}/{name}.json", "w"))
places = sorted((round(t["centre"][1]), t["centre"]) for t in tiles)
path("all", [c[:2] for _, c in places])
path("one", [places[0][1][:2]] * 2)
PY
peak() {
    python3 - "$conurb" render "$@" <<'PY'
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stderr=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
PY
}
tile=$(stat -c %s "$work/town/tiles/"*/tile.safetensors | sort -n | tail -n 1)
all=$(peak "$work/town" --path "$work/town/all.json" --width 480)
one=$(peak "$work/town" --path "$work/town/one.json" --width 480 --blend nearest)
awk -v tile="$tile" -v one="$one" -v all="$all" -v cache="$((max_tiles + 1))" 'BEGIN {
    tile /= 1024 * 1024; one /= 1024; all /= 1024; rest = one - tile
    printf "a tile is %.1f MiB; a flight over one: peak %.1f MiB, so %.1f MiB without tiles\n", tile, one, rest
    printf "a flight over 16 tiles: peak %.1f MiB, %.2f tiles; the cache holds %d, and two more are allowed\n", all, \
        (all - rest) / tile, cache
    exit !(all - rest <= (cache + 2) * tile) }'
