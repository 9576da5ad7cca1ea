#!/usr/bin/env python3
"""Curves of planning's time and memory from 10^3 to 10^6.4 photos over 1 km2, as a table and as SVG.
usage: tests/bench/scale.py BENCH_SCALE OUT_DIR [LOG10_MOST]
Runs BENCH_SCALE (the program bench_scale) at seven sizes; writes scale.csv and scale.svg;
fails when one of its limits is passed."""
import csv, json, math, os, subprocess, sys

LIMIT_S, LIMIT_MB = 120, 6000


def measure(program, photos):
    run = subprocess.run([program, str(photos), "--limit-s", str(LIMIT_S), "--limit-mb", str(LIMIT_MB)],
                         stdout=subprocess.PIPE)
    if not run.stdout:
        sys.exit(f"{program} {photos} failed")
    return json.loads(run.stdout), run.returncode == 0


def panel(rows, left, title, unit, series, limit):
    """One log-log diagram: lines of (key, label, colour) over photos, and the limit."""
    width, height, top = 420, 300, 60
    lo, hi = math.log10(rows[0]["photos"]), math.log10(rows[-1]["photos"])
    values = [r[k] for r in rows for k, _, _ in series] + [limit]
    y0, y1 = math.floor(math.log10(max(min(values), 1e-3))), math.ceil(math.log10(max(values)))
    x = lambda v: left + (math.log10(v) - lo) / max(hi - lo, 1e-9) * width
    y = lambda v: top + height - (math.log10(max(v, 10 ** y0)) - y0) / (y1 - y0) * height
    out = [f'<text x="{left}" y="{top - 18}" font-size="15" font-weight="bold">{title}</text>',
           f'<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="none" stroke="#999"/>']
    for e in range(y0, y1 + 1):
        out.append(f'<path d="M{left} {y(10 ** e):.1f}h{width}" stroke="#ddd"/>'
                   f'<text x="{left - 6}" y="{y(10 ** e) + 4:.1f}" font-size="12" text-anchor="end">{10 ** e:g}</text>')
    for e in range(math.ceil(lo), math.floor(hi) + 1):
        out.append(f'<path d="M{x(10 ** e):.1f} {top}v{height}" stroke="#ddd"/>'
                   f'<text x="{x(10 ** e):.1f}" y="{top + height + 18}" font-size="12" text-anchor="middle">'
                   f'10<tspan dy="-5" '
                   f'font-size="9">{e}</tspan></text>')
    out.append(f'<path d="M{left} {y(limit):.1f}h{width}" stroke="#b3001b" stroke-dasharray="6 4"/>'
               f'<text x="{left + 6}" y="{y(limit) - 5:.1f}" font-size="12" '
               f'fill="#b3001b">limit {limit:g} {unit}</text>')
    for k, (key, label, colour) in enumerate(series):
        points = " ".join(f'{x(r["photos"]):.1f},{y(r[key]):.1f}' for r in rows)
        out.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>')
        out += [f'<circle cx="{x(r["photos"]):.1f}" cy="{y(r[key]):.1f}" r="3" fill="{colour}"/>' for r in rows]
        out.append(f'<text x="{left + width - 8}" y="{top + height - 12 - 17 * k}" font-size="13" text-anchor="end" '
                   f'fill="{colour}">'
                   f'{label}</text>')
    out.append(f'<text x="{left + width / 2}" y="{top + height + 38}" font-size="13" '
               f'text-anchor="middle">photos</text>')
    return "\n".join(out)


def draw(rows, path):
    time = panel(rows, 70, "Time, s", "s", [("total_s", "plan and save", "#0072b2"),
                                            ("cpu_s", "processor time of both", "#009e73"),
                                             ("tie_s", "tie views to photos", "#d98200")], LIMIT_S)
    memory = panel(rows, 580, "Memory, MB", "MB", [("peak_mb", "peak, poses included", "#0072b2"),
                                                   ("input_mb", "poses, points, photos", "#d98200")],
                   LIMIT_MB)
    with open(path, "w") as file:
        file.write('<svg xmlns="http://www.w3.org/2000/svg" width="1040" height="430" viewBox="0 0 1040 430" '
                   'fill="#222" '
                   'font-family="DejaVu Sans, Helvetica, Arial, sans-serif">\n'
                   '<title>Planning by number of photos</title>\n'
                   f'<rect width="100%" height="100%" fill="#fff"/>\n{time}\n{memory}\n</svg>\n')


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
    draw(rows, os.path.join(out, "scale.svg"))
    sys.exit(not good)


if __name__ == "__main__":
    main()
