#!/usr/bin/env python3
"""Orthophoto and surface model against the sparse points of the city's COLMAP model.

    tests/bench/dsm.py CITY [--dsm F.tif] [--ortho F.tif]      by default CITY/export/{dsm,ortho}.tif

Prints the median absolute difference of heights and how many points are farther off, the ortho's zone, its corners
against those of the points that lie in it, and by how many metres the ortho would have to move for its colours to fit
the points' best. Needs GDAL's programs and a georeferenced city. The points come from COLMAP and go to UTM by PROJ:
nothing here is Conurb's own."""
import argparse
import array
import json
import math
import os
import struct
import subprocess
import sys
import tempfile

A, F = 6378137.0, 1 / 298.257223563
E2 = F * (2 - F)


def read_points(path):
    with open(path, "rb") as f:
        (n,) = struct.unpack("<Q", f.read(8))
        points = []
        for _ in range(n):
            record = struct.unpack("<QdddBBBd", f.read(43))
            (track,) = struct.unpack("<Q", f.read(8))
            f.read(8 * track)
            if track >= 3:
                points.append((record[1:4], record[4:7]))
        return points


def to_geodetic(origin, local):
    """East-north-up about origin (latitude, longitude, height) to the same, through ECEF."""
    lat, lon, h = math.radians(origin[0]), math.radians(origin[1]), origin[2]
    n = A / math.sqrt(1 - E2 * math.sin(lat) ** 2)
    sl, cl, so, co = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    e, north, u = local
    x = (n + h) * cl * co - so * e - sl * co * north + cl * co * u
    y = (n + h) * cl * so + co * e - sl * so * north + cl * so * u
    z = (n * (1 - E2) + h) * sl + cl * north + sl * u
    p, phi = math.hypot(x, y), lat
    for _ in range(5):
        n = A / math.sqrt(1 - E2 * math.sin(phi) ** 2)
        phi = math.atan2(z + E2 * n * math.sin(phi), p)
    n = A / math.sqrt(1 - E2 * math.sin(phi) ** 2)
    return math.degrees(phi), math.degrees(math.atan2(y, x)), p / math.cos(phi) - n


class Raster:
    def __init__(self, path, scratch):
        info = json.loads(subprocess.run(["gdalinfo", "-json", path], check=True, capture_output=True).stdout)
        self.path, (self.width, self.height), self.transform = path, info["size"], info["geoTransform"]
        self.metadata, self.bands = info["metadata"].get("", {}), len(info["bands"])
        self.layout = info["metadata"].get("IMAGE_STRUCTURE", {}).get("LAYOUT")
        wkt = info["coordinateSystem"]["wkt"]
        self.epsg = int(wkt.rsplit('ID["EPSG",', 1)[1].split("]")[0])
        self.raw = os.path.join(scratch, os.path.basename(path) + ".raw")
        subprocess.run(["gdal_translate", "-q", "-of", "ENVI", "-co", "INTERLEAVE=BIP", path, self.raw], check=True)
        self.data = array.array("f" if self.bands == 1 else "B")
        with open(self.raw, "rb") as f:
            self.data.frombytes(f.read())

    def at(self, east, north):
        x, y = int((east - self.transform[0]) / self.transform[1]), int((north - self.transform[3]) / self.transform[5])
        if east < self.transform[0] or north > self.transform[3] or x >= self.width or y >= self.height:
            return None
        at = (y * self.width + x) * self.bands
        value = self.data[at:at + self.bands]
        return None if (value[0] == -9999 if self.bands == 1 else value[3] == 0) else value


