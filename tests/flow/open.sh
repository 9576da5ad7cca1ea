#!/usr/bin/env bash
# Exports of the trained city in tiles/demo, opened by programs that are not ours. A program that this machine lacks
# makes the test a skip.
# open.sh CONURB MAKE_PHOTOS DEMO FORMAT
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
here=$(dirname "${BASH_SOURCE[0]}")
demo=$3
format=$4
light=run0-clear_street_0006.jpg
cp -r "$demo" "$work/demo"

# need PROGRAM...: skips when one is not there.
need() {
    for program in "$@"; do
        command -v "$program" >/dev/null || { echo "skipped: $program is not installed"; exit 77; }
    done
}

# need_node PACKAGE...: skips when npm lacks one.
need_node() {
    need node npm
    NODE_PATH=${CONURB_NODE_MODULES:-$(npm root -g 2>/dev/null)}
    export NODE_PATH
    for package in "$@"; do
        node -e "require.resolve('$package')" 2>/dev/null ||
            { echo "skipped: the npm package $package is not installed (npm install -g $package)"; exit 77; }
    done
}

# The same points as LAS and as PLY; PROJ's own topocentric coordinates say where those of the PLY lie.
open_las() {
    need_node copc
    need gdaltransform python3
    for ending in las ply; do
        expect 0 "points" "points as $ending" "$conurb" export "$work/demo" --points "$work/p.$ending" --gsd 0.5 \
            --appearance "$light"
    done
    node "$here/las.js" "$work/p.las" >"$work/las.txt" || bad "the reader of LAS gave up"
    grep -q "WKT .*UTM zone 32N" "$work/las.txt" && good || bad "no coordinate system in the LAS file"
    grep -q "light: $light" "$work/las.txt" && good || bad "no light in the LAS file"
    python3 "$here/las.py" "$work/p.ply" "$work/p.frame.json" "$work/las.txt" >"$work/out" && good ||
        bad "points of the LAS file are elsewhere"
    cat "$work/out"
    cp "$work/p.las" "$work/before.las"
    expect 6 "cannot write" "LAS on a disk that is full" \
        bash -c "ulimit -f 100; trap '' XFSZ; exec '$conurb' export '$work/demo' --points '$work/p.las' --gsd 0.5"
    cmp -s "$work/p.las" "$work/before.las" && [ "$(find "$work" -maxdepth 1 -name '.p*' | wc -l)" = 0 ] && good ||
        bad "a failed export changed the file or left another"
}

# valid FILE: the Khronos validator finds neither an error nor a warning.
valid() {
    node -e 'require("gltf-validator").validateBytes(new Uint8Array(require("fs").readFileSync(process.argv[1])),
        { maxIssues: 20 }).then(r => {
            r.issues.messages.forEach(m => console.log(m.code, m.message, m.pointer))
            process.exit(r.issues.numErrors + r.issues.numWarnings ? 1 : 0)
        })' "$1" >"$work/out" && good || bad "the glTF validator does not like $1"
}

