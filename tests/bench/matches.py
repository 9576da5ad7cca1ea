#!/usr/bin/env python3
"""Conurb's matching beside COLMAP's, on the same pairs of the same features.

usage: matches.py BENCH_PAIRS OUT CITY...    CITY: a city that has been through `conurb poses`

For each city, the pairs in its database are matched anew twice, in copies in OUT: by `colmap matches_importer`, and by
Conurb with COLMAP's verification. Prints seconds by the clock and of the processor, and how many of COLMAP's verified
matches Conurb's run has too. Needs COLMAP. OUT keeps the databases; what is there already is not done again.
"""
import json
import os
import resource
import shutil
import sqlite3
import struct
import subprocess
import sys
import time


def timed(command):
    """Seconds by the clock, and of the processor."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.time()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.time() - start, cpu


def copy_features(city, path):
    """A copy of the city's database without matches, and its pairs as lines of two names."""
    shutil.copyfile(os.path.join(city, 'poses', 'database.db'), path)
    base = sqlite3.connect(path)
    names = dict(base.execute('SELECT image_id, name FROM images'))
    pairs = [divmod(row[0], 2147483647) for row in base.execute('SELECT pair_id FROM matches ORDER BY pair_id')]
    base.execute('DELETE FROM matches')
    base.execute('DELETE FROM two_view_geometries')
    base.commit()
    base.execute('VACUUM')
    base.close()
    return [f'{names[a]} {names[b]}\n' for a, b in pairs]


def verify(database, pairs):
    return timed(['colmap', 'matches_importer', '--database_path', database, '--match_list_path', pairs,
                  '--match_type', 'pairs', '--SiftMatching.use_gpu', '0'])


def verified(path):
    """Set of matches of each verified pair."""
    out = {}
    base = sqlite3.connect(path)
    for pair, rows, data in base.execute('SELECT pair_id, rows, data FROM two_view_geometries WHERE rows > 0'):
        out[pair] = set(struct.iter_unpack('<II', data[:8 * rows]))
    base.close()
    return out


def main():
    bench, out, cities = sys.argv[1], sys.argv[2], sys.argv[3:]
    os.makedirs(out, exist_ok=True)
    for city in cities:
        name = os.path.basename(os.path.normpath(city))
        endings = '.colmap.db', '.conurb.db', '.txt', '.json'
        theirs, ours, pairs, note = (os.path.join(out, name + end) for end in endings)
        if not os.path.exists(note):
            lines = copy_features(city, theirs)
            shutil.copyfile(theirs, ours)
            with open(pairs, 'w', encoding='utf-8') as stream:
                stream.writelines(lines)
            times = {'colmap': verify(theirs, pairs), 'match': timed([bench, ours, pairs]),
                     'verify': verify(ours, pairs)}
            with open(note, 'w', encoding='utf-8') as stream:
                json.dump({'pairs': len(lines), **times}, stream)
        with open(note, encoding='utf-8') as stream:
            t = json.load(stream)
        a, b = verified(theirs), verified(ours)
        n_a, n_b = (sum(map(len, x.values())) for x in (a, b))
        shared = sum(len(matches & b.get(pair, set())) for pair, matches in a.items())
        both = [t['match'][k] + t['verify'][k] for k in (0, 1)]
        print(f'{name}: {t["pairs"]} pairs; COLMAP {t["colmap"][0]:.1f} s ({t["colmap"][1]:.1f} s of processor); '
              f'Conurb {t["match"][0]:.1f} s ({t["match"][1]:.1f}) and verification {t["verify"][0]:.1f} s '
              f'({t["verify"][1]:.1f}): {t["colmap"][0] / both[0]:.1f} times as fast '
              f'({t["colmap"][1] / both[1]:.1f} by processor); verified pairs {len(a)}, {len(b)}; '
              f'verified matches {n_a}, {n_b} ({100 * n_b / n_a:.1f} %), of COLMAP\'s {100 * shared / n_a:.1f} %')


main()
