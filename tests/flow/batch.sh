#!/usr/bin/env bash
# What a run would do and why, tiles that fail or are taken, chunks of frames, status, and what is written for a
# cluster.
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
three_tiles town
town=$work/town

expect 0 "4 of 4 due" "nothing is made yet" "$conurb" run "$town" --dry-run
expect 0 "flight" "run" "$conurb" run "$town"
expect 0 "0 of 7 due" "all is done" "$conurb" run "$town" --dry-run
mapfile -t tiles < <(ls "$town/tiles")

# change FROM TO STAGE REASON DUE: changes a setting, checks what is due, and changes it back.
change() {
    cp "$town/city.yaml" "$work/before.yaml"
    sed -i "s/$1/$2/" "$town/city.yaml"
    expect 0 "$4" "$2: the reason" "$conurb" run "$town" --dry-run
    grep -q "^due *$3 .*$4" "$work/out" && good || bad "$2: $3 is not due because '$4'"
    grep -q "^$5 of" "$work/out" && good || bad "$2: not $5 are due"
    cp "$work/before.yaml" "$town/city.yaml"
}
change 'steps: 24' 'steps: 25' train 'train.steps is 25, was 24' 5
change 'hold_out_every: 0' 'hold_out_every: 4' plan 'plan.hold_out_every is 4, was 0' 6
change '  frames: 3' '  frames: 5' render 'frames not made yet' 1
change '^compose:' 'compose:\n  exponent: 2' render '3 of 3 frames' 1
# The match of the tiles' light: made again when a tile changes, and off when city.yaml says so.
grep -q "^done *match" "$work/out" && good || bad "the match of three tiles is not among what is done"
cp "$town/tiles/${tiles[1]}/DONE" "$work/DONE"
echo "other" >>"$town/tiles/${tiles[1]}/DONE"
expect 0 "tile ${tiles[1]} changed" "another tile: the match is due" "$conurb" run "$town" --dry-run
grep -q "^due *match" "$work/out" && grep -q "^due *render .*the match comes first" "$work/out" && good ||
    bad "another tile: match and frames are not due"
expect 4 "match: 1 of 1 not done" "status --done match" "$conurb" status "$town" --done match
cp "$work/DONE" "$town/tiles/${tiles[1]}/DONE"
cp "$town/city.yaml" "$work/before.yaml"
sed -i 's/^compose:/compose:\n  match: off/' "$town/city.yaml"
expect 0 "1 of 6 due" "compose.match: off" "$conurb" run "$town" --dry-run
grep -q "match" "$work/out" && bad "a match that is off is listed" || good
cp "$work/before.yaml" "$town/city.yaml"
expect 0 "match" "status of the match" "$conurb" status "$town"
touch "$work/town-photos/008.jpg" && expect 0 "0 of 7 due" "a touch changes nothing" "$conurb" run "$town" --dry-run
# A file that is no photo, and photos that were moved, change nothing.
echo "none" >"$work/town-photos/zz.jpg"
mv "$work/town-photos" "$work/moved-photos"
sed -i 's/town-photos/moved-photos/' "$town/city.yaml"
expect 0 "9 photos posed" "poses of moved photos" "$conurb" poses "$town"
grep -q "moved-photos" "$town/photos.json" && good || bad "photos.json names the old folder"
expect 0 "0 of 7 due" "moved photos" "$conurb" run "$town" --dry-run
cp "$town/plan/plan.json" "$work/plan.json"
sed -i 's/"radius_m": [0-9.]*/"radius_m": 9/' "$town/plan/plan.json"
expect 0 "plan/plan.json is not what was made" "an artefact that was changed" "$conurb" run "$town" --dry-run
cp "$work/plan.json" "$town/plan/plan.json"

# One tile cannot be trained: the others are trained, the flight is rendered, and exit code and last line report it.
rm -r "$town/tiles" "$town/renders"
mkdir "$town/tiles" && : >"$town/tiles/${tiles[1]}"
expect 6 "1 of 3 tiles not trained; ${tiles[1]}: cannot make the folder" "one of three tiles fails" "$conurb" run \
    "$town"
[ -e "$town/tiles/${tiles[2]}/DONE" ] && [ -e "$town/renders/flight/00002.png" ] && good || bad "the rest was not made"
# Of several that fail, the last line has one reason and the names of the others.
mv "$town/tiles/${tiles[2]}" "$work/kept" && : >"$town/tiles/${tiles[2]}"
expect 6 "2 of 3 tiles not trained; ${tiles[1]}: cannot make the folder" "two of three tiles fail" "$conurb" train \
    "$town"
