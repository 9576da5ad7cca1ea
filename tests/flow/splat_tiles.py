"""3D Tiles of splats: every splat is in a leaf, boxes hold what they should, a known place lies where PROJ puts it, and
SPZ says the same as plain attributes.
splat_tiles.py CONURB CITY"""
import gzip
import json
import math
import os
import shutil
import struct
import subprocess
import sys
import tempfile

conurb, demo = sys.argv[1:]
work = tempfile.mkdtemp(prefix="conurb-splat-tiles-")
city, ply, N, KNOWN = f"{work}/demo", f"{work}/s.ply", 45000, (1.25, -3.5, 9.0)
NAMES = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()


def export(*options):
    return subprocess.run([conurb, "export", city, *options], capture_output=True, text=True, check=False)


def glb(path):
    """Its JSON and its binary part."""
    data = open(path, "rb").read()
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20:20 + length]), data[28 + length:]


def values(gltf, binary, name, width):
    accessor = gltf["accessors"][gltf["meshes"][0]["primitives"][0]["attributes"][name]]
    view = gltf["bufferViews"][accessor["bufferView"]]
    return list(struct.iter_unpack(f"<{width}f", binary[view["byteOffset"]:view["byteOffset"] + view["byteLength"]]))


def leaves(tile, box=None):
    own = tile["boundingVolume"]["box"]
    for k in range(3):
        assert box is None or abs(own[k] - box[k]) + own[3 + 4 * k] <= box[3 + 4 * k] + 1e-3, (own, box)
    for child in tile.get("children", []):
        assert child["geometricError"] < tile["geometricError"]
        yield from leaves(child, own)
    if not tile.get("children"):
        assert tile["geometricError"] == 0
        yield tile


shutil.copytree(demo, city)
with open(ply, "wb") as file:
    file.write("\n".join(["ply", "format binary_little_endian 1.0", f"element vertex {N}",
                          *(f"property float {n}" for n in NAMES), "end_header", ""]).encode())
    for i in range(N):
        a, r = i * 2.399963, 15 * math.sqrt(i / N)
        place = KNOWN if i == 0 else (0, 0, 5000) if i == 1 else (r * math.cos(a), r * math.sin(a), 0.1 * (i % 9))
        file.write(struct.pack("<17f", *place, 0, 0, 0, 0.2, 0, -0.2, 3, -3, -3, -5, 1, 0, 0, 0))
found, known = 0, None
for content in ("splats", "spz"):
    done = export("--3dtiles", f"{work}/{content}", "--content", content, "--from", ply)
    assert done.returncode == 0, done.stderr
    tileset = json.load(open(f"{work}/{content}/tileset.json"))
    count = 0
    for leaf in leaves(tileset["root"]):
        gltf, binary = glb(f"{work}/{content}/{leaf['content']['uri']}")
        n = gltf["accessors"][0]["count"]
        assert n <= 20000 and gltf["meshes"][0]["primitives"][0]["mode"] == 0
        assert gltf["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["kernel"] == "ellipse"
        count += n
        if content == "splats":
            places = values(gltf, binary, "POSITION", 3)
            known = known or next((p for p in places if abs(p[1] - KNOWN[2]) < 1e-3), None)
            assert all(abs(s[0] - math.exp(-3)) < 1e-6 for s in
                       values(gltf, binary, "KHR_gaussian_splatting:SCALE", 3)) and len(places) == n
        else:
            packed = gzip.decompress(binary[:gltf["bufferViews"][0]["byteLength"]])
            assert struct.unpack_from("<III", packed) == (0x5053474E, 2, n)
    assert count == N - 1, count  # without the one that lies far beyond the tiles, as the sky does
assert tileset["extensions"]["3DTILES_content_gltf"]["extensionsRequired"][1].endswith("spz_2")
sizes = [sum(os.path.getsize(f"{work}/{c}/{f}") for f in os.listdir(f"{work}/{c}")) for c in ("splats", "spz")]
assert sizes[1] < sizes[0] / 3, sizes

# z up again, then to Earth; PROJ has its own way.
local, m = (known[0], -known[2], known[1]), tileset["root"]["transform"]
assert math.dist(local, KNOWN) < 0.001, local
place = "+lat_0={latitude_deg} +lon_0={longitude_deg} +h_0={height_m}".format(
    **json.load(open(f"{city}/frame.json"))["origin"])
earth = [sum(m[4 * k + r] * (*local, 1)[k] for k in range(4)) for r in range(3)]
text = subprocess.run(["gdaltransform", "-ct", "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 " + place],
                      input="%r %r %r\n" % KNOWN, capture_output=True, text=True, check=True).stdout
off = math.dist(earth, [float(v) for v in text.split()])
assert off < 0.01, off

for code, what, options in ((2, "--3dtiles DIR", ("--content", "splats")), (2, "--content", ("--from", ply)),
                            (6, "/proc/none", ("--3dtiles", "/proc/none/t", "--content", "spz", "--from", ply)),
                            (6, "no.ply", ("--3dtiles", f"{work}/t", "--content", "spz", "--from", f"{work}/no.ply"))):
    done = export(*options)
    assert done.returncode == code and what in done.stderr and done.stderr.count("conurb: ") == 1, done.stderr
assert not os.path.exists(f"{work}/t")
print(f"{N - 1} splats in tiles of {sizes[0] / 1e6:.1f} MB, {sizes[1] / 1e6:.1f} MB by SPZ; PROJ's place of a known "
      f"one is {off:.6f} m away")
shutil.rmtree(work)
