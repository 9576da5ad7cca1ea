#!/usr/bin/env bash
# The charts of the benchmarks: drawn from small tables, and read as XML. usage: chart.sh BENCH_CHART
set -euo pipefail
chart=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() {
    echo "chart.sh: $*" >&2
    exit 1
}
printf '%s\n' kernel,set,ns_per_sample,gflops,gb_per_s,limit,limit_ns,share \
    'gemm <64>,ref,1254.5,3.2,0.3,multiply-adds,633.1,0.5047' 'adam,avx2,0.48,29,67,memory stream,0.67,1.42' \
    >"$work/kernels.csv"
printf '%s\n' photos,tie_s,total_s,cpu_s,input_mb,peak_mb 1000,0.0,0.04,0.038,129.7,134.4 \
    1000000,1.5,20.1,22.7,900.0,2100.5 >"$work/scale.csv"
printf '%s\n' photos,total_s,cpu_s,models_mb,peak_mb,rms_m,fit_rms_m 1000,20,31,140,300,0.07,0.02 \
    100000,900,1700,5000,7000,0.05,0.03 >"$work/poses.csv"
"$chart" kernels "$work/kernels.csv" "$work/kernels.svg"
"$chart" poses "$work/poses.csv" "$work/poses.svg" 1800 8000 0.05
"$chart" scale "$work/scale.csv" "$work/scale.svg" 120 6000
python3 - "$work/kernels.svg" 'gemm <64>, ref' "$work/scale.svg" 'limit: 6000' \
    "$work/poses.svg" 'limit: 0.05' <<'PY'
import sys
import xml.etree.ElementTree as tree
for path, wanted in zip(sys.argv[1::2], sys.argv[2::2]):
    texts = [node.text for node in tree.parse(path).getroot()]
    if wanted not in texts:
        sys.exit(f"{path} has no text '{wanted}'")
PY
printf 'kernel,set\nadam,avx2\n' >"$work/short.csv"
"$chart" kernels "$work/short.csv" "$work/short.svg" 2>"$work/message" && fail "a table without its columns was drawn"
grep -q "no column 'ns_per_sample'" "$work/message" || fail "no word of the column that is missing"
sed -i '2s/,ref//' "$work/kernels.csv"
"$chart" kernels "$work/kernels.csv" "$work/short.svg" 2>"$work/message" && fail "a row with a cell missing was drawn"
[ ! -e "$work/short.svg" ] || fail "half a chart was written"