# A flight's cameras in Blender, and what a render makes of them.
open_camera() {
    need blender
    need_node gltf-validator
    cat >"$work/flight.json" <<'JSON'
{"fps": 24, "keyframes": [
    {"time_s": 0, "local": [30, -12.5, 60], "heading_deg": 90, "pitch_deg": -30, "roll_deg": 10, "vfov_deg": 45},
    {"time_s": 1, "local": [-40.25, 20, 40], "heading_deg": 300, "pitch_deg": -90, "vfov_deg": 60}]}
JSON
    for ending in chan glb; do
        expect 0 "25 frames" "a camera as $ending" "$conurb" export "$work/demo" --path "$work/flight.json" \
            --camera "$work/flight.$ending"
        expect 0 "25 frames" "the camera of the $ending" "$conurb" export "$work/demo" --path "$work/flight.$ending" \
            --camera "$work/$ending.chan"
    done
    cmp -s "$work/flight.chan" "$work/chan.chan" && good || bad "a .chan changes on the way through"
    valid "$work/flight.glb"
    blender -b --factory-startup --python-exit-code 1 -P "$here/camera.py" -- "$work/flight.glb" "$work/flight.chan" \
        >"$work/out" 2>&1 && good || bad "Blender has other cameras"
    grep "Blender has" "$work/out"
    for path in flight.json flight.chan flight.glb; do
        expect 0 "2 frames" "a render along $path" "$conurb" render "$work/demo" --path "$work/$path" --frames 2 \
            --width 64 --aov depth --out "$work/r-$path"
    done
    cmp -s "$work/r-flight.json/00001.png" "$work/r-flight.chan/00001.png" && good || bad "another picture by .chan"
    for name in depth.Z A R; do
        oiiotool --info -v "$work/r-flight.glb/00001.exr" | grep -q "channel list:.*$name" && good ||
            bad "the flight's EXR lacks $name"
    done
    expect 0 "1 frames" "every channel of a frame" "$conurb" render "$work/demo" --path "$work/flight.json" --frames 1 \
        --width 64 --aov depth,normal,opacity,ambient_occlusion,coverage --out "$work/layers"
    expect 0 "Combined Alpha Depth ambient_occlusion coverage depth normal opacity" "layers in Blender" \
        blender -b --factory-startup --python-exit-code 1 --python-expr "import bpy
scene = bpy.context.scene
scene.use_nodes = True
node = scene.node_tree.nodes.new('CompositorNodeImage')
node.image = bpy.data.images.load('$work/layers/00000.exr')
print(*(o.name for o in node.outputs))"
    head -c 300 "$work/flight.glb" >"$work/cut.glb"
    echo "1 2 3" >"$work/short.chan"
    expect 5 "cut off" "a .glb that is cut off" "$conurb" render "$work/demo" --path "$work/cut.glb"
    expect 5 "line 1: a camera's line has 8 numbers" "a .chan of three columns" \
        "$conurb" render "$work/demo" --path "$work/short.chan"
    expect 2 ".chan or .glb" "a camera of an unknown kind" "$conurb" export "$work/demo" --camera "$work/f.fbx"
}

# A folder for QGIS, in QGIS without a screen.
open_qgis() {
    QT_QPA_PLATFORM=offscreen /usr/bin/python3 -c 'import qgis.core' 2>/dev/null ||
        { echo "skipped: QGIS's module for Python is not installed (python3-qgis)"; exit 77; }
    expect 0 "city.qgs" "a project for QGIS" "$conurb" export "$work/demo" --qgis "$work/q" --gsd 0.25 \
        --appearance "$light"
    mv "$work/q" "$work/moved" # paths are relative
    XDG_RUNTIME_DIR=$work HOME=$work QT_QPA_PLATFORM=offscreen /usr/bin/python3 "$here/qgis_project.py" \
        "$work/moved/city.qgs" "$demo/frame.json" "${CONURB_PICTURES:-$work}/qgis.png" 96 3 run0 32632 \
        >"$work/out" 2>&1 && good || bad "QGIS does not open the project"
    grep "QGIS opens" "$work/out"
    expect 6 "/proc/none" "a folder that cannot be" "$conurb" export "$work/demo" --qgis /proc/none/q --gsd 0.5
    sed -i 's/"georeferenced": true/"georeferenced": false/' "$work/demo/frame.json"
    expect 4 "no GPS" "a project without a place on Earth" "$conurb" export "$work/demo" --qgis "$work/q" --gsd 0.5
    [ ! -e "$work/q" ] && good || bad "a refused export left a folder"
}