grep -q "log.jsonl); also ${tiles[2]}$" "$work/out" && good || bad "the last line does not name the other tile"
rm "$town/tiles/${tiles[2]}" && mv "$work/kept" "$town/tiles/${tiles[2]}"
rm "$town/tiles/${tiles[1]}"
expect 0 "flight" "the tile is mended" "$conurb" run "$town"

# Chunks of frames, several at the same time. The last one makes the film.
before=$(digest "$town/renders")
rm -r "$town/renders"
expect 2 "the first is 1" "chunk 4 of 3" "$conurb" render "$town" --chunk 4/3
expect 2 "give I/N" "a chunk that makes no sense" "$conurb" render "$town" --chunk 2of3
"$conurb" render "$town" --chunk 3/3 2>/dev/null & "$conurb" render "$town" --chunk 1/3 2>/dev/null & wait
[ -e "$town/renders/flight/flight.mp4" ] && bad "a film of frames that are not there" || good
expect 4 "not done" "the frames are not all there" "$conurb" status "$town" --done render
expect 0 "film" "the last chunk" "$conurb" render "$town" --chunk 2/3
[ "$before" = "$(digest "$town/renders")" ] && good || bad "chunks are not the bytes of the whole"
"$conurb" status "$town" --done render >"$work/out" 2>&1 && good ||
    bad "the frames are all there, and status does not say so"
# The tiles are of the preset of city.yaml: those of another one are not done.
expect 4 "train: 3 of 3 not done" "--done of another quality" "$conurb" status "$town" --done train --quality preview
expect 2 "belongs to --done" "a quality of nothing" "$conurb" status "$town" --quality high

# A job is not submitted, nor waited for, as if its settings had not changed.
cp "$town/city.yaml" "$work/before.yaml"
sed -i 's/^poses:/poses:\n  max_error_m: 3/' "$town/city.yaml"
expect 4 "poses: 1 of 1 not done" "--done poses of other settings" "$conurb" status "$town" --done poses
cp "$work/before.yaml" "$town/city.yaml"

cp -a "$town" "$work/trained"
sed -i "s|centres: centres.geojson|centres: $town/centres.geojson|" "$work/trained/city.yaml"
rm -r "$work/trained"/{match,renders}
# Two processes on one tile: the second ends. The lock of a dead process blocks nobody.
sed -i 's/steps: 24/steps: 100000/' "$town/city.yaml"
"$conurb" train "$town" --tile "${tiles[0]}" >/dev/null 2>&1 &
pid=$!
for _ in $(seq 100); do [ -s "$town/tiles/${tiles[0]}/log.jsonl" ] &&
    [ -e "$town/tiles/${tiles[0]}/checkpoint.safetensors" ] && break; sleep 0.1; done
expect 10 "process $pid on" "a tile that is taken" "$conurb" train "$town" --tile "${tiles[0]}"
expect 0 "running" "status of a tile at work" "$conurb" status "$town"
kill -9 "$pid"
wait "$pid" 2>/dev/null
expect 0 "its heartbeat stopped" "status of a tile whose process died" "$conurb" status "$town"
"$conurb" train "$town" --tile "${tiles[0]}" >"$work/out" 2>&1 &
pid=$!
for _ in $(seq 100); do grep -q "resumes at step" "$work/out" && break; sleep 0.1; done
grep -q "resumes at step" "$work/out" && good || bad "a dead process's tile does not go on"
kill -TERM "$pid"
code=0
wait "$pid" || code=$?
[ "$code" = 75 ] && good || bad "SIGTERM: exit code $code, not 75"
[ -e "$town/tiles/${tiles[0]}/LOCK" ] && bad "SIGTERM left the lock" || good

# For a cluster: scripts that a shell accepts, and manifests with the members that the schema requires.
expect 0 "--dependency=afterok:\$train --kill-on-invalid-dep=yes" "submit --dry-run" "$conurb" submit "$town" \
    --engine slurm --dry-run --max-tasks 2
grep -q "train=.*--array=1-3%2" "$work/out" && good || bad "not an array of three tiles, two at once"
grep -q "render=.*--dependency=afterok:\$train:\$match " "$work/out" && good ||
    bad "the frames do not wait for the match"
