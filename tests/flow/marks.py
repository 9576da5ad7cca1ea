#!/usr/bin/env python3
"""Control points of a synthetic city: places of its sparse points, and their marks in photos by the true poses.

usage: marks.py TRUTH OUT N NOISE_PX FORMAT     FORMAT: list (gcp_list.txt), table (CSV) or json (OpenSfM)
Heights are above the sea, as the photos' altitudes are.
Points are spread as far as they go; each has about 12 marks, off by a normal error of NOISE_PX pixels.
"""
import json, math, os, random, struct, sys

A, F = 6378137.0, 1 / 298.257223563
E2 = F * (2 - F)
LENSES = {0: 3, 1: 4, 2: 4, 3: 5, 4: 8, 5: 8}


def read_model(folder):
    def numbers(file, kinds):
        return struct.unpack("<" + kinds, file.read(struct.calcsize("<" + kinds)))

    cameras, images, points = {}, {}, []
    with open(os.path.join(folder, "cameras.bin"), "rb") as f:
        for _ in range(numbers(f, "Q")[0]):
            number, lens, width, height = numbers(f, "iiQQ")
            cameras[number] = (lens, width, height, numbers(f, "%dd" % LENSES[lens]))
    with open(os.path.join(folder, "images.bin"), "rb") as f:
        for _ in range(numbers(f, "Q")[0]):
            number, *pose, camera = numbers(f, "i7di")
            name = b""
            while (c := f.read(1)) != b"\0":
                name += c
            f.seek(24 * numbers(f, "Q")[0], 1)
            images[number] = (name.decode(), camera, pose)
    with open(os.path.join(folder, "points3D.bin"), "rb") as f:
        for _ in range(numbers(f, "Q")[0]):
            _, x, y, z, _, _, _, _, n = numbers(f, "Q3d3BdQ")
            track = numbers(f, "%di" % (2 * n))
            points.append(((x, y, z), track[::2]))
    return cameras, images, points


def project(camera, pose, at):
    lens, width, height, p = camera
    w, x, y, z = pose[:4]
    rows = ((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))
    cam = [sum(r * c for r, c in zip(row, at)) + t for row, t in zip(rows, pose[4:])]
    u, v = cam[0] / cam[2], cam[1] / cam[2]
    fx, fy, cx, cy = (p[0], p[1], p[2], p[3]) if lens in (1, 4) else (p[0], p[0], p[1], p[2])
    k = {2: (p[3:] + (0, 0, 0)), 3: (p[3:] + (0, 0)), 4: p[4:]}.get(lens, (0, 0, 0, 0))[:4]
    s = u * u + v * v
    radial = 1 + s * (k[0] + s * k[1])
    x = u * radial + 2 * k[2] * u * v + k[3] * (s + 2 * u * u)
    y = v * radial + 2 * k[3] * u * v + k[2] * (s + 2 * v * v)
    return fx * x + cx, fy * y + cy, width, height


def to_geodetic(origin, enu):
    """East, north, up about the origin to latitude, longitude, height."""
    lat, lon = math.radians(origin["latitude_deg"]), math.radians(origin["longitude_deg"])
    n = A / math.sqrt(1 - E2 * math.sin(lat) ** 2)
    h = origin["height_m"]
    ecef = [(n + h) * math.cos(lat) * math.cos(lon), (n + h) * math.cos(lat) * math.sin(lon),
            (n * (1 - E2) + h) * math.sin(lat)]
    e, north, up = enu
    ecef[0] += -math.sin(lon) * e - math.sin(lat) * math.cos(lon) * north + math.cos(lat) * math.cos(lon) * up
    ecef[1] += math.cos(lon) * e - math.sin(lat) * math.sin(lon) * north + math.cos(lat) * math.sin(lon) * up
    ecef[2] += math.cos(lat) * north + math.sin(lat) * up
    p = math.hypot(ecef[0], ecef[1])
    lat, h = math.atan2(ecef[2], p * (1 - E2)), 0.0
    for _ in range(10):
        n = A / math.sqrt(1 - E2 * math.sin(lat) ** 2)
        h = p / math.cos(lat) - n
        lat = math.atan2(ecef[2], p * (1 - E2 * n / (n + h)))
    return math.degrees(lat), math.degrees(math.atan2(ecef[1], ecef[0])), h


