"""One place in every export: glTF, 3D Tiles, LAS, the orthophoto's grid and Earth-centred metres agree to a centimetre.

usage: position.py FOLDER CITY     FOLDER: m.glb, t/ (3D Tiles), p.ply, p.las, o.tif of the city, same --gsd
"""
import json
import math
import os
import struct
import subprocess
import sys

folder, city = sys.argv[1:]
origin = json.load(open(os.path.join(city, "frame.json")))["origin"]
local = "+proj=topocentric +ellps=WGS84 +lat_0={latitude_deg} +lon_0={longitude_deg} +h_0={height_m}".format(**origin)


def path(name):
    return os.path.join(folder, name)


def proj(steps, places):
    text = subprocess.run(["gdaltransform", "-ct", "+proj=pipeline +step " + steps], text=True, check=True,
                          capture_output=True, input="".join("%.9f %.9f %.9f\n" % tuple(p) for p in places)).stdout
    return [[float(v) for v in line.split()] for line in text.splitlines()]


def ecef_of_local(places):
    return proj("+inv " + local, places)


def gltf(name):
    """Its JSON, and its vertices: x east, y up, z south."""
    data = open(path(name), "rb").read()
    (length,) = struct.unpack_from("<I", data, 12)
    root = json.loads(data[20:20 + length])
    view = root["bufferViews"][0]
    return root, [struct.unpack_from("<fff", data, 28 + length + view["byteStride"] * i)
                  for i in range(view["byteLength"] // view["byteStride"])]


def largest(a, b):
    assert len(a) == len(b) > 10, (len(a), len(b))
    return max(math.dist(p, q) for p, q in zip(a, b))


# glTF: its own words say where it is; the places are those of the frame.
root, vertices = gltf("m.glb")
said = root.get("extras", root["asset"].get("extras"))["origin_wgs84"]
assert all(abs(said[k] - origin[k]) < 1e-9 for k in origin if k in said) and len(said) == 4, said
assert said["heights"] == "above the WGS84 ellipsoid", said
known = [(x, -z, y) for x, y, z in vertices[:: len(vertices) // 50]]
earth = ecef_of_local(known)

# 3D Tiles: the same vertices are in the leaves.
tileset = json.load(open(path("t/tileset.json")))
m = tileset["root"]["transform"]
tiles = set()
for name in os.listdir(path("t")):
    if name.endswith(".glb"):
        tiles.update((x, -z, y) for x, y, z in gltf("t/" + name)[1])
assert all(p in tiles for p in known), "a vertex of the mesh is in no tile"
by_tiles = [[sum(m[4 * k + r] * (*p, 1)[k] for k in range(4)) for r in range(3)] for p in known]
tiles_m = largest(by_tiles, earth)

# LAS and PLY: the same points, in UTM and in the frame.
data = open(path("p.ply"), "rb").read()
rows = list(struct.iter_unpack("<dddBBB", data[data.index(b"end_header\n") + 11:]))
las = open(path("p.las"), "rb").read()
first, = struct.unpack_from("<I", las, 96)
length, = struct.unpack_from("<H", las, 105)
count, = struct.unpack_from("<Q", las, 247)
scale, offset = struct.unpack_from("<ddd", las, 131), struct.unpack_from("<ddd", las, 155)
assert count == len(rows)
step = max(1, count // 50)
points = [[s * v + o for s, v, o in zip(scale, struct.unpack_from("<iii", las, first + length * i), offset)]
          for i in range(0, count, step)]
places = [row[:3] for row in rows[::step]]
las_m = largest(proj("+inv +proj=utm +zone=32 +ellps=WGS84 +step +proj=cart +ellps=WGS84", points),
                ecef_of_local(places))

# The sky is opaque and has no depth: taken for a surface, it would put points where the cameras are.
data, at, cameras = open(os.path.join(city, "poses/model/images.bin"), "rb").read(), 8, 0
for _ in range(struct.unpack_from("<Q", data)[0]):
    w, x, y, z, *t = struct.unpack_from("<7d", data, at + 4)
    rotation = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    centre = [-sum(rotation[k][i] * t[k] for k in range(3)) for i in range(3)]
    cameras += any(math.dist(centre, row[:3]) < 1e-3 for row in rows)
    at = data.index(b"\0", at + 64) + 1
    at += 8 + 24 * struct.unpack_from("<Q", data, at)[0]
assert cameras == 0, f"{cameras} cameras have a point where they are"

# The orthophoto's grid: where GDAL finds the pixel of a place is where its own numbers put it.
info = json.loads(subprocess.run(["gdalinfo", "-json", path("o.tif")], capture_output=True, check=True).stdout)
assert "UTM zone 32N" in info["coordinateSystem"]["wkt"]
left, across, _, top, _, down = info["geoTransform"]
assert max(abs(math.remainder(v, across)) for v in (left, top)) < 1e-6 and down == -across
inside = [(p, q) for p, q in zip(places, points) if left < q[0] < left + across * info["size"][0]
          and top - across * info["size"][1] < q[1] < top]
to_utm = "+inv " + local + " +step +inv +proj=cart +ellps=WGS84 +step +proj=utm +zone=32 +ellps=WGS84"
grid_m = largest([q[:2] for q in proj(to_utm, [p for p, _ in inside])], [q[:2] for _, q in inside])
text = subprocess.run(["gdallocationinfo", "-xml", "-geoloc", path("o.tif")], text=True, capture_output=True,
                      check=True, input="".join("%.4f %.4f\n" % (q[0], q[1]) for _, q in inside)).stdout
pixels = [tuple(int(part.split('"')[1]) for part in line.split("=")[1:3]) for line in text.splitlines()
          if line.startswith("<Report")]
assert pixels == [(int((q[0] - left) // across), int((top - q[1]) // across)) for _, q in inside], pixels
print(f"glTF, 3D Tiles, LAS, orthophoto and Earth-centred places: {len(known)} and {len(points)} places agree to "
      f"{max(tiles_m, las_m, grid_m):.6f} m")
assert max(tiles_m, las_m, grid_m) < 0.01
