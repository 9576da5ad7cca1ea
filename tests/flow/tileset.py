"""Checks 3D Tiles: boxes, errors, borders that meet, and places on Earth by PROJ.

usage: tileset.py FOLDER FRAME.json TRIANGLES     TRIANGLES: of the whole mesh
"""
import collections
import json
import math
import os
import struct
import subprocess
import sys

folder, frame, triangles = sys.argv[1:]
tileset = json.load(open(os.path.join(folder, "tileset.json")))
assert tileset["asset"]["version"] == "1.1" and tileset["asset"]["extras"]["light"], tileset["asset"]


def read(uri):
    """Vertices with z up, as 3D Tiles has glTF, and triangles of a GLB."""
    data = open(os.path.join(folder, uri), "rb").read()
    (length,) = struct.unpack_from("<I", data, 12)
    gltf, at = json.loads(data[20:20 + length]), 28 + length
    count = [a["count"] for a in gltf["accessors"]]
    places = [struct.unpack_from("<fff", data, at + 32 * i) for i in range(count[0])]
    start = at + gltf["bufferViews"][1]["byteOffset"]
    corners = struct.unpack_from(f"<{count[3]}I", data, start)
    return [(x, -z, y) for x, y, z in places], [corners[i:i + 3] for i in range(0, len(corners), 3)]


def edges_of(parts):
    """How many triangles have an edge, by its places."""
    edges = collections.Counter()
    for places, faces in parts:
        for a, b, c in faces:
            for p, q in ((a, b), (b, c), (c, a)):
                edges[frozenset((places[p], places[q]))] += 1
    return edges


leaves = levels = 0
missing = rims = 0
sample = []


def visit(tile, level):
    """A tile's mesh, after its own checks and its children's."""
    global leaves, levels, missing, rims
    levels = max(levels, level + 1)
    own = read(tile["content"]["uri"])
    box = tile["boundingVolume"]["box"]
    half = (box[3], box[7], box[11])
    for place in own[0]:
        assert all(abs(place[k] - box[k]) <= half[k] + 1e-3 for k in range(3)), (tile["content"], place, box)
    sample.extend(own[0][:: max(1, len(own[0]) // 20)])
    below = [visit(child, level + 1) for child in tile.get("children", [])]
    for child in tile.get("children", []):
        assert child["geometricError"] <= tile["geometricError"], tile["content"]
    if not below:
        assert tile["geometricError"] == 0
        leaves += len(own[1])
    else:
        assert 0 < len(own[1]) <= sum(len(part[1]) for part in below)
        rim = {edge for edge, n in edges_of(below).items() if n == 1}
        missing += len(rim - edges_of([own]).keys())
        rims += len(rim)
    return own


root = tileset["root"]
visit(root, 0)
assert leaves == int(triangles), (leaves, triangles)
assert tileset["geometricError"] >= root["geometricError"] > 0

# Where PROJ puts local places: from the frame's origin to Earth-centred metres.
origin = json.load(open(frame))["origin"]
place = "+lat_0={latitude_deg} +lon_0={longitude_deg} +h_0={height_m}".format(**origin)
text = subprocess.run(["gdaltransform", "-ct", "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 " + place],
                      input="".join("%.9f %.9f %.9f\n" % p for p in sample), capture_output=True, text=True,
                      check=True).stdout
m, worst = root["transform"], 0
for p, line in zip(sample, text.splitlines(), strict=True):
    x = [sum(m[4 * k + r] * (*p, 1)[k] for k in range(4)) for r in range(3)]
    worst = max(worst, math.dist(x, [float(v) for v in line.split()]))
print(f"{levels} levels, {leaves} triangles; PROJ's places are {worst:.6f} m away at most; of {rims} edges at borders "
      f"{missing} are not in the tile above")
assert worst < 0.01 and missing == 0
