#!/usr/bin/env bash
# Exports for GIS, and flights over the ground.
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"

# has TEXT FILE: GeoTIFFs hold their layout and the name of their CRS as text.
has() { grep -qa -- "$1" "$2"; }

# ground NAME: a city that is trained long enough to have a ground surface.
ground() { sed -i 's/steps: 40/steps: 400/' "$work/$1/city.yaml"; }

city town 17 all
ground town
for command in poses plan; do expect 0 "" "$command" "$conurb" "$command" "$work/town"; done
expect 4 "conurb train" "export before training" "$conurb" export "$work/town"
expect 0 "" "train" "$conurb" train "$work/town"
expect 0 "EPSG:32632" "export" "$conurb" export "$work/town" --gsd 0.2
for file in ortho.tif dsm.tif points.ply points.frame.json; do
    [ -s "$work/town/export/$file" ] && good || bad "export/$file is missing"
done
for file in ortho.tif dsm.tif; do
    has "LAYOUT=IFDS_BEFORE_DATA" "$work/town/export/$file" && good || bad "$file is not cloud-optimised"
    has "UTM zone 32N" "$work/town/export/$file" && good || bad "$file does not name its zone"
done
before=$(digest "$work/town/export")
expect 0 "" "export again" "$conurb" export "$work/town" --gsd 0.2
[ "$before" = "$(digest "$work/town/export")" ] && good || bad "the same export gave other bytes"
expect 0 "orthophoto" "an orthophoto alone" "$conurb" export "$work/town" --gsd 0.3 --ortho "$work/o.tif"
expect 0 "ground model" "a ground model alone" "$conurb" export "$work/town" --gsd 0.3 --dtm "$work/g.tif"
has "LAYOUT=IFDS_BEFORE_DATA" "$work/g.tif" && [ ! -e "$work/.g"* ] && good || bad "the ground model"
expect 6 "nowhere" "a ground model nowhere" "$conurb" export "$work/town" --gsd 0.3 --dtm "$work/nowhere/g.tif"
expect 3 "view" "a view that is not there" "$conurb" export "$work/town" --ortho "$work/x.tif" --view Technicolor
expect 2 "--gsd" "pixels too small" "$conurb" export "$work/town" --ortho "$work/x.tif" --gsd 0.00001
expect 6 "nowhere" "a folder that is not there" "$conurb" export "$work/town" --gsd 0.3 --dsm "$work/nowhere/x.tif"
expect 0 "triangles" "a mesh" "$conurb" export "$work/town" --mesh "$work/m.glb" --gsd 0.05
[ "$(head -c 4 "$work/m.glb")" = glTF ] && has '"latitude_deg":47.3' "$work/m.glb" && good || bad "the glTF's head"
[ -s "$work/m.frame.json" ] && good || bad "m.frame.json is missing"
expect 0 "triangles" "a mesh as PLY" "$conurb" export "$work/town" --mesh "$work/m.ply" --gsd 0.05
expect 0 "more than the 4 asked for" "a mesh of too few triangles" "$conurb" export "$work/town" \
    --mesh "$work/few.ply" --gsd 0.05 --triangles 4
expect 0 "Chamfer distance 0.000 m" "a mesh against itself" \
    "$conurb" eval "$work/town" --geometry "$work/m.ply" --gsd 0.05
# Figures of the surface are by Conurb's own OpenColorIO config: the user's lacks the view that the city asks for.
sed 's/{name: sRGB, view_transform/{name: Film, view_transform/; s/^active_views: .*/active_views: [Film, ACES, Raw]/' \
    "$(dirname "${BASH_SOURCE[0]}")/../../src/colour/config.ocio" >"$work/film.ocio"
sed -i 's/^render:/render:\n  view: sRGB/' "$work/town/city.yaml"
expect 0 "Chamfer distance 0.000 m" "a mesh against itself, with another OpenColorIO config" \
    env OCIO="$work/film.ocio" "$conurb" eval "$work/town" --geometry "$work/m.ply" --gsd 0.05
