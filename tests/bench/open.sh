#!/usr/bin/env bash
# Every export of a trained city of real photos, opened by programs that are not ours: what each finds, and pictures of
# what it shows, in OUT. The view is from a photo's place to the middle of a tile. Wants the npm packages that
# CONTRIBUTING.md names (CONURB_NODE_MODULES), Chromium, Blender, QGIS's module for Python, GDAL and assimp. OUT keeps
# what is there, so a second run goes on after the last export.
# usage: tests/bench/open.sh CONURB CITY OUT [SPLATS]
set -euo pipefail
conurb=$1
city=$2
out=$3
budget=${4:-1000000}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
flow=$here/../flow
export NODE_PATH=${CONURB_NODE_MODULES:-$(npm root -g)}
mkdir -p "$out"

# make FILE ARGUMENT...: an export, unless it is there; its last lines.
make() {
    local file=$1
    shift
    if [ -e "$out/$file" ]; then
        echo "export $*: there already"
        return
    fi
    TIMEFORMAT="    %R s by the clock, %U s of processor time"
    echo "export $*"
    time "$conurb" export "$city" "$@" 2>&1 | tr '\r' '\n' | grep -v '^export' | tail -n 4 | sed 's/^/    /'
}
valid() {
    node -e 'require("gltf-validator").validateBytes(new Uint8Array(require("fs").readFileSync(process.argv[1])),
        { maxIssues: 20 }).then(r => {
            r.issues.messages.forEach(m => console.log("   ", m.code, m.message, m.pointer))
            console.log("    glTF validator:", r.issues.numErrors, "errors,", r.issues.numWarnings, "warnings,",
                process.argv[1])
        })' "$1"
}
report() { sed 's/^/    /'; }

# A path that stands at the place of the photo in the middle of the list.
python3 - "$city" >"$out/view.json" <<'PYTHON'
import json, math, sys
city = sys.argv[1]
photos = json.load(open(city + "/poses/report.json"))["photos"]
eye, at = photos[len(photos) // 2]["centre_m"], json.load(open(city + "/plan/plan.json"))["tiles"][0]["centre"]
away = [b - a for a, b in zip(eye, at)]
key = {"local": eye, "heading_deg": math.degrees(math.atan2(away[0], away[1])) % 360,
       "pitch_deg": math.degrees(math.atan2(away[2], math.hypot(*away[:2]))), "vfov_deg": 50}
print(json.dumps({"fps": 1, "keyframes": [{"time_s": 0, **key}, {"time_s": 1, **key}]}))
PYTHON
frame=$city/frame.json
make splats.ply --splats "$out/splats.ply" --budget "$budget"
[ -e "$out/field/00000.png" ] ||
    "$conurb" render "$city" --path "$out/view.json" --frames 1 --width 320 --out "$out/field" >"$out/render.log" 2>&1
height=$(oiiotool "$out/field/00000.png" --echo "{TOP.height}")
lower=320x$((height * 2 / 3))+0+$((height / 3))
python3 "$flow/splats.py" "$out/splats.ply" "$NODE_PATH" "$out/spark.png" "$out/view.json" "$height" | report
# Without the upper third: where no photo shows the sky, there are no splats.
for name in field/00000 spark; do
    oiiotool "$out/$name.png" --ch R,G,B --cut "$lower" -o "$out/lower-${name%%/*}.png"
done
oiiotool --diff "$out/lower-field.png" "$out/lower-spark.png" | grep SNR |
    sed "s/^/    to the field's own render:/" || true
make mesh.glb --mesh "$out/mesh.glb" --texture 4096
valid "$out/mesh.glb"
assimp info "$out/mesh.glb" | grep -E "^(Meshes|Vertices|Faces|Textures)" | report
blender -b --factory-startup --python-exit-code 1 -P "$flow/mesh.py" -- "$out/mesh.glb" "$out/blender.png" 2>/dev/null |
    grep "Blender has" | report
make mesh.obj --mesh "$out/mesh.obj" --texture 4096 --triangles 100000
assimp info "$out/mesh.obj" | grep -E "^(Meshes|Vertices|Faces)" | report
make tiles/tileset.json --3dtiles "$out/tiles" --texture 512
for file in "$out"/tiles/*.glb; do valid "$file"; done | grep -c " 0 errors, 0 warnings" |
    sed "s/^/    glTF validator: tiles without a word: /"
python3 "$flow/cesium.py" "$out/tiles" "$NODE_PATH/cesium/Build/Cesium" "$frame" "$out/cesium.png" | report
make gaussians/tileset.json --3dtiles "$out/gaussians" --content spz --from "$out/splats.ply"
python3 "$flow/cesium.py" "$out/gaussians" "$NODE_PATH/cesium/Build/Cesium" "$frame" "$out/cesium-splats.png" splats |
    report
lights=$(python3 -c 'import json, sys
names = [p["name"] for p in json.load(open(sys.argv[1]))["photos"]]
print(f"first={names[0]},last={names[-1]}")' "$city/poses/report.json")
make page/live.html --page "$out/page" --live --from "$out/splats.ply" --lights "$lights"
python3 "$here/page.py" "$out/page" "$out/page" | report
make camera.glb --path "$out/view.json" --camera "$out/camera.glb"
valid "$out/camera.glb"
[ -e "$out/layers/00000.exr" ] ||
    "$conurb" render "$city" --path "$out/camera.glb" --frames 1 --width 320 --out "$out/layers" \
        --aov depth,normal,opacity,ambient_occlusion,coverage >"$out/layers.log" 2>&1
oiiotool --info -v "$out/layers/00000.exr" | sed -n 's/ *channel list: /the EXR has /p' | report
make points.las --points "$out/points.las"
node "$flow/las.js" "$out/points.las" | awk '/^#/ { n++ } END { print "    copc reads " NR - n " points" }'
make qgis/city.qgs --qgis "$out/qgis"
gdalinfo "$out/qgis/ortho.tif" | grep -E "^(Size is|Pixel Size)" | report
photos=$(python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["registered"])' "$city/poses/report.json")
tiles=$(python3 -c 'import json, sys; print(len(json.load(open(sys.argv[1]))["tiles"]))' "$city/plan/plan.json")
epsg=$(gdalsrsinfo -o epsg "$out/qgis/ortho.tif" | sed -n 's/^EPSG://p')
QT_QPA_PLATFORM=offscreen /usr/bin/python3 "$flow/qgis_project.py" "$out/qgis/city.qgs" "$frame" "$out/qgis.png" \
    "$photos" "$tiles" mean "$epsg" 2>"$out/qgis.log" | report || { tail -n 1 "$out/qgis.log" >&2; exit 1; }