for script in "$town"/jobs/*.sbatch; do bash -n "$script" && good || bad "$script is no script"; done
expect 0 "kubernetes.yaml" "submit to Kubernetes --dry-run" "$conurb" submit "$town" --engine kubernetes --dry-run \
    --max-tasks 2
holds() { python3 "$here/manifest.py" "$1/jobs/kubernetes.yaml" "${@:2}" >"$work/out" 2>&1 && good || bad "$1: $*"; }
grep -q "submit again" "$work/out" && good || bad "it does not say that other stages follow"
holds "$town" train=3
expect 0 "kubernetes.yaml" "submit of a quality" "$conurb" submit "$town" --engine kubernetes --dry-run --quality high
grep -q -- "--quality high" "$town/jobs/kubernetes.yaml" && good || bad "the pods train another quality"
# A job that asked for more than any node has would wait for ever.
cp -a "$town" "$work/bare"
rm -r "$work/bare/plan" "$work/bare/jobs"
mkdir "$work/two-nodes"
printf '#!/bin/sh\necho "1 4000"\necho "2 6000"\n' >"$work/two-nodes/sinfo"
chmod +x "$work/two-nodes/sinfo"
PATH=$work/two-nodes:$PATH expect 0 "prepare=" "submit to small nodes" \
    "$conurb" submit "$work/bare" --engine slurm --dry-run
grep -q -- "--cpus-per-task=2$" "$work/bare/jobs"/prepare*.sbatch &&
    grep -q -- "--time=1440$" "$work/bare/jobs"/prepare*.sbatch &&
    grep -q -- "--mem=6000M$" "$work/bare/jobs"/prepare*.sbatch && good || bad "a job asks for more than a node has"
# When the tiles are trained, the match, and then the frames.
expect 0 "kubernetes.yaml" "submit of the match" "$conurb" submit "$work/trained" --engine kubernetes --dry-run
holds "$work/trained" match=1
expect 0 "match" "the match" "$conurb" match "$work/trained"
expect 0 "kubernetes.yaml" "submit of the frames" "$conurb" submit "$work/trained" --engine kubernetes --dry-run
grep -q "submit again" "$work/out" && bad "other stages follow the last" || good
holds "$work/trained" render=1
# Every task gets time and memory by what it does, the scores too.
cp -a "$town" "$work/scored"
sed -i 's/hold_out_every: 0/hold_out_every: 4/' "$work/scored/city.yaml"
rm -r "$work/scored/jobs"
expect 0 "tiles" "a plan with photos to score" "$conurb" plan "$work/scored"
grep -q "trying steps preview: 0%" "$work/out" && good || bad "plan is silent while it tries steps"
expect 0 "eval=" "submit with scores" "$conurb" submit "$work/scored" --engine slurm --dry-run
for stage in train eval match render; do
    asked=$(sed -n 's/^#SBATCH --\(mem\|time\)=\([0-9]*\).*/\2/p' "$work/scored/jobs/$stage"-*.sbatch | tr '\n' ' ')
    read -r memory minutes <<<"$asked"
    [ "${memory:-0}" -gt 512 ] && [ "${minutes:-0}" -gt 10 ] && good ||
        bad "$stage asks for $memory MB, $minutes minutes"
done
# A budget of time passes as slowly on four processors as on one.
sed -i 's/^train:/train:\n  time_budget_s: 3600/' "$work/scored/city.yaml"
rm -r "$work/scored/jobs"
expect 0 "train=" "submit of a budget" "$conurb" submit "$work/scored" --engine slurm --dry-run --cpus 4
grep -q -- "--time=82$" "$work/scored/jobs"/train-*.sbatch && good || bad "an hour of training does not get 82 minutes"
mkdir "$work/site"
sed 's/^##SBATCH --partition=/#SBATCH --partition=night/' "$here/../../jobs/slurm.sbatch" >"$work/site/slurm.sbatch"
expect 0 "train" "a site's template" "$conurb" submit "$town" --engine slurm --dry-run --template "$work/site"
grep -q "partition=night" "$town"/jobs/train-*.sbatch && good || bad "the site's template was not used"
echo '{{colour}}' >"$work/site/slurm.sbatch"
expect 3 "{{colour}} is unknown" "a blank that is not known" "$conurb" submit "$town" --engine slurm --dry-run \
    --template "$work/site"
expect 2 "give slurm or kubernetes" "an engine that is not known" "$conurb" submit "$town" --engine pbs
expect 0 "kernel set in use" "doctor" "$conurb" doctor "$work"
for preset in "$here"/../../jobs/*.yaml; do
    [ "$(basename "$preset")" = kubernetes.yaml ] && continue
    mkdir -p "$work/preset" && cp "$preset" "$work/preset/city.yaml"
    expect 0 "no tiles yet" "the preset $(basename "$preset")" "$conurb" status "$work/preset"
done
for command in status submit doctor; do expect 0 "example:" "$command --help" "$conurb" "$command" --help; done
finish
