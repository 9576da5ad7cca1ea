#!/usr/bin/env bash
# Held-out PSNR of the composite and time of a picture for each blending, and what ownership costs where two tiles overlap.
# usage: tests/bench/blend.sh CONURB BENCH_BLEND CITY [ROUNDS] [WIDTH]     CITY: trained, with two tiles or more and held-out photos
set -euo pipefail
conurb=$1 bench=$2 city=$3
printf '%-12s %10s %8s %12s\n' blending PSNR SSIM 's a picture'
for blend in nearest distance_2d distance_3d visibility ownership; do
    "$conurb" eval "$city" --blend "$blend" --json 2>/dev/null | python3 -c "
import json, sys
e = json.load(sys.stdin)
print(f'{sys.argv[1]:12} {e[\"psnr\"]:7.2f} dB {e[\"ssim\"]:8.4f} {e[\"render_s\"]:12.3f}')" "$blend"
done
"$bench" "$city" "${4:-5}" "${5:-480}"
