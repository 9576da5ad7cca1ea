#!/usr/bin/env python3
"""How far the poses of a model are from the true ones, after the best similarity: centres and directions.

usage: rig_truth.py MODEL TRUTH    two COLMAP models (binary) with the same photo names
"""
import math
import os
import struct
import sys


def read(folder):
    """cam_from_world rotation (rows) and centre by the photo's name."""
    data = open(os.path.join(folder, "images.bin"), "rb").read()
    poses, at = {}, 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        _, w, x, y, z, *t = struct.unpack_from("<I7d", data, at)
        start = at + 64  # behind the camera's number
        end = data.index(b"\0", start)
        name = data[start:end].decode()
        n = struct.unpack_from("<Q", data, end + 1)[0]
        at = end + 9 + 24 * n
        r = ((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
             (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
             (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))
        poses[name] = (r, [-sum(r[i][k] * t[i] for i in range(3)) for k in range(3)])
    return poses


def mean(points):
    return [sum(p[k] for p in points) / len(points) for k in range(3)]


def turn_between(source, target):
    """The rotation that takes centred points to others best (Horn 1987), by power iteration on his matrix."""
    m = [[sum(a[i] * b[j] for a, b in zip(source, target)) for j in range(3)] for i in range(3)]
    xx, xy, xz, yx, yy, yz, zx, zy, zz = (m[i][j] for i in range(3) for j in range(3))
    n = [[xx + yy + zz, yz - zy, zx - xz, xy - yx], [yz - zy, xx - yy - zz, xy + yx, zx + xz],
         [zx - xz, xy + yx, yy - xx - zz, yz + zy], [xy - yx, zx + xz, yz + zy, zz - xx - yy]]
    shift = sum(abs(v) for row in n for v in row)
    q = [1.0, 0.1, 0.2, 0.3]
    for _ in range(5000):
        q = [shift * q[i] + sum(n[i][j] * q[j] for j in range(4)) for i in range(4)]
        length = math.sqrt(sum(v * v for v in q))
        q = [v / length for v in q]
    w, x, y, z = q
    return ((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))


def apply(r, p):
    return [sum(r[i][k] * p[k] for k in range(3)) for i in range(3)]


def main():
    found, true = read(sys.argv[1]), read(sys.argv[2])
    names = sorted(set(found) & set(true))
    if len(names) < 3:
        sys.exit("fewer than three photos in common")
    a, b = [found[n][1] for n in names], [true[n][1] for n in names]
    ma, mb = mean(a), mean(b)
    a = [[x - y for x, y in zip(p, ma)] for p in a]
    b = [[x - y for x, y in zip(p, mb)] for p in b]
    r = turn_between(a, b)
    turned = [apply(r, p) for p in a]
    scale = sum(x * y for p, q in zip(turned, b) for x, y in zip(p, q)) / sum(x * x for p in a for x in p)
    off = sorted(math.dist([scale * x for x in p], q) for p, q in zip(turned, b))
    angles = []
    for n in names:
        # Both cameras' axes in the frame of the truth.
        trace = sum(sum(r[i][k] * found[n][0][j][k] for k in range(3)) * true[n][0][j][i]
                    for i in range(3) for j in range(3))
        angles.append(math.degrees(math.acos(max(-1, min(1, (trace - 1) / 2)))))
    print("%d of %d photos: centres %.4f m rms, %.4f at most; directions %.3f degrees rms, %.3f at most; scale %.4f" %
          (len(names), len(true), math.sqrt(sum(x * x for x in off) / len(off)), off[-1],
           math.sqrt(sum(x * x for x in angles) / len(angles)), max(angles), scale))


main()
