#!/usr/bin/env bash
# Splats of a trained city by budget: their number, size, PSNR in held-out views beside the field's, processor seconds.
# usage: tests/bench/splats.sh CONURB CITY [BUDGET...]
set -euo pipefail
conurb=$1
city=$2
shift 2
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
[ $# -gt 0 ] || set -- 100000 1000000
for budget in "$@"; do
    echo "budget $budget"
    TIMEFORMAT='    %U s by programs and %S s by the system on processors, %R s by the clock'
    time "$conurb" export "$city" --splats "$out/s.ply" --budget "$budget" 2>&1 | tr '\r' '\n' | grep -v '^export' |
        sed 's/^/    /'
done
