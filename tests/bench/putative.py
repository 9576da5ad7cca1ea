#!/usr/bin/env python3
"""Whether Conurb's matches, before verification, are those of COLMAP's rules.

usage: putative.py BENCH_PAIRS OUT N CITY...    CITY: a city that has been through `conurb poses`

Takes N pairs of each city that have matches, evenly from its database, and matches them anew in copies in OUT: by
`colmap matches_importer`, and by Conurb. Prints how many matches each has and how many both have. Every match that
only one of them has is then looked up: all distances of its two descriptors are computed here, in whole numbers, and
COLMAP's rules (nearest both ways, at most 0.7 radians, below 0.8 of the second) say who is right. Needs COLMAP, whose
own program searches approximately.
"""
import math
import os
import shutil
import sqlite3
import struct
import subprocess
import sys

MAX_RATIO, MAX_DISTANCE, BASE = 0.8, 0.7, 2147483647


def sample(city, path, n):
    """A copy of the city's features, and n of its pairs that have matches."""
    shutil.copyfile(os.path.join(city, "poses", "database.db"), path)
    base = sqlite3.connect(path)
    names = dict(base.execute("SELECT image_id, name FROM images"))
    rows = [row[0] for row in base.execute("SELECT pair_id FROM matches WHERE rows > 0 ORDER BY pair_id")]
    pairs = [divmod(rows[i * len(rows) // n], BASE) for i in range(min(n, len(rows)))]
    base.execute("DELETE FROM matches")
    base.execute("DELETE FROM two_view_geometries")
    base.commit()
    base.close()
    return pairs, [f"{names[a]} {names[b]}\n" for a, b in pairs]


def matches(path, pair):
    row = sqlite3.connect(path).execute("SELECT rows, data FROM matches WHERE pair_id = ?",
                                        (pair[0] * BASE + pair[1],)).fetchone()
    return set(struct.iter_unpack("<II", row[1][:8 * row[0]])) if row and row[0] else set()


def descriptors(path, image):
    rows, data = sqlite3.connect(path).execute("SELECT rows, data FROM descriptors WHERE image_id = ?",
                                               (image,)).fetchone()
    return [data[128 * i:128 * (i + 1)] for i in range(rows)]


def nearest(one, others):
    """Index of the nearest, or None where the rules refuse it."""
    products = [sum(map(int.__mul__, one, other)) for other in others]
    best = max(range(len(products)), key=products.__getitem__)
    angles = sorted((math.acos(min(products[i] / 512 ** 2, 1)) for i in range(len(products))))[:2]
    if angles[0] > MAX_DISTANCE or (len(angles) > 1 and angles[0] >= MAX_RATIO * angles[1]):
        return None
    return best


def is_match(a, b, i, j):
    return nearest(a[i], b) == j and nearest(b[j], a) == i


def main():
    bench, out, n, cities = sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4:]
    os.makedirs(out, exist_ok=True)
    for city in cities:
        name = os.path.basename(os.path.normpath(city))
        theirs, ours, listed = (os.path.join(out, name + end) for end in (".colmap.db", ".conurb.db", ".txt"))
        pairs, lines = sample(city, theirs, n)
        shutil.copyfile(theirs, ours)
        with open(listed, "w", encoding="utf-8") as stream:
            stream.writelines(lines)
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "check": True}
        subprocess.run(["colmap", "matches_importer", "--database_path", theirs, "--match_list_path", listed,
                        "--match_type", "pairs", "--SiftMatching.use_gpu", "0"], **quiet)
        subprocess.run([bench, ours, listed], **quiet)
        count = dict.fromkeys(("colmap", "conurb", "both", "colmap wrong", "conurb misses", "conurb wrong"), 0)
        for pair in pairs:
            c, m = matches(theirs, pair), matches(ours, pair)
            if not m and len(c) < 15:
                continue  # too few to be kept
            a, b = descriptors(ours, pair[0]), descriptors(ours, pair[1])
            count["colmap"] += len(c)
            count["conurb"] += len(m)
            count["both"] += len(c & m)
            for i, j in c - m:
                count["conurb misses" if is_match(a, b, i, j) else "colmap wrong"] += 1
            for i, j in m - c:
                count["conurb wrong"] += not is_match(a, b, i, j)
        print(f"{name}: {len(pairs)} pairs; matches of COLMAP {count['colmap']}, of Conurb {count['conurb']}, of both "
              f"{count['both']}; by the rules Conurb misses {count['conurb misses']} and has {count['conurb wrong']} "
              f"too many, COLMAP has {count['colmap wrong']} too many and misses "
              f"{count['conurb'] - count['both'] - count['conurb wrong']}")


main()
