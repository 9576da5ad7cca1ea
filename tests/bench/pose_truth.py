#!/usr/bin/env python3
"""How far camera centres are from surveyed ones, after the best similarity.

usage: pose_truth.py CITY TRUTH [CITY TRUTH ...]
CITY is a folder that `conurb poses` filled, or any folder with a COLMAP model (binary) in it. TRUTH is the truth folder
of herz-jesus or castle, or one that conurb-synth wrote. Each pair gives a line: photos with a pose, of how many, rms,
largest distance; with the truth of conurb-synth also the rms where the city says that they are on Earth."""
import json
import math
import os
import struct
import sys

CENTRE_LINE = 7  # of a file of the truth, from 0


def read_model(city):
    """Camera centres by the photo's name, out of images.bin."""
    for sub in ("poses/model", "model", "poses", "poses/0", ""):
        path = os.path.join(city, sub, "images.bin")
        if os.path.exists(path):
            break
    else:
        sys.exit(city + ": no images.bin in it; run conurb poses first")
    data = open(path, "rb").read()
    centres, at = {}, 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        _, w, x, y, z, *t = struct.unpack_from("<I7d", data, at)
        at += 64
        end = data.index(b"\0", at)
        name = data[at:end].decode()
        at = end + 1
        at += 8 + 24 * struct.unpack_from("<Q", data, at)[0]
        r = rotation((w, x, y, z))
        centres[os.path.basename(name)] = [-sum(r[k][i] * t[k] for k in range(3)) for i in range(3)]
    return centres


def read_truth(folder):
    if os.path.exists(os.path.join(folder, "model", "images.bin")):
        return read_model(folder)
    centres = {}
    for name in sorted(os.listdir(folder)):
        if name.endswith(".camera"):
            lines = open(os.path.join(folder, name)).read().split("\n")
            centres[name[:-len(".camera")]] = [float(v) for v in lines[CENTRE_LINE].split()]
    return centres


def rotation(q):
    w, x, y, z = q
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]


def frame_of(folder):
    path = os.path.join(folder, "frame.json")
    frame = json.load(open(path)) if os.path.exists(path) else {}
    return frame if frame.get("georeferenced") else None


def earth(frame, lift):
    """The transform from a frame to places relative to the Earth's centre; its heights are lifted."""
    at = frame["origin"]
    lat, lon, h = math.radians(at["latitude_deg"]), math.radians(at["longitude_deg"]), at["height_m"] + lift
    e2 = 0.0066943799901413165
    n = 6378137.0 / math.sqrt(1 - e2 * math.sin(lat) ** 2)
    origin = [(n + h) * math.cos(lat) * math.cos(lon), (n + h) * math.cos(lat) * math.sin(lon),
              (n * (1 - e2) + h) * math.sin(lat)]
    east = [-math.sin(lon), math.cos(lon), 0]
    north = [-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)]
    up = [math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)]
    return lambda p: [origin[k] + p[0] * east[k] + p[1] * north[k] + p[2] * up[k] for k in range(3)]


def middle(points):
    return [sum(p[k] for p in points) / len(points) for k in range(3)]


def largest_eigenvector(m):
    """Of a symmetric 4 x 4 matrix, by Jacobi's rotations."""
    v = [[float(i == j) for j in range(4)] for i in range(4)]
    for _ in range(60):
        for p in range(4):
            for q in range(p + 1, 4):
                angle = 0.5 * math.atan2(2 * m[p][q], m[q][q] - m[p][p])
                c, s = math.cos(angle), math.sin(angle)
                for k in range(4):
                    m[k][p], m[k][q] = c * m[k][p] - s * m[k][q], s * m[k][p] + c * m[k][q]
                for k in range(4):
                    m[p][k], m[q][k] = c * m[p][k] - s * m[q][k], s * m[p][k] + c * m[q][k]
                for k in range(4):
                    v[k][p], v[k][q] = c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]
    best = max(range(4), key=lambda i: m[i][i])
    return [v[k][best] for k in range(4)]


def fit(have, want):
    """The similarity from have to want with the least squares (Horn 1987, closed form by quaternions)."""
    a, b = middle(have), middle(want)
    s = [[sum((p[i] - a[i]) * (q[j] - b[j]) for p, q in zip(have, want)) for j in range(3)] for i in range(3)]
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = s
    r = rotation(largest_eigenvector([[xx + yy + zz, yz - zy, zx - xz, xy - yx],
                                      [yz - zy, xx - yy - zz, xy + yx, zx + xz],
                                      [zx - xz, xy + yx, yy - xx - zz, yz + zy],
                                      [xy - yx, zx + xz, yz + zy, zz - xx - yy]]))
    spread = sum((p[k] - a[k]) ** 2 for p in have for k in range(3))
    scale = sum(r[j][i] * s[i][j] for i in range(3) for j in range(3)) / spread
    return [[b[k] + scale * sum(r[k][i] * (p[i] - a[i]) for i in range(3)) for k in range(3)] for p in have]


def report(city, folder):
    truth, posed = read_truth(folder), read_model(city)
    names = sorted(set(truth) & set(posed))
    if len(names) < 3:
        sys.exit("%s: fewer than three of its photos are in %s" % (city, folder))
    want = [truth[n] for n in names]
    off = [math.dist(p, q) for p, q in zip(fit([posed[n] for n in names], want), want)]
    mine, theirs, placed = frame_of(city), frame_of(folder), ""
    if mine and theirs:
        # conurb-synth counts heights from the sea, and Conurb applies the geoid to them.
        lift = mine["geoid"]["height_m"] if mine["geoid"]["applied"] and not theirs["geoid"]["applied"] else 0
        here, there = earth(mine, 0), earth(theirs, lift)
        apart = [math.dist(here(posed[n]), there(truth[n])) for n in names]
        placed = "; on Earth %.4f m rms" % math.sqrt(sum(v * v for v in apart) / len(apart))
    print("%s: %d of %d photos, %.4f m rms, %.4f m at most%s" %
          (city, len(names), len(truth), math.sqrt(sum(v * v for v in off) / len(off)), max(off), placed))


if len(sys.argv) < 3 or len(sys.argv) % 2 == 0:
    sys.exit(__doc__)
for k in range(1, len(sys.argv), 2):
    report(sys.argv[k], sys.argv[k + 1])
