#!/usr/bin/env bash
# A city of three tiles on a real Slurm that this test starts: one node, no systemd. One task is killed, one is stopped
# and requeued (exit code 75), and the node fails and comes back. Submitting again runs what is missing. The bytes equal
# those of a local run.
# usage: slurm.sh CONURB MAKE_PHOTOS
for program in slurmctld slurmd munged mungekey sbatch squeue; do
    PATH=$PATH:/usr/sbin command -v "$program" >/dev/null ||
        { echo "skipped: $program is not installed (Debian: slurm-wlm munge)"; exit 77; }
done
[ "$(id -u)" = 0 ] || { echo "skipped: munged and slurmd want to be root"; exit 77; }
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
PATH=$PATH:/usr/sbin
cluster=$work/slurm
: >"$work/out"

# Slurm's commands wait very long for a controller that does not answer.
limited() { timeout 20 "$@"; }
daemon() { cat "$cluster/run/$1.pid" 2>/dev/null; }
stop_daemon() {
    local pid
    pid=$(daemon "$1") || return 0
    kill "$pid" 2>/dev/null
    for _ in $(seq 100); do kill -0 "$pid" 2>/dev/null || return 0; sleep 0.1; done
    kill -9 "$pid" 2>/dev/null
}
take_down() {
    limited scancel --quiet --user root 2>/dev/null
    sleep 1
    for d in slurmd slurmctld munged; do stop_daemon "$d"; done
    rm -rf "$work"
}
trap take_down EXIT

bring_up() {
    local host cpus memory ports
    # Two ports that nothing listens on, below those that the kernel gives to connections.
    for _ in $(seq 20); do
        ports=$((20000 + RANDOM % 12000))
        (: >"/dev/tcp/127.0.0.1/$ports" || : >"/dev/tcp/127.0.0.1/$((ports + 1))") 2>/dev/null || break
    done
    mkdir -p "$cluster"/{munge,state,spool,log,run}
    chmod 700 "$cluster/munge" && chmod 755 "$work"
    host=$(hostname -s)
    eval "$(slurmd -C | head -n 1 | tr ' ' '\n' | grep -E '^(CPUs|RealMemory)=')"
    cpus=$CPUs memory=$RealMemory
    mungekey --create --keyfile "$cluster/munge/key" >/dev/null
    munged --socket="$cluster/run/munge.sock" --key-file="$cluster/munge/key" --pid-file="$cluster/run/munged.pid" \
        --log-file="$cluster/log/munged.log" --seed-file="$cluster/munge/seed" --num-threads=1 >/dev/null 2>&1
    cat >"$cluster/slurm.conf" <<CONF
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmdUser=root
SlurmctldPort=$ports
SlurmdPort=$((ports + 1))
AuthType=auth/munge
AuthInfo=socket=$cluster/run/munge.sock,cred_expire=5
CryptoType=crypto/munge
StateSaveLocation=$cluster/state
SlurmdSpoolDir=$cluster/spool
SlurmctldPidFile=$cluster/run/slurmctld.pid
SlurmdPidFile=$cluster/run/slurmd.pid
SlurmctldLogFile=$cluster/log/slurmctld.log
SlurmdLogFile=$cluster/log/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=1,bf_interval=1,batch_sched_delay=0
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
JobRequeue=1
RequeueExit=75
ReturnToService=2
KillWait=2
MinJobAge=3600
SlurmctldTimeout=30
SlurmdTimeout=5
InactiveLimit=0
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cpus RealMemory=$((memory - 1024)) State=UNKNOWN
PartitionName=main Nodes=$host Default=YES MaxTime=INFINITE State=UP OverSubscribe=NO
CONF
    echo "CgroupAutomount=no" >"$cluster/cgroup.conf"
    export SLURM_CONF=$cluster/slurm.conf
    slurmctld -f "$SLURM_CONF" -c >/dev/null 2>&1
    slurmd -f "$SLURM_CONF" >/dev/null 2>&1
    wait_for 20 "the node is idle" node_is idle
}

node_is() { limited sinfo --noheader --format %T | grep -q "^$1"; }

# wait_for SECONDS WHAT COMMAND...
wait_for() {
    local end=$((SECONDS + $1 * 3 * slow)) what=$2 # thrice the time of an idle machine
    shift 2
    while ! "$@" >/dev/null 2>&1; do
        if [ "$SECONDS" -ge "$end" ]; then
            { limited squeue --array; limited sinfo; tail -n 5 "$cluster"/log/slurmctld.log; } >"$work/out" 2>&1
            bad "waited too long: $what"
            return 1
        fi
        sleep 0.2
    done
    good
}

