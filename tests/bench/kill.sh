#!/usr/bin/env bash
# tests/flow/kill.sh at length: 50 times kill -9, 20 each of SIGTERM, power loss and full disk.
# usage: tests/bench/kill.sh BUILD
set -euo pipefail
build=$1
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
export CONURB_KILLS=${CONURB_KILLS:-50} CONURB_TERMS=${CONURB_TERMS:-20} CONURB_LOSSES=${CONURB_LOSSES:-20} \
    CONURB_FULL=${CONURB_FULL:-20}
exec bash "$root/tests/flow/kill.sh" "$build/src/app/conurb" "$build/tests/flow/make_photos" \
    "$build/tests/flow/synced.so"
