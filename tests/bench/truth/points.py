"""The made city's true surface as points, for `conurb eval CITY --geometry POINTS.ply`.

usage: points.py TRUTH CITY POINTS.ply [STRIDE [SEEN]]
TRUTH: of conurb-synth; CITY imported TRUTH/model; every STRIDE-th pixel of a view, by default the third; only places
that at least SEEN views show, by default 1. Only places where a mesh of the city has its own: nearer to a tile than
twice its radius. Wants oiiotool.
"""
import array
import json
import math
import os
import struct
import subprocess
import sys
import tempfile

truth, city, out = sys.argv[1:4]
stride = int(sys.argv[4]) if len(sys.argv) > 4 else 3
seen = int(sys.argv[5]) if len(sys.argv) > 5 else 1
REACH = 2  # compose.reach
SAME = 0.02  # of the distance, within which two views show the same place
FAR_M = 60  # beyond, pixels are wider than what is measured
if not any(line.startswith("  import:") for line in open(os.path.join(city, "city.yaml"))):
    sys.exit(f"{city} has poses of its own; import {truth}/model")
frame = json.load(open(os.path.join(city, "frame.json")))["local_from_source"]
turn, scale, shift = frame["rotation"], frame["scale"], frame["translation"]
poses = json.load(open(os.path.join(truth, "transforms.json")))
tiles = json.load(open(os.path.join(city, "plan", "plan.json")))["tiles"]


def depths(path):
    """Width, height and distances along the rays, in steps of 2 mm."""
    with tempfile.TemporaryDirectory() as folder:
        name = os.path.join(folder, "depth.sgi") # OpenImageIO 2.4 writes a PGM of 16 bits with 8 bits of them
        subprocess.run(["oiiotool", path, "--ch", "Z", "--divc", "131.07", "-d", "uint16", "-o", name], check=True)
        data = open(name, "rb").read()
    width, height = struct.unpack_from(">HH", data, 6)
    values = array.array("H", data[512:])
    assert data[2:4] == b"\0\2" and len(values) == width * height, "the file is compressed, or has another depth"
    if sys.byteorder == "little":
        values.byteswap()
    rows = [values[y * width:(y + 1) * width] for y in reversed(range(height))] # the lowest row comes first
    return width, height, [z for row in rows for z in row]


class View:
    """A view of the truth: places of pixels, and whether it shows a place."""

    def __init__(self, shot):
        name = os.path.splitext(os.path.basename(shot["file_path"]))[0]
        self.width, self.height, self.z = depths(os.path.join(truth, "views", name + ".exr"))
        get = lambda key: shot.get(key, poses.get(key))
        self.f = [float(get(k)) * self.width / float(get("w")) for k in ("fl_x", "fl_y")]
        self.c = [float(get(k)) * self.width / float(get("w")) for k in ("cx", "cy")]
        self.lens = [get(k) or 0 for k in ("k1", "k2", "p1", "p2")]
        self.m = shot["transform_matrix"]

    def bent(self, u, v):
        k1, k2, p1, p2 = self.lens
        square = u * u + v * v
        bend = 1 + k1 * square + k2 * square * square
        return (u * bend + 2 * p1 * u * v + p2 * (square + 2 * u * u),
                v * bend + 2 * p2 * u * v + p1 * (square + 2 * v * v))

    def place(self, x, y):
        far = self.z[y * self.width + x] * 0.002
        if not 0 < far < FAR_M:
            return None
        u, v = goal = (x + 0.5 - self.c[0]) / self.f[0], (y + 0.5 - self.c[1]) / self.f[1]
        for _ in range(6):
            at = self.bent(u, v)
            u, v = u + goal[0] - at[0], v + goal[1] - at[1]
        ray = (u, -v, -1)
        far /= math.hypot(*ray)
        return [self.m[r][3] + far * sum(self.m[r][k] * ray[k] for k in range(3)) for r in range(3)]

    def shows(self, place):
        away = [place[r] - self.m[r][3] for r in range(3)]
        x, y, z = (sum(self.m[r][k] * away[r] for r in range(3)) for k in range(3))
        if z > -0.1 or max(abs(x), abs(y)) > -2 * z:
            return False
        u, v = self.bent(-x / z, y / z)
        x, y = int(u * self.f[0] + self.c[0]), int(v * self.f[1] + self.c[1])
        if not (0 <= x < self.width and 0 <= y < self.height):
            return False
        far = math.hypot(*away)
        return abs(self.z[y * self.width + x] * 0.002 - far) < SAME * far


views = [View(shot) for shot in poses["frames"]]
points = array.array("f")
for own in views:
    others = [v for v in views if v is not own]
    others.sort(key=lambda v: math.dist([v.m[r][3] for r in range(3)], [own.m[r][3] for r in range(3)]))
    for y in range(stride // 2, own.height, stride):
        for x in range(stride // 2, own.width, stride):
            place = own.place(x, y)
            if not place:
                continue
            count = 1
            for other in others:
                if count >= seen:
                    break
                count += other.shows(place)
            local = [scale * sum(turn[3 * r + k] * place[k] for k in range(3)) + shift[r] for r in range(3)]
            if count >= seen and any(math.dist(local[:2], tile["centre"][:2]) < REACH * tile["radius_m"]
                                     for tile in tiles):
                points.extend(local)
if sys.byteorder == "big":
    points.byteswap()
with open(out, "wb") as file:
    file.write(b"ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\nproperty float y\n"
               b"property float z\nend_header\n" % (len(points) // 3))
    points.tofile(file)
print(len(points) // 3, "points")
