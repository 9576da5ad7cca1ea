#!/usr/bin/env python3
"""Curves of planning's time and memory from 10^3 to 10^6.4 photos over 1 km2, as a table and as SVG.
usage: tests/bench/scale.py BENCH_SCALE OUT_DIR [LOG10_MOST]
Runs BENCH_SCALE (the program bench_scale) at seven sizes; writes scale.csv, and scale.svg by bench_chart, which lies
beside bench_scale; fails when one of its limits is passed."""
import csv, json, os, subprocess, sys

LIMIT_S, LIMIT_MB = 120, 6000


def measure(program, photos):
    run = subprocess.run([program, str(photos), "--limit-s", str(LIMIT_S), "--limit-mb", str(LIMIT_MB)],
                         stdout=subprocess.PIPE)
    if not run.stdout:
        sys.exit(f"{program} {photos} failed")
    return json.loads(run.stdout), run.returncode == 0


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    program, out, most = sys.argv[1], sys.argv[2], float(sys.argv[3]) if len(sys.argv) > 3 else 6.447
    os.makedirs(out, exist_ok=True)
    rows, good = [], True
    sizes = [s for s in (3, 3.5, 4, 4.5, 5, 5.5, 6) if s < most] + [most]
    for size in sizes:
        row, fine = measure(program, round(10 ** size))
        rows.append(row)
        good = good and fine
        print("{photos:8} photos, {tiles:5} tiles of at most {most_photos:5} photos and {tile_mb:6.1f} MB: "
              "{total_s:7.2f} s "
              "({cpu_s:6.2f} s of processors), peak {peak_mb:7.1f} MB".format(**row), flush=True)
    with open(os.path.join(out, "scale.csv"), "w", newline="") as file:
        table = csv.DictWriter(file, rows[0].keys())
        table.writeheader()
        table.writerows(rows)
    chart = os.path.join(os.path.dirname(os.path.abspath(program)), "bench_chart")
    subprocess.run([chart, "scale", os.path.join(out, "scale.csv"), os.path.join(out, "scale.svg"), str(LIMIT_S),
                    str(LIMIT_MB)], check=True)
    sys.exit(not good)


if __name__ == "__main__":
    main()