[ -s "$work/town/eval/geometry.json" ] && good || bad "eval/geometry.json is missing"
# json CITY UNIT: `eval --geometry --json` prints the keys of geometry.json, with the unit of the city's lengths.
json() {
    "$conurb" eval "$work/$1" --geometry "$work/m.ply" --gsd 0.05 --depths field --json 2>"$work/out" |
        python3 -c 'import json, sys
fit, file = json.load(sys.stdin), json.load(open(sys.argv[1]))
assert fit.keys() == file.keys() and fit["unit"] == file["unit"] == sys.argv[2], fit' \
            "$work/$1/eval/geometry.json" "$2" 2>>"$work/out" && good || bad "eval --geometry --json of $1"
}
json town m
expect 2 "--geometry" "--gsd without a mesh" "$conurb" eval "$work/town" --gsd 0.3
expect 2 "--geometry" "--depths without a mesh" "$conurb" eval "$work/town" --depths field
expect 2 "--blend" "a mesh by a blending" "$conurb" eval "$work/town" --geometry points --blend all
expect 4 "sparse points" "no sparse points to compare with" "$conurb" eval "$work/town" --geometry points --gsd 0.05
expect 6 "nothing.ply" "a reference that is not there" "$conurb" eval "$work/town" --geometry "$work/nothing.ply"
expect 5 "not a PLY" "a reference that is no PLY" "$conurb" eval "$work/town" --geometry "$work/o.tif" --gsd 0.05
expect 2 ".glb" "a mesh of an unknown kind" "$conurb" export "$work/town" --mesh "$work/m.stl"
expect 6 "nowhere" "a mesh in a folder that is not there" "$conurb" export "$work/town" --mesh "$work/nowhere/m.ply"
[ ! -e "$work/x.tif" ] && good || bad "a failed export left a file"
# What is written last is checked before what is written first.
late() { expect "$1" "$2" "$3" "$conurb" export "$work/town" --ortho "$work/x.tif" --gsd 0.3 "${@:4}"; }
late 6 nowhere "an orthophoto, and a surface model nowhere" --dsm "$work/nowhere/d.tif"
late 6 nowhere "an orthophoto, and splats nowhere" --splats "$work/nowhere/s.ply"
late 6 /proc/none "an orthophoto, and tiles nowhere" --3dtiles /proc/none/t
late 2 .glb "an orthophoto, and a mesh of an unknown kind" --mesh "$work/m.stl"
late 2 "PLY has no textures" "an orthophoto, and a textured PLY" --mesh "$work/m.ply" --texture 64
late 2 .las "an orthophoto, and points of an unknown kind" --points "$work/p.laz"
late 2 .spz "an orthophoto, and splats of an unknown kind" --splats "$work/s.splat"
late 2 .chan "an orthophoto, and a camera of an unknown kind" --camera "$work/c.fbx"
late 2 "GeoTIFF ends with" "an orthophoto, and a surface model as PNG" --dsm "$work/d.png"
late 2 "two exports" "an orthophoto, and a surface model in the same file" --dsm "$work/x.tif"
late 2 "give --camera" "an orthophoto, and frames of no camera" --frames 10
[ ! -e "$work/x.tif" ] && good || bad "an export whose last file cannot be began with the first"

echo '{"type": "Point"}' >"$work/point.geojson"
cat >"$work/street.geojson" <<'JSON'
{"type": "Feature", "properties": {"height_m": 1.5, "speed_mps": 2, "fps": 4},
 "geometry": {"type": "LineString", "coordinates": [[8.54, 47.37], [8.54001, 47.37], [8.54001, 47.37001]]}}
JSON
expect 0 "film" "a street" "$conurb" render "$work/town" --path "$work/street.geojson"
[ -s "$work/town/renders/street/flight.mp4" ] && good || bad "the street's film is missing"
expect 0 "4 frames" "an orbit" "$conurb" render "$work/town" --orbit 47.37,8.54,3,2 --frames 4
expect 0 "5 frames" "the photos' order" "$conurb" render "$work/town" --path photos --frames 5
expect 5 "has 0" "a GeoJSON without a street" "$conurb" render "$work/town" --path "$work/point.geojson"
expect 2 "--orbit" "an orbit that is none" "$conurb" render "$work/town" --orbit 47.37,8.54
expect 2 "exclude" "an orbit and a path" "$conurb" render "$work/town" --orbit 47.37,8.54,3,2 --path photos

city village 17
ground village
for command in poses plan train; do expect 0 "" "$command without GPS" "$conurb" "$command" "$work/village"; done
expect 0 "no CRS" "export without GPS" "$conurb" export "$work/village" --gsd 0.3
expect 4 "no GPS" "a ground model without metres" "$conurb" export "$work/village" --gsd 0.3 --dtm "$work/v.tif"
has "UTM" "$work/village/export/dsm.tif" && bad "a city without GPS got a CRS" || good
json village units
expect 0 "distance in units" "lengths without GPS" "$conurb" eval "$work/village" --geometry "$work/m.ply" --gsd 0.05
expect 5 "no GPS" "a street without GPS" "$conurb" render "$work/village" --path "$work/street.geojson"
expect 0 "2 frames" "an orbit in local metres" "$conurb" render "$work/village" --orbit 0,0,3,2 --frames 2
finish
