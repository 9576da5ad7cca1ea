#!/usr/bin/env bash
# Names that could collide: a/b.jpg, a_b.jpg and a_b.png; and a city in a folder with blanks.
# names.sh CONURB MAKE_PHOTOS
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"

city town 8 all
town=$work/town
mkdir "$town-photos/a"
python3 - "$town-photos" <<'PY'
import json, os, sys
folder = sys.argv[1]
path = os.path.join(folder, "transforms.json")
t = json.load(open(path))
frames = sorted(t["frames"], key=lambda f: f["file_path"])
# Every second photo by name is held out: "a/b" and "a_b" are first and third.
ending = os.path.splitext(frames[0]["file_path"])[1]
for frame, name in zip(frames, ["a/b", "a/c", "a_b", "a_c"]):
    os.rename(os.path.join(folder, os.path.basename(frame["file_path"])), os.path.join(folder, name + ending))
    frame["file_path"] = name + ending
json.dump(t, open(path, "w"))
PY
ending=$(basename "$town-photos/a/b".*)
ending=${ending#b}
sed -i 's/^plan:/plan:\n  hold_out_every: 2/; s/steps: 40/steps: 4/' "$town/city.yaml"
expect 0 "eval" "a run" "$conurb" run "$town" --threads 2
python3 - "$town/eval/eval.json" >"$work/held" <<'PY'
import json, sys
for photo in json.load(open(sys.argv[1]))["photos"]: print(photo["name"])
PY
for name in a/b a_b; do
    grep -qxF "$name$ending" "$work/held" && good || bad "$name is not held out, which this test needs"
done
pictures=$(find "$town/eval" -name '*.png' | wc -l)
[ "$pictures" = "$(wc -l <"$work/held")" ] && good || bad "$(wc -l <"$work/held") photos held out, $pictures pictures"
while read -r name; do
    [ -s "$town/eval/$name.png" ] && good || bad "no picture of $name"
done <"$work/held"
# Where other photos are held out, the pictures of the earlier ones go; what Conurb did not write stays.
cp -r "$town" "$work/other"
echo mine >"$work/other/eval/mine.png"
sed -i 's/hold_out_every: 2/hold_out_every: 3/' "$work/other/city.yaml"
expect 0 "held-out photos" "a run that holds out other photos" "$conurb" run "$work/other" --threads 2
python3 - "$work/other/eval" >"$work/out" 2>&1 <<'PY' && good || bad "eval leaves pictures of other photos"
import json, pathlib, sys
folder = pathlib.Path(sys.argv[1])
held = {photo["name"] + ".png" for photo in json.load(open(folder / "eval.json"))["photos"]}
there = {str(path.relative_to(folder)) for path in folder.rglob("*.png")}
assert there == held | {"mine.png"}, (there, held)
PY
for name in a/b a_b; do
    expect 0 "frames" "a view of $name" "$conurb" render "$town" --photo "$name$ending" --width 32
done
[ "$(find "$town/renders" -mindepth 2 -name '00000.png' -not -path '*/flight/*' | wc -l)" = 2 ] && good ||
    bad "two views share a folder"

# A light's file whose path is not UTF-8, which JSON must be.
light=$work/caf$'\351'.json
expect 0 '"tiles"' "a light as JSON" "$conurb" appearance "$town" show mean
"$conurb" appearance "$town" show mean >"$light" 2>/dev/null
expect 0 'caf?.json' "a light's file that is not UTF-8" "$conurb" appearance "$town" show "$light"

mkdir "$work/my cities"
mv "$town" "$work/my cities/old 'town' #1 50%"
town="$work/my cities/old 'town' #1 50%"
rm -r "$town"/tiles
expect 0 "train" "submit --dry-run" "$conurb" submit "$town" --engine slurm --dry-run
# sbatch splits these lines like a shell: a backslash quotes the next character.
python3 - "$town" "$town"/jobs/train-*.sbatch >"$work/out" 2>&1 <<'PY' && good || bad "an #SBATCH line falls apart"
import os, shlex, sys
town, script = sys.argv[1:]
options = {}
for line in open(script):
    if line.startswith("#SBATCH"):
        words = shlex.split(line[len("#SBATCH"):], comments=True)
        assert len(words) == 1, (line, words)
        key, _, value = words[0].partition("=")
        options[key] = value
assert options["--output"] == town.replace("%", "%%") + "/jobs/logs/train-%A_%a.log", options
assert options["--job-name"] == os.path.basename(town) + "-train", options
PY
finish
