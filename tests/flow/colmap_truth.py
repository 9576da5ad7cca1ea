#!/usr/bin/env python3
"""Plays COLMAP for the test of groups: its mapper gives the true poses of the photos that it was asked for, moved,
turned and scaled by group, with some noise. TRUTH_MODEL is the model that conurb-synth wrote.

MAPPER_FAILS: a part of the path of a database for which the mapper finds nothing. MAPPER_WAITS: one for which it takes
a minute."""
import hashlib, math, os, random, sqlite3, struct, sys, time

TABLES = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, model INTEGER, width INTEGER, height INTEGER, params BLOB,
    prior_focal_length INTEGER);
CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT UNIQUE, camera_id INTEGER, prior_qw REAL, prior_qx REAL,
    prior_qy REAL, prior_qz REAL, prior_tx REAL, prior_ty REAL, prior_tz REAL);
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
CREATE TABLE matches (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB, config INTEGER,
    F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB);
"""


def option(name):
    return sys.argv[sys.argv.index(name) + 1]


def features():
    path, names = option("--database_path"), open(option("--image_list_path")).read().split()
    fresh = not os.path.exists(path)
    database = sqlite3.connect(path)
    if fresh:
        database.executescript(TABLES)
    for i, name in enumerate(names):
        database.execute("INSERT OR IGNORE INTO images(name, camera_id) VALUES(?, 1)", (name,))
        print("Processed file [%d/%d]" % (i + 1, len(names)), flush=True)
    database.commit()


def product(a, b):
    """Of two quaternions."""
    (w, x, y, z), (v, i, j, k) = a, b
    return (w * v - x * i - y * j - z * k, w * i + x * v + y * k - z * j, w * j - x * k + y * v + z * i,
            w * k + x * j - y * i + z * v)


def turn(q, p):
    return product(product(q, (0,) + tuple(p)), (q[0], -q[1], -q[2], -q[3]))[1:]


def read_images(path):
    data, at, images = open(path, "rb").read(), 8, []
    for _ in range(struct.unpack_from("<Q", data)[0]):
        number, *pose, camera = struct.unpack_from("<I7dI", data, at)
        at += 64
        end = data.index(b"\0", at)
        name = data[at:end].decode()
        at = end + 1
        n = struct.unpack_from("<Q", data, at)[0]
        seen = [struct.unpack_from("<ddQ", data, at + 8 + 24 * i) for i in range(n)]
        at += 8 + 24 * n
        images.append((number, pose, camera, name, seen))
    return images


def read_points(path):
    data, at, points = open(path, "rb").read(), 8, {}
    for _ in range(struct.unpack_from("<Q", data)[0]):
        number, *xyz = struct.unpack_from("<Q3d", data, at)
        at += 43
        n = struct.unpack_from("<Q", data, at)[0]
        points[number] = (xyz, [struct.unpack_from("<II", data, at + 8 + 8 * i) for i in range(n)])
        at += 8 + 8 * n
    return points


def mapper():
    path, out, truth = option("--database_path"), option("--output_path"), os.environ["TRUTH_MODEL"]
    if os.environ.get("MAPPER_FAILS", "-") in path:
        print("ERROR: failed to create sparse model")
        sys.exit(1)
    if os.environ.get("MAPPER_WAITS", "-") in path:
        time.sleep(60)
    wanted = {row[0] for row in sqlite3.connect(path).execute("SELECT name FROM images")}
    group = os.path.basename(os.path.dirname(path))
    chance = random.Random(int(hashlib.sha256(group.encode()).hexdigest()[:8], 16))
    q = [chance.gauss(0, 1) for _ in range(4)]
    length = math.sqrt(sum(x * x for x in q))
    q = tuple(x / length for x in q)
    scale, move = math.exp(chance.gauss(0, 0.5)), [chance.gauss(0, 100) for _ in range(3)]
    noisy = lambda p, s: [x + chance.gauss(0, s) for x in p]
    placed = lambda p: [scale * x + m for x, m in zip(turn(q, p), move)]
    images = [i for i in read_images(os.path.join(truth, "images.bin")) if i[3] in wanted]
    numbers = {i[0] for i in images}
    points = {k: (xyz, [s for s in seen if s[0] in numbers])
              for k, (xyz, seen) in read_points(os.path.join(truth, "points3D.bin")).items()}
    points = {k: v for k, v in points.items() if len(v[1]) >= 2}
    os.makedirs(os.path.join(out, "0"), exist_ok=True)
    with open(os.path.join(out, "0", "cameras.bin"), "wb") as file:
        file.write(open(os.path.join(truth, "cameras.bin"), "rb").read())
    with open(os.path.join(out, "0", "images.bin"), "wb") as file:
        file.write(struct.pack("<Q", len(images)))
        for number, pose, camera, name, seen in images:
            back = (pose[0], -pose[1], -pose[2], -pose[3])
            centre = placed(noisy([-x for x in turn(back, pose[4:])], 0.02))
            rotation = product(tuple(pose[:4]), (q[0], -q[1], -q[2], -q[3]))
            moved = [-x for x in turn(rotation, centre)]
            file.write(struct.pack("<I7dI", number, *rotation, *moved, camera) + name.encode() + b"\0")
            file.write(struct.pack("<Q", len(seen)))
            for x, y, point in seen:
                file.write(struct.pack("<ddQ", x, y, point if point in points else 2 ** 64 - 1))
    with open(os.path.join(out, "0", "points3D.bin"), "wb") as file:
        file.write(struct.pack("<Q", len(points)))
        for number, (xyz, seen) in points.items():
            file.write(struct.pack("<Q3d3BdQ", number, *placed(noisy(xyz, 0.02)), 128, 128, 128, 0.5, len(seen)))
            for s in seen:
                file.write(struct.pack("<II", *s))


if sys.argv[2:] == ["-h"]:
    pass
elif sys.argv[1] == "feature_extractor":
    features()
elif sys.argv[1] == "mapper":
    mapper()
elif sys.argv[1] == "bundle_adjuster":
    for name in os.listdir(option("--input_path")):
        data = open(os.path.join(option("--input_path"), name), "rb").read()
        open(os.path.join(option("--output_path"), name), "wb").write(data)
