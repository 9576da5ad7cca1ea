"""The made city's true surface as points, for `conurb eval CITY --geometry POINTS.ply`.

usage: points.py TRUTH CITY POINTS.ply [STRIDE]     TRUTH: of conurb-synth; CITY imported TRUTH/model; every STRIDE-th
                                                    pixel of a view, by default the third. Only places
                                                    where a mesh of the city has its own: nearer to a tile
                                                    than twice its radius. Wants oiiotool.
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
REACH = 2  # compose.reach
FAR_M = 60  # beyond, pixels are wider than what is measured
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


points = array.array("f")
for shot in poses["frames"]:
    name = os.path.splitext(os.path.basename(shot["file_path"]))[0]
    width, height, z = depths(os.path.join(truth, "views", name + ".exr"))
    get = lambda key: shot.get(key, poses.get(key))
    fx, fy, cx, cy = (float(get(k)) * width / float(get("w")) for k in ("fl_x", "fl_y", "cx", "cy"))
    m = shot["transform_matrix"]
    k1, k2, p1, p2 = (get(k) or 0 for k in ("k1", "k2", "p1", "p2"))
    for y in range(stride // 2, height, stride):
        for x in range(stride // 2, width, stride):
            far = z[y * width + x] * 0.002
            if not 0 < far < FAR_M:
                continue
            seen = u, v = (x + 0.5 - cx) / fx, (y + 0.5 - cy) / fy
            for _ in range(6): # the lens
                square = u * u + v * v
                bend = 1 + k1 * square + k2 * square * square
                u, v = ((seen[0] - 2 * p1 * u * v - p2 * (square + 2 * u * u)) / bend,
                        (seen[1] - 2 * p2 * u * v - p1 * (square + 2 * v * v)) / bend)
            ray = (u, -v, -1)
            far /= math.hypot(*ray)
            place = [m[r][3] + far * sum(m[r][k] * ray[k] for k in range(3)) for r in range(3)]
            place = [scale * sum(turn[3 * r + k] * place[k] for k in range(3)) + shift[r] for r in range(3)]
            if any(math.dist(place[:2], tile["centre"][:2]) < REACH * tile["radius_m"] for tile in tiles):
                points.extend(place)
if sys.byteorder == "big":
    points.byteswap()
with open(out, "wb") as file:
    file.write(b"ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\nproperty float y\n"
               b"property float z\nend_header\n" % (len(points) // 3))
    points.tofile(file)
print(len(points) // 3, "points")
