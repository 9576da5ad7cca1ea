"""Checks 3D Tiles: boxes, errors, borders that meet, and places on Earth by PROJ.

usage: tileset.py FOLDER FRAME.json TRIANGLES          TRIANGLES: of the whole mesh
       tileset.py FOLDER FRAME.json TRIANGLES MESH     the tiles are textured and simplified; MESH: a folder of tiles
                                                       that are the whole mesh
"""
import collections
import json
import math
import os
import struct
import subprocess
import sys

folder, frame, triangles = sys.argv[1:4]
mesh = sys.argv[4] if len(sys.argv) > 4 else None
tileset = json.load(open(os.path.join(folder, "tileset.json")))
assert tileset["asset"]["version"] == "1.1" and tileset["asset"]["extras"]["light"], tileset["asset"]


def read(uri):
    """Vertices with z up, as 3D Tiles has glTF, and triangles of a GLB."""
    data = open(os.path.join(folder, uri), "rb").read()
    (length,) = struct.unpack_from("<I", data, 12)
    gltf, at = json.loads(data[20:20 + length]), 28 + length
    places, faces = [], []
    for primitive in gltf["meshes"][0]["primitives"]:
        place, index = (gltf["accessors"][i] for i in (primitive["attributes"]["POSITION"], primitive["indices"]))
        views = [gltf["bufferViews"][a["bufferView"]] for a in (place, index)]
        start = [at + v.get("byteOffset", 0) + a.get("byteOffset", 0) for v, a in zip(views, (place, index))]
        corners = struct.unpack_from(f"<{index['count']}I", data, start[1])
        faces += [[c + len(places) for c in corners[i:i + 3]] for i in range(0, len(corners), 3)]
        places += [struct.unpack_from("<fff", data, start[0] + views[0]["byteStride"] * i)
                   for i in range(place["count"])]
    if "textures" in gltf:
        textured.append(uri)
        assert gltf["asset"]["extras"]["light"] and gltf["asset"]["extras"]["tiles"], gltf["asset"]
    return [(x, -z, y) for x, y, z in places], faces


def deepest(path):
    return max(int(name.split("-")[0]) for name in os.listdir(path) if name.endswith(".glb"))


def files_of(path):
    return sum(name.endswith(".glb") for name in os.listdir(path))


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
sample, textured, leaf_meshes = [], [], []


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
        inner = child["boundingVolume"]["box"]
        for k in range(3):
            assert abs(inner[k] - box[k]) + inner[3 + 4 * k] <= half[k] + 1e-6, (tile["content"], box, inner)
        assert child["geometricError"] <= tile["geometricError"], tile["content"]
    if not below:
        assert tile["geometricError"] == 0
        leaves += len(own[1])
        leaf_meshes.append(own)
    else:
        assert 0 < len(own[1]) <= sum(len(part[1]) for part in below)
        if mesh is not None:  # a texel is as large as a cube, twice that a level higher; 16 pixels show 8 of them
            texel = tileset["asset"]["extras"]["cube_m"] * 2 ** (deepest(folder) - level)
            assert tile["geometricError"] >= 8 * texel, (tile["content"], tile["geometricError"], texel)
        rim = {edge for edge, n in edges_of(below).items() if n == 1}
        missing += len(rim - edges_of([own]).keys())
        rims += len(rim)
    return own


root = tileset["root"]
visit(root, 0)
assert leaves == int(triangles) if mesh is None else leaves < 0.7 * int(triangles), (leaves, triangles)


def open_edges(parts):
    return {edge for edge, n in edges_of(parts).items() if n == 1 and len(edge) == 2}


cracks = 0
if mesh is not None:
    assert len(textured) == files_of(folder), (len(textured), folder)
    rim = open_edges(leaf_meshes)
    folder = mesh
    whole = [read(name) for name in sorted(os.listdir(mesh)) if name.startswith(str(deepest(mesh)) + "-")]
    # At a border: both ends are in two leaves. Inside one, simplification may open an edge that four triangles share.
    leaves_of = collections.Counter(place for places, _ in leaf_meshes for place in set(places))
    cracks = sum(all(leaves_of[place] > 1 for place in edge) for edge in rim - open_edges(whole))
    assert max(leaves_of.values()) > 1 and len(leaf_meshes) > 1, "one leaf has no border"
    print(f"{len(rim)} edges of the leaves are open, {len(open_edges(whole))} of the whole mesh; {cracks} are cracks")
# Of drawing nothing: a viewer loads the root from wherever the city is larger than a few pixels.
assert tileset["geometricError"] >= 2 * max(root["boundingVolume"]["box"][k] for k in (3, 7, 11))
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
assert worst < 0.01 and missing == 0 and cracks == 0