def to_utm(lat, lon, zone):
    """Krueger's series, exact to well below a millimetre in a zone."""
    n = F / (2 - F)
    a = A / (1 + n) * (1 + n ** 2 / 4 + n ** 4 / 64)
    alpha = (n / 2 - 2 * n ** 2 / 3 + 5 * n ** 3 / 16, 13 * n ** 2 / 48 - 3 * n ** 3 / 5, 61 * n ** 3 / 240)
    phi, off = math.radians(lat), math.radians(lon - (6 * zone - 183))
    e = 2 * math.sqrt(n) / (1 + n)
    t = math.sinh(math.atanh(math.sin(phi)) - e * math.atanh(e * math.sin(phi)))
    xi, eta = math.atan2(t, math.cos(off)), math.atanh(math.sin(off) / math.sqrt(1 + t * t))
    x = eta + sum(c * math.cos(2 * (j + 1) * xi) * math.sinh(2 * (j + 1) * eta) for j, c in enumerate(alpha))
    y = xi + sum(c * math.sin(2 * (j + 1) * xi) * math.cosh(2 * (j + 1) * eta) for j, c in enumerate(alpha))
    return 500000 + 0.9996 * a * x, 0.9996 * a * y


def centre(pose):
    w, x, y, z = pose[:4]
    columns = ((1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
               (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
               (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)))
    return [-sum(c * t for c, t in zip(column, pose[4:])) for column in columns]


def widest(images, point):
    """The largest angle between two rays to the point, in degrees."""
    rays = []
    for number in set(point[1]):
        ray = [a - b for a, b in zip(point[0], centre(images[number][2]))]
        rays.append([r / math.hypot(*ray) for r in ray])
    return max(math.degrees(math.acos(min(1, max(-1, sum(a * b for a, b in zip(r, q)))))) for r in rays for q in rays)


def spread(points, images, n):
    """Points that many photos see from different sides, each as far from the others as it goes."""
    points = [p for p in points if len(set(p[1])) >= 6 and widest(images, p) > 30] or points
    chosen = [points[0]]
    while len(chosen) < n:
        chosen.append(max(points, key=lambda p: min(math.dist(p[0], c[0]) for c in chosen)))
    return chosen


def main():
    truth, out, n, noise, kind = sys.argv[1:]
    with open(os.path.join(truth, "frame.json")) as f:
        origin = json.load(f)["origin"]
    cameras, images, points = read_model(os.path.join(truth, "model"))
    chance = random.Random(5)
    lines, table, listed = ["WGS84 UTM 32N"], ["EPSG:32632", "name,x,y,z,photo,px,py"], []
    for i, (at, track) in enumerate(spread(points, images, int(n))):
        name = "G%d" % (i + 1)
        lat, lon, h = to_geodetic(origin, at)
        x, y = to_utm(lat, lon, 32)
        table.append("%s,%.4f,%.4f,%.4f,,," % (name, x, y, h))
        marks = []
        seen = sorted(set(track))
        for number in seen[::max(1, len(seen) // 12)]:
            photo, camera, pose = images[number]
            u, v, width, height = project(cameras[camera], pose, at)
            # Pixels of these files have the centre of the first one at 0, 0.
            u, v = u + chance.gauss(0, float(noise)) - 0.5, v + chance.gauss(0, float(noise)) - 0.5
            if not (0 <= u < width - 1 and 0 <= v < height - 1):
                continue
            lines.append("%.4f %.4f %.4f %.3f %.3f %s %s" % (x, y, h, u, v, photo, name))
            table.append("%s,,,,%s,%.3f,%.3f" % (name, photo, u, v))
            unit = max(width, height)
            place = [(u + 0.5 - width / 2) / unit, (v + 0.5 - height / 2) / unit]
            marks.append({"shot_id": photo, "projection": place})
        listed.append({"id": name, "position": {"latitude": lat, "longitude": lon, "altitude": h},
                       "observations": marks})
    with open(out, "w") as f:
        f.write(json.dumps({"points": listed}) if kind == "json" else "\n".join(table if kind == "table" else lines))
        f.write("\n")


main()
