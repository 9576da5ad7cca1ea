#!/usr/bin/env bash
# Held-out PSNR of the composite and time of a picture for each blending, and what ownership costs where two tiles
# overlap. Fails where the default scores less than the nearest tile alone, or where ownership by two costs more than
# 1.2 renders of one.
# usage: tests/bench/blend.sh CONURB BENCH_BLEND CITY [ROUNDS] [WIDTH]     CITY: trained, with two tiles or more and
# held-out photos
set -euo pipefail
conurb=$1 bench=$2 city=$3
table=$("$conurb" eval "$city" --blend all 2>/dev/null)
printf '%s\n' "$table"
awk '$1 == "nearest" { nearest = $2 }
     $1 == "distance_2d" { printf "distance_2d less nearest: %+.2f dB\n", $2 - nearest
                           exit !($2 >= nearest) }' <<<"$table"
"$bench" "$city" "${4:-5}" "${5:-480}"