# pid_of TILE: the process that trains it, from its lock.
pid_of() { head -n 1 "$work/town/tiles/$1/LOCK" 2>/dev/null | cut -d' ' -f2; }
parent_of() { ps -o ppid= -p "$1" | tr -d ' '; }
at_work() {
    [ -n "$(pid_of "$1")" ] && kill -0 "$(pid_of "$1")" 2>/dev/null &&
        [ -e "$work/town/tiles/$1/checkpoint.safetensors" ]
}
no_jobs() {
    local jobs
    jobs=$(limited squeue --noheader) && [ -z "$jobs" ]
}
state_of() { "$conurb" status "$work/town" --json 2>/dev/null | python3 -c "
import json, sys
for r in json.load(sys.stdin)['rows']:
    if r['item'] == '$1': print(r['state'])"; }
is_state() { [ "$(state_of "$1")" = "$2" ]; }
worth() {
    (cd "$1" && find . -type f ! -name log.jsonl ! -name metrics.json ! -path './jobs/*' -print0 | sort -z |
        xargs -0 sha256sum)
}

# First the same city by a local run. Both use the same path, because records contain it.
three_tiles town
# A tile that takes some seconds, so that it can be interrupted even on a busy machine.
sanitized && steps=250 || steps=4000
sed -i "s/steps: 24/steps: $steps/; s/checkpoint_every_s: 0.05/checkpoint_every_s: 0.3/" \
    "$work/town/city.yaml"
cp -a "$work/town" "$work/new"
expect 0 "flight" "the local run" "$conurb" run "$work/town" --threads 1
worth "$work/town" >"$work/whole"
rm -rf "$work/town" && mv "$work/new" "$work/town"

bring_up || { finish; exit 1; }

# One job makes poses and plan, and then submits the rest: arrays of tiles, then frames.
expect 0 "prepare: job" "submit without a plan" "$conurb" submit "$work/town" --engine slurm --max-tasks 2 --cpus 1
wait_for 30 "the plan is there" test -e "$work/town/plan/stage.json"
mapfile -t tiles < <(python3 -c "import json
for tile in json.load(open('$work/town/plan/plan.json'))['tiles']: print(tile['id'])")
[ "${#tiles[@]}" = 3 ] && good || bad "the plan has ${#tiles[@]} tiles, not 3"
wait_for 20 "a task trains ${tiles[0]}" at_work "${tiles[0]}"
is_state "${tiles[0]}" running && good || bad "status does not say that ${tiles[0]} is running"
is_state "${tiles[2]}" queued && good || bad "status does not say that ${tiles[2]} is queued"

# kill -9: the task fails, and status reports it sooner than the queue.
kill -9 "$(pid_of "${tiles[0]}")"
# SIGTERM: a checkpoint, exit code 75, and Slurm starts the task again. The queue then holds it for a while.
if wait_for 20 "a task trains ${tiles[1]}" at_work "${tiles[1]}"; then
    kill -TERM "$(pid_of "${tiles[1]}")"
fi
job=$(python3 -c "import json
print([j['id'] for j in json.load(open('$work/town/jobs/submission.json'))['jobs'] if j['stage'] == 'train'][-1])")
requeued() { limited scontrol show job "${job}_2" | grep -q 'Requeue=1 Restarts=[1-9]'; }
wait_for 20 "task 2 is requeued" requeued

# The node fails while it trains the third tile, and comes back.
if wait_for 30 "a task trains ${tiles[2]}" at_work "${tiles[2]}"; then
    pid=$(pid_of "${tiles[2]}")
    script=$(parent_of "$pid")
    kill -9 "$(daemon slurmd)" "$(parent_of "$script")" "$script" "$pid"
fi
limited scontrol update nodename="$(hostname -s)" state=down reason=test
node_is down && good || bad "the node is not down"
is_state "${tiles[2]}" queued && good || bad "status does not say that ${tiles[2]} waits for another start"
slurmd -f "$SLURM_CONF" >/dev/null 2>&1
limited scontrol update nodename="$(hostname -s)" state=resume
wait_for 30 "the node is back" node_is '\(idle\|mix\|alloc\)'

# The frames wait for an array with a failed task, so Slurm cancels them. Then only the missing work is submitted
# again.
wait_for 60 "the first submission is over" no_jobs
[ -e "$work/town/tiles/${tiles[0]}/DONE" ] && bad "the killed tile is done" || good
expect 0 "train: job" "submit again" "$conurb" submit "$work/town" --engine slurm --max-tasks 2 --cpus 1
wait_for 60 "the second submission is over" no_jobs
worth "$work/town" >"$work/out"
if cmp -s "$work/whole" "$work/out"; then good; else
    diff "$work/whole" "$work/out" >"$work/diff"
    mv "$work/diff" "$work/out"
    bad "not the bytes of the local run"
fi
expect 0 "nothing to submit" "submit when all is done" "$conurb" submit "$work/town" --engine slurm --cpus 1
finish
