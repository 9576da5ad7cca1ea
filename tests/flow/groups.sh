#!/usr/bin/env bash
# A made city posed in groups: here, step by step, with a group that is killed and one that fails, and what is written
# for a cluster. colmap_truth.py plays COLMAP.
# usage: groups.sh CONURB MAKE_PHOTOS SYNTH
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
synth=$3
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
"$synth" "$work/made" --seed 3 --photos 40 --size 40 --width 96 --height 64 --gps-noise 0.3 --empty 2>"$work/out" ||
    { bad "conurb-synth"; exit 1; }
export TRUTH_MODEL=$work/made/truth/model

# make NAME: a city that is posed in groups of 18 photos at most.
make() {
    "$conurb" init "$work/$1" --photos "$work/made/photos" 2>/dev/null
    sed -i "s|^poses:.*|poses:\n  colmap: $here/colmap_truth.py\n  group_photos: 18\n  attempts: 1|" \
        "$work/$1/city.yaml"
}
# near NAME: at least 38 photos, less than 5 cm from the truth.
near() {
    python3 "$here/../bench/pose_truth.py" "$work/$1" "$work/made/truth" >"$work/out" 2>&1
    awk '{ split($0, w, " "); exit !(w[2] >= 38 && w[6] < 0.05) }' "$work/out" && good || bad "$1: not near the truth"
}

make town
expect 2 "give one of --split, --group and --merge" "two steps at once" "$conurb" poses "$work/town" --split --merge
expect 2 "--group: give the number" "half a group" "$conurb" poses "$work/town" --group 1.5
expect 4 "--split\` first" "a group before the split" "$conurb" poses "$work/town" --group 1
expect 0 "groups joined" "poses in groups" "$conurb" poses "$work/town"
near town
n=$(find "$work/town/poses/groups" -name group.json | wc -l)
[ "$n" -ge 4 ] && good || bad "$n groups, not four or more"
expect 0 "poses are done" "a second run" "$conurb" poses "$work/town"
expect 0 " photos" "status of groups" "$conurb" status "$work/town"
grep -q "^group *$n  *done" "$work/out" && good || bad "status does not say that group $n is done"
expect 0 "done  group" "what is due" "$conurb" run "$work/town" --dry-run
python3 - "$work/town/poses/report.json" "$n" >"$work/out" 2>&1 <<'PY' && good || bad "the report of groups"
import json, sys
report = json.load(open(sys.argv[1]))
groups = report["groups"]
assert len(groups) == int(sys.argv[2]) and report["adjusted"] == "at once"
assert all(g["fate"] == "joined" and g["posed"] >= 10 and g["neighbours"] >= 1 for g in groups)
assert sum(g["core"] for g in groups) == 40 and max(g["photos"] for g in groups) <= 18
PY
grep -q "<h2>Groups</h2>" "$work/town/poses/report.html" && good || bad "the page has no groups"

# Step by step. A group's process is killed: the merge says which group is missing, and afterwards all is as before.
make steps
expect 0 "groups of at most 18, by GPS" "split" "$conurb" poses "$work/steps" --split
expect 2 "the groups are 1 to $n" "a group that is not there" "$conurb" poses "$work/steps" --group 99
MAPPER_WAITS=groups/002 "$conurb" poses "$work/steps" --group 2 >/dev/null 2>&1 &
pid=$!
for _ in $(seq 300); do [ -e "$work/steps/poses/groups/002/matches.done.json" ] && break; sleep 0.1; done
expect 0 "running" "status of a group at work" "$conurb" status "$work/steps"
expect 10 "process $pid on" "a group that is taken" "$conurb" poses "$work/steps" --group 2
kill -9 "$pid"
wait "$pid" 2>/dev/null
expect 0 "lost" "status of a group whose process died" "$conurb" status "$work/steps"
expect 4 "of $n not done" "status --done group" "$conurb" status "$work/steps" --done group
expect 0 "" "a group" "$conurb" poses "$work/steps" --group 1
expect 4 "group 2 of" "a merge without a group" "$conurb" poses "$work/steps" --merge
[ -e "$work/steps/poses/model" ] && bad "a merge without a group left a model" || good
expect 0 "groups joined" "the rest" "$conurb" poses "$work/steps" --threads 8
"$conurb" status "$work/steps" --done group >"$work/out" 2>&1 && good || bad "the groups are done, status says no"
if [ "$(digest "$work/town/poses/model")" = "$(digest "$work/steps/poses/model")" ]; then good; else
    bad "not the bytes of the run that nothing disturbed"
fi

# A group without poses does not stop the others, and the report names it.
make holes
MAPPER_FAILS=groups/002 expect 0 "group 2 failed, and the others go on without it" "a group without poses" \
    "$conurb" poses "$work/holes"
grep -q '"fate": "without a model"' "$work/holes/poses/report.json" && good || bad "report.json does not name the group"
grep -q "without a model: COLMAP finds no poses" "$work/holes/poses/report.html" && good ||
    bad "the page does not say why the group has no model"
expect 0 "failed" "status of a group that failed" "$conurb" status "$work/holes"
expect 0 "poses are done" "a second run of it" "$conurb" poses "$work/holes"
rm -r "$work/holes/poses/groups/002"
expect 0 "" "the group again" "$conurb" poses "$work/holes" --group 2
expect 0 "groups joined" "poses with the group" "$conurb" poses "$work/holes"
if [ "$(digest "$work/town/poses/model")" = "$(digest "$work/holes/poses/model")" ]; then good; else
    bad "not the bytes of the run in which no group failed"
fi
# When no group has poses, that is an error.
make none
MAPPER_FAILS=groups/ expect 4 "none of the $n groups has a pose" "no group has poses" "$conurb" poses "$work/none"

# For a cluster: first the split, then an array of the groups and the job that merges them.
make far
expect 0 "prepare=" "submit before the split" "$conurb" submit "$work/far" --engine slurm --dry-run
expect 0 "groups of at most" "split for a cluster" "$conurb" poses "$work/far" --split
expect 0 "merge=" "submit after it" "$conurb" submit "$work/far" --engine slurm --dry-run --max-tasks 2
grep -q "group=.*--array=1-$n%2" "$work/out" && good || bad "not an array of $n groups, two at once"
grep -q "merge=.*--dependency=afterany:\$group " "$work/out" && good || bad "the merge does not wait for the groups"
for script in "$work"/far/jobs/*.sbatch; do bash -n "$script" && good || bad "$script is no script"; done
expect 0 "kubernetes.yaml" "groups on Kubernetes" "$conurb" submit "$work/far" --engine kubernetes --dry-run
manifest=$work/far/jobs/kubernetes.yaml
grep -q "completions: $n" "$manifest" && ! grep -q -- "--merge" "$manifest" && good ||
    bad "the manifest has no groups, or their merge at the same time"

# Few photos, or group_photos: 0, need no groups.
make few
sed -i 's/group_photos: 18/group_photos: 0/' "$work/few/city.yaml"
expect 0 "40 photos need no groups" "a split that is not needed" "$conurb" poses "$work/few" --split
expect 0 "40 photos posed" "poses at once" "$conurb" poses "$work/few"
[ -e "$work/few/poses/groups/groups.json" ] && bad "groups of a city that has none" || good
expect 0 "global mapper" "doctor names the mapper" "$conurb" doctor "$work"
finish
