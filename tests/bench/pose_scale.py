#!/usr/bin/env python3
"""Curves of the time, the memory and the error of posing in groups, from 10^3 to 10^5 photos, as a table and as SVG.
usage: tests/bench/pose_scale.py BENCH_POSE_SCALE OUT_DIR [LOG10_MOST]
Runs BENCH_POSE_SCALE (the program bench_pose_scale) at five sizes; writes pose_scale.csv, and pose_scale.svg by
bench_chart, which lies beside it. Sizes that OUT_DIR/N.json has are not run again. Mapping the groups is not in it:
that takes as long as the largest group does, on enough machines."""
import csv, json, os, subprocess, sys

LIMIT_S, LIMIT_MB, LIMIT_M = 1800, 8000, 0.05


def measure(program, photos, out):
    path = os.path.join(out, "%d.json" % photos)
    if not os.path.exists(path):
        run = subprocess.run([program, str(photos)], stdout=subprocess.PIPE)
        if not run.stdout:
            sys.exit(f"{program} {photos} failed")
        with open(path, "wb") as file:
            file.write(run.stdout)
    return json.load(open(path))


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    program, out, most = sys.argv[1], sys.argv[2], float(sys.argv[3]) if len(sys.argv) > 3 else 5
    os.makedirs(out, exist_ok=True)
    rows = []
    for size in [s for s in (3, 3.5, 4, 4.5) if s < most] + [most]:
        rows.append(measure(program, round(10 ** size), out))
        print("{photos:7} photos in {groups:4} groups: {total_s:8.1f} s ({cpu_s:8.1f} s of processors), "
              "peak {peak_mb:7.0f} MB, {fit_rms_m:.4f} m rms, on Earth {rms_m:.4f} m".format(**rows[-1]), flush=True)
    with open(os.path.join(out, "pose_scale.csv"), "w", newline="") as file:
        table = csv.DictWriter(file, rows[0].keys())
        table.writeheader()
        table.writerows(rows)
    chart = os.path.join(os.path.dirname(os.path.abspath(program)), "bench_chart")
    subprocess.run([chart, "poses", os.path.join(out, "pose_scale.csv"), os.path.join(out, "pose_scale.svg"),
                    str(LIMIT_S), str(LIMIT_MB), str(LIMIT_M)], check=True)


if __name__ == "__main__":
    main()