# The textured tiles in CesiumJS, where npm and Chromium are there.
open_cesium() {
    local cesium=$NODE_PATH/cesium/Build/Cesium
    if [ ! -e "$cesium/Cesium.js" ] || ! command -v chromium >/dev/null; then
        echo "CesiumJS: not tried, the npm package cesium or Chromium is not installed"
        return
    fi
    expect 0 "CesiumJS shows" "textured 3D Tiles in CesiumJS" python3 "$here/cesium.py" "$work/x" \
        "$cesium" "$work/demo/frame.json" "${CONURB_PICTURES:-$work}/cesium.png"
    cat "$work/out"
    expect 0 "3D Tiles" "3D Tiles of splats" "$conurb" export "$work/demo" --3dtiles "$work/g" --content spz \
        --budget 4000 --minutes 0.1 --appearance "$light"
    expect 0 "CesiumJS shows" "3D Tiles of splats in CesiumJS" python3 "$here/cesium.py" "$work/g" "$cesium" \
        "$work/demo/frame.json" "${CONURB_PICTURES:-$work}/cesium-splats.png" splats
    cat "$work/out"
}

# The mesh as 3D Tiles: each GLB by the Khronos validator, the tree by 3d-tiles-tools, places by PROJ, a tile by assimp.
open_3dtiles() {
    need_node gltf-validator 3d-tiles-tools
    need gdaltransform assimp python3
    expect 0 "3D Tiles" "3D Tiles" "$conurb" export "$work/demo" --3dtiles "$work/t" --gsd 0.55 \
        --appearance "$light"
    triangles=$(sed -n 's/.*vertices, \([0-9]*\) triangles.*/\1/p' "$work/out")
    for file in "$work"/t/*.glb; do valid "$file"; done
    python3 "$here/tileset.py" "$work/t" "$work/demo/frame.json" "$triangles" >"$work/out" 2>&1 && good ||
        bad "the tree of tiles"
    cat "$work/out"
    tools=$(dirname "$(node -p 'require.resolve("3d-tiles-tools")')")/cli/main.js
    [ -e "$tools" ] || tools=$(command -v 3d-tiles-tools)
    node "$tools" convert -i "$work/t/tileset.json" -o "$work/t.3tz" >"$work/out" 2>&1
    packed=$(python3 -m zipfile -l "$work/t.3tz" 2>/dev/null | grep -c '\.glb ')
    [ "$packed" -gt 1 ] && [ "$packed" = "$(ls "$work"/t/*.glb | wc -l)" ] && good ||
        bad "3d-tiles-tools does not take the tiles: $packed of them"
    assimp info "$work/t/0-0-0.glb" >"$work/out" 2>&1 && grep -q "Meshes: *1" "$work/out" && good ||
        bad "assimp does not open a tile"
    expect 6 "/proc/none" "a folder that cannot be" "$conurb" export "$work/demo" --3dtiles /proc/none/t --gsd 0.5
    expect 0 "3D Tiles" "textured 3D Tiles" "$conurb" export "$work/demo" --3dtiles "$work/x" --gsd 0.55 \
        --texture 64 --appearance "$light"
    for file in "$work"/x/*.glb; do valid "$file"; done
    python3 "$here/tileset.py" "$work/x" "$work/demo/frame.json" "$triangles" "$work/t" >"$work/out" 2>&1 && good ||
        bad "the tree of textured tiles"
    cat "$work/out"
    open_cesium
    cp "$work/t/tileset.json" "$work/before.json"
    expect 6 "cannot write" "3D Tiles on a disk that is full" bash -c "ulimit -f 100; trap '' XFSZ
        exec '$conurb' export '$work/demo' --3dtiles '$work/t' --gsd 0.8"
    cmp -s "$work/t/tileset.json" "$work/before.json" && good || bad "a failed export changed the tileset"
}

# One place in every export.
open_position() {
    need gdaltransform gdalinfo gdallocationinfo python3
    expect 0 "triangles" "every export" "$conurb" export "$work/demo" --mesh "$work/m.glb" --3dtiles "$work/t" \
        --points "$work/p.las" --ortho "$work/o.tif" --gsd 2
    expect 0 "points" "points as PLY" "$conurb" export "$work/demo" --points "$work/p.ply" --gsd 2
    expect 0 "places agree" "a place in every export" python3 "$here/position.py" "$work" "$work/demo"
    cat "$work/out"
}

# The mesh with textures: the Khronos validator, assimp, Blender; a disk that is full.
open_mesh() {
    need_node gltf-validator
    need assimp blender
    for ending in glb obj; do
        expect 0 "textures: 1 of" "a textured mesh as $ending" "$conurb" export "$work/demo" --mesh "$work/m.$ending" \
            --gsd 1 --texture 1024 --texels 4 --triangles 1500 --appearance "$light"
        assimp info "$work/m.$ending" >"$work/out" 2>&1 && grep -q "Textures (embed.): *[01]" "$work/out" && good ||
            bad "assimp does not open the $ending"
        expect 0 "Blender has" "Blender opens the $ending" blender -b --factory-startup --python-exit-code 1 \
            -P "$here/mesh.py" -- "$work/m.$ending" "${CONURB_PICTURES:-$work}/mesh-$ending.png"
        grep "Blender has" "$work/out"
    done
    valid "$work/m.glb"
    [ -s "$work/m.mtl" ] && [ -s "$work/m-1.jpg" ] && good || bad "the OBJ has no material"
    cp "$work/m.obj" "$work/before.obj"
    cp "$work/m-1.jpg" "$work/before.jpg"
    expect 6 "cannot write" "a textured mesh on a disk that is full" bash -c "ulimit -f 100; trap '' XFSZ
        exec '$conurb' export '$work/demo' --mesh '$work/m.obj' --gsd 1.2 --texture 1024"
    cmp -s "$work/m.obj" "$work/before.obj" && cmp -s "$work/m-1.jpg" "$work/before.jpg" &&
        [ "$(find "$work" -maxdepth 1 -name '.m*' | wc -l)" = 0 ] && good ||
        bad "a failed export changed a file or left another"
    expect 2 "PLY has no textures" "a textured PLY" "$conurb" export "$work/demo" --mesh "$work/m.ply" --texture 512
    expect 2 "64 to 16384" "a texture of 7 texels" "$conurb" export "$work/demo" --mesh "$work/m.glb" --texture 7
    expect 2 "give --mesh" "textures of no mesh" "$conurb" export "$work/demo" --texture 512
}

# Splats in Spark (three.js), beside the field's own render of the view.
open_splats() {
    need_node three @sparkjsdev/spark
    need python3 chromium oiiotool
    cat >"$work/view.json" <<'JSON'
{"keyframes": [{"time_s": 0, "local": [0, -45, 40], "heading_deg": 0, "pitch_deg": -40, "vfov_deg": 50},
    {"time_s": 1, "local": [0, -45, 40], "heading_deg": 0, "pitch_deg": -40, "vfov_deg": 50}]}
JSON
    expect 0 "1 frames" "the view by the field" "$conurb" render "$work/demo" --path "$work/view.json" --frames 1 \
        --width 320 --appearance "$light" --out "$work/view"
    for ending in spz ply; do
        expect 0 "splats of degree 0" "splats as $ending" "$conurb" export "$work/demo" --splats "$work/s.$ending" \
            --budget 4000 --minutes 0.1 --appearance "$light"
        expect 0 "Spark shows" "the viewer" python3 "$here/splats.py" "$work/s.$ending" "$NODE_PATH" "$work/s.png"
        cat "$work/out"
        # Small pictures of what the photos show, so that where things are counts and not how sharp they are.
        for name in view/00000 s; do
            oiiotool "$work/$name.png" --ch R,G,B --cut 320x140+0+74 --resize 32x14 -o "$work/small-${name%%/*}.png"
        done
        psnr=$(oiiotool --diff "$work/small-view.png" "$work/small-s.png" | sed -n 's/.*Peak SNR = //p')
        echo "$ending: $psnr dB to the field's render, 32 pixels wide"
        awk -v psnr="${psnr:-0}" 'BEGIN { exit !(psnr > 16) }' && good || bad "the viewer shows something else"
    done
}

"open_$format"
finish
