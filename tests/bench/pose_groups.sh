#!/usr/bin/env bash
# A made city of 400 photos posed in groups on a Slurm of one node, and its distance from the truth. One task is killed
# (kill -9) while it works, and later the node, which comes back. The same city posed without a kill has to be the
# same to some centimetres. Wants root and a Slurm that sbatch reaches (SLURM_CONF).
# usage: pose_groups.sh CONURB SYNTH OUT [PHOTOS [GROUP_PHOTOS [GPS_NOISE_M]]]
set -euo pipefail
conurb=$1
synth=$2
out=$3
n=${4:-400}
group=${5:-120}
noise=${6:-0.1}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
mkdir -p "$out"
[ -e "$out/made/truth/frame.json" ] ||
    "$synth" "$out/made" --seed 3 --photos "$n" --runs 1 --size 150 --width 640 --height 432 --gps-noise "$noise" \
        --survey --empty 2>"$out/synth.log"

# prepare NAME: a city that is posed in groups
prepare() {
    "$conurb" init "$out/$1" --photos "$out/made/photos" 2>"$out/$1.log"
    sed -i "s/^poses:.*/poses:\n  group_photos: $group/" "$out/$1/city.yaml"
}
idle() { [ -z "$(squeue --noheader --states all --format %T | grep -E 'PENDING|RUNNING|COMPLETING' || true)" ]; }
wait_idle() { until idle; do sleep 2; done; }
# The process that maps a group, from its lock.
pid_of() { cut -d' ' -f2 "$out/$1/poses/groups/$2/LOCK" 2>/dev/null | head -n 1; }
# submit NAME: poses and plan, no training. The last job submits the rest, which is cancelled.
submit() {
    "$conurb" submit "$out/$1" --engine slurm --cpus 1 2>>"$out/$1.log"
    until [ -e "$out/$1/poses/stage.json" ] || idle; do sleep 2; done
}
# The node fails: its daemon ends, and all that it started. Then it comes back.
kill_node() {
    local host daemon task
    host=$(hostname -s)
    daemon=$(cat "$(scontrol show config | awk '$1 == "SlurmdPidFile" { print $3 }')")
    mapfile -t running < <(pgrep -x slurmstepd)
    for task in "${running[@]}"; do mapfile -t -O "${#running[@]}" running < <(pgrep -P "$task"); done
    for task in "${running[@]}"; do mapfile -t -O "${#running[@]}" running < <(pgrep -P "$task"); done
    kill -9 "$daemon" "${running[@]}"
    scontrol update nodename="$host" state=down reason=test
    until scontrol show node "$host" | grep -q 'State=DOWN'; do sleep 0.2; done
    slurmd -f "$SLURM_CONF" >/dev/null 2>&1
    # A node that came back by itself cannot be resumed.
    scontrol update nodename="$host" state=resume 2>/dev/null || true
}
report() {
    grep -hE 'groups|adjusted|agree|photos posed' "$out/$1"/jobs/logs/merge-*.log | sed "s/^/$1: /"
    python3 "$here/pose_truth.py" "$out/$1" "$out/made/truth"
    (cd "$out/$1/poses/model" && sha256sum ./*.bin)
}

prepare killed
submit killed &
until [ -e "$out/killed/poses/groups/002/features.done.json" ]; do sleep 1; done
pid=$(pid_of killed 002)
kill -9 "$pid"
echo "killed: kill -9 of the task of group 2, while it matches"
until [ -e "$out/killed/poses/groups/003/features.done.json" ]; do sleep 1; done
kill_node
echo "killed: kill -9 of the node, while groups 1 and 3 are at work"
wait
wait_idle
"$conurb" status "$out/killed" | grep -E '^(group|poses)'
submit killed
scancel --user "$(id -un)" 2>/dev/null || true
wait_idle
report killed

prepare whole
submit whole
scancel --user "$(id -un)" 2>/dev/null || true
wait_idle
report whole
echo "killed against whole (COLMAP's descriptors differ from run to run in a few photos, so bytes do, too):"
python3 "$here/pose_truth.py" "$out/killed" "$out/whole/poses"