def median(values):
    values = sorted(values)
    return values[len(values) // 2]


def heights(dsm, points):
    off = [dsm.at(e, n)[0] - h for (e, n), h, _ in points if dsm.at(e, n)]
    if not off:
        sys.exit(f"{dsm.path}: no point lies on the surface model")
    size = [abs(d) for d in off]
    far = {limit: sum(s > limit for s in size) for limit in (1, 2, 5)}
    print(f"surface model: EPSG:{dsm.epsg}, {dsm.layout or 'not a COG'}, "
          f"{dsm.metadata.get('HEIGHTS', 'heights unknown')}")
    print(f"  {len(off)} of {len(points)} points lie on it ({len(points) - len(off)} where it has no data)")
    print(f"  median absolute difference {median(size):.3f} m, median difference {median(off):+.3f} m")
    print("  outliers: " + ", ".join(f"{n} beyond {limit} m ({100 * n / len(off):.1f} %)" for limit, n in far.items()))


def colours(ortho, points):
    """Mean difference of colours, were the ortho moved; both are taken relative to their means, as exposure differs."""
    def difference(dx, dy):
        pairs = [(ortho.at(e - dx, n - dy), rgb) for (e, n), _, rgb in points]
        pairs = [(a, b) for a, b in pairs if a]
        means = [[sum(p[side][c] for p in pairs) / len(pairs) for c in range(3)] for side in (0, 1)]
        off = (abs((a[c] - means[0][c]) - (b[c] - means[1][c])) for a, b in pairs for c in range(3))
        return sum(off) / len(pairs) / 3

    steps = [i * 0.25 for i in range(-12, 13)]
    best = min(((difference(dx, dy), dx, dy) for dx in steps for dy in steps))
    inside = [(e, n) for (e, n), _, _ in points if ortho.at(e, n)]
    t, corner = ortho.transform, (ortho.transform[0], ortho.transform[3])
    print(f"orthophoto: EPSG:{ortho.epsg}, {ortho.layout or 'not a COG'}, "
          f"{ortho.width} x {ortho.height} pixels of {t[1]:g} m")
    other = (corner[0] + ortho.width * t[1], corner[1] + ortho.height * t[5])
    print(f"  corners {corner[0]:.2f} {corner[1]:.2f} to {other[0]:.2f} {other[1]:.2f}; "
          f"points in it {min(e for e, _ in inside):.2f} {max(n for _, n in inside):.2f} to "
          f"{max(e for e, _ in inside):.2f} {min(n for _, n in inside):.2f}")
    print(f"  fits the points best when moved by {best[1]:+.2f} m east, {best[2]:+.2f} m north "
          f"(colour difference {best[0]:.2f}; unmoved {difference(0, 0):.2f})")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("city")
    parser.add_argument("--dsm")
    parser.add_argument("--ortho")
    args = parser.parse_args()
    with open(os.path.join(args.city, "frame.json")) as f:
        frame = json.load(f)
    if not frame["georeferenced"]:
        sys.exit(f"{args.city} has no georeference")
    origin = [frame["origin"][k] for k in ("latitude_deg", "longitude_deg", "height_m")]
    local = read_points(os.path.join(args.city, "poses/model/points3D.bin"))
    places = [to_geodetic(origin, p) for p, _ in local]
    zone = int((origin[1] + 180) // 6) + 1
    epsg = (32600 if origin[0] >= 0 else 32700) + zone
    program = ["gdaltransform", "-s_srs", "EPSG:4326", "-t_srs", f"EPSG:{epsg}", "-output_xy"]
    lines = subprocess.run(program, check=True, text=True, capture_output=True,
                           input="".join(f"{lon:.12f} {lat:.12f}\n" for lat, lon, _ in places)).stdout
    flat = [tuple(map(float, line.split())) for line in lines.splitlines()]
    points = [(xy, place[2], rgb) for xy, place, (_, rgb) in zip(flat, places, local)]
    dsm = args.dsm or os.path.join(args.city, "export/dsm.tif")
    ortho = args.ortho or os.path.join(args.city, "export/ortho.tif")
    with tempfile.TemporaryDirectory() as scratch:
        for path, check in ((dsm, heights), (ortho, colours)):
            if os.path.exists(path):
                raster = Raster(path, scratch)
                if raster.epsg != epsg:
                    print(f"{path}: EPSG:{raster.epsg}, but the place is in EPSG:{epsg}")
                check(raster, points)


if __name__ == "__main__":
    main()
