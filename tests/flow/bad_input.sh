#!/usr/bin/env bash
# Bad input gives one clear line and the right exit code, and does not damage existing files.
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"

mkdir "$work/empty"
expect 0 "made" "init does not look at photos yet" "$conurb" init "$work/none" --photos "$work/empty"
expect 4 "no photos in" "no photos" "$conurb" poses "$work/none"
expect 4 "is not there" "photo folder that is missing" "$conurb" init "$work/x" --photos "$work/nowhere"
expect 2 "already is a city" "init twice" "$conurb" init "$work/none" --photos "$work/empty"
expect 2 "is not there" "a city that is missing" "$conurb" plan "$work/nocity"
expect 2 "no option" "unknown option" "$conurb" plan "$work/none" --colour
expect 2 "no command" "unknown command" "$conurb" fly

city nogps 9
expect 0 "no photo has GPS" "no GPS" "$conurb" poses "$work/nogps"
expect 4 "run \`conurb plan" "train before plan" "$conurb" train "$work/nogps"
city somegps 9 some
expect 0 "5 of 9 photos have GPS" "GPS on some photos" "$conurb" poses "$work/somegps"

rm "$work/nogps-photos/003.jpg"
expect 0 "003.jpg" "transforms.json names a photo that is gone" "$conurb" poses "$work/nogps"
head -c 900 "$work/nogps-photos/004.jpg" >"$work/cut" && mv "$work/cut" "$work/nogps-photos/004.jpg"
cp "$work/nogps-photos/005.jpg" "$work/nogps-photos/copy.jpg"
expect 0 "left out 004.jpg" "a truncated photo" "$conurb" poses "$work/nogps"
expect 0 "same bytes as 005.jpg" "a photo that is there twice" "$conurb" poses "$work/nogps"

for n in 1 2; do
    city "n$n" "$n" all
    expect 0 "" "$n photo(s): poses" "$conurb" poses "$work/n$n"
    expect 0 "warning" "$n photo(s): plan warns" "$conurb" plan "$work/n$n"
    expect 0 "" "$n photo(s): train" "$conurb" train "$work/n$n"
    expect 0 "frames in" "$n photo(s): render" "$conurb" render "$work/n$n"
done

city same 6
sed -i -E ':a;N;$!ba' "$work/same-photos/transforms.json"
python3 - "$work/same-photos/transforms.json" <<'PY'
import json, sys
root = json.load(open(sys.argv[1]))
for f in root["frames"]:
    f["transform_matrix"] = root["frames"][0]["transform_matrix"]
json.dump(root, open(sys.argv[1], "w"))
PY
expect 0 "" "all photos at one place: poses" "$conurb" poses "$work/same"
expect 0 "warning" "all photos at one place: plan warns" "$conurb" plan "$work/same"

# A photo without a pose: it exists, but the import lacks it.
city unposed 9
python3 - "$work/unposed-photos/transforms.json" <<'PY'
import json, sys
root = json.load(open(sys.argv[1]))
del root["frames"][4]
json.dump(root, open(sys.argv[1], "w"))
PY
expect 0 "004.jpg" "a photo without a pose is named" "$conurb" poses "$work/unposed"

# Faults in city.yaml: the message names the line, and existing files stay.
city yaml 9
"$conurb" poses "$work/yaml" >/dev/null 2>&1 && "$conurb" plan "$work/yaml" >/dev/null 2>&1
cp "$work/yaml/city.yaml" "$work/good.yaml"
line=$(($(grep -n '^plan:' "$work/good.yaml" | cut -d: -f1) + 1))
before=$(digest "$work/yaml/plan")
sed "s/^plan:/plan:\n  overlp: 0.4/" "$work/good.yaml" >"$work/yaml/city.yaml"
expect 3 "overlp" "unknown key" "$conurb" plan "$work/yaml"
expect 3 "city.yaml:$line:" "unknown key: its line" "$conurb" plan "$work/yaml"
sed "s/^plan:/plan:\n  overlap: [much]/" "$work/good.yaml" >"$work/yaml/city.yaml"
expect 3 "city.yaml:$line:" "wrong type: its line" "$conurb" plan "$work/yaml"
sed "s/^plan:/plan:\n  overlap: 7/" "$work/good.yaml" >"$work/yaml/city.yaml"
expect 3 "plan.overlap is 7" "a value out of range" "$conurb" plan "$work/yaml"
sed "s/^version: 1/version: 99/" "$work/good.yaml" >"$work/yaml/city.yaml"
expect 9 "newer Conurb" "a workspace made by a newer version" "$conurb" plan "$work/yaml"
cp "$work/good.yaml" "$work/yaml/city.yaml"
[ "$before" = "$(digest "$work/yaml/plan")" ] && good || bad "the plan changed under a bad city.yaml"

# COLMAP that is not installed.
city colmap 9
sed -i "s#^  import:.*#  colmap: /nowhere/colmap#" "$work/colmap/city.yaml"
expect 8 "/nowhere/colmap" "COLMAP is missing" "$conurb" poses "$work/colmap"

# A full disk: a file-size limit makes every longer write fail.
city full 9
"$conurb" poses "$work/full" >/dev/null 2>&1 && "$conurb" plan "$work/full" >/dev/null 2>&1
before=$(digest "$work/full")
expect 6 "" "disk full" bash -c "trap '' XFSZ; ulimit -f 8; exec '$conurb' train '$work/full'"
rm -rf "$work/full/tiles"
[ "$before" = "$(digest "$work/full")" ] && good || bad "a full disk changed what was there"
expect 0 "" "after the disk has room again" "$conurb" train "$work/full"

# A read-only workspace. Root may write anywhere, so the test runs it as another user.
city locked 9
"$conurb" poses "$work/locked" >/dev/null 2>&1
before=$(digest "$work/locked")
chmod -R a-w,a+rX "$work/locked" "$work"
run=()
[ "$(id -u)" = 0 ] && run=(setpriv --reuid=65534 --regid=65534 --clear-groups)
chmod u+w "$work"
if "${run[@]}" test -x "$conurb" && "${run[@]}" test -r "$work/locked/city.yaml"; then
    expect 6 "" "read-only workspace" "${run[@]}" "$conurb" plan "$work/locked"
    [ "$before" = "$(digest "$work/locked")" ] && good || bad "a read-only workspace changed"
else
    echo "read-only workspace: skipped, the binary cannot be reached by another user"
fi
chmod -R u+w "$work/locked"

finish
