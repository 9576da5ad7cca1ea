"""Compares points of a LAS file with those of a PLY file in the local frame, which PROJ places on Earth.

usage: las.py POINTS.ply FRAME.json LAS.txt      LAS.txt: what las.js printed
"""
import json
import struct
import subprocess
import sys

ply, frame, las = sys.argv[1:]
data = open(ply, "rb").read()
end = data.index(b"end_header\n") + 11
rows = list(struct.iter_unpack("<dddBBB", data[end:]))
origin = json.load(open(frame))["origin"]
place = "+lat_0={latitude_deg} +lon_0={longitude_deg} +h_0={height_m}".format(**origin)
pipeline = ("+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 " + place +
            " +step +inv +proj=cart +ellps=WGS84 +step +proj=utm +zone=32 +ellps=WGS84")
text = subprocess.run(["gdaltransform", "-ct", pipeline], capture_output=True, text=True, check=True,
                      input="".join("%.9f %.9f %.9f\n" % row[:3] for row in rows)).stdout
expected = [[float(x) for x in line.split()] for line in text.splitlines()]
found = [[float(x) for x in line.split()] for line in open(las) if not line.startswith("#")]
assert len(found) == len(expected) == len(rows) > 10000, (len(found), len(expected), len(rows))
worst = max(abs(a - b) for f, e in zip(found, expected) for a, b in zip(f[:3], e))
print(f"{len(rows)} points; the largest distance from PROJ's place along an axis is {worst:.6f} m")
assert worst < 0.01
assert all(f[3 + c] == 257 * row[3 + c] for f, row in zip(found, rows) for c in range(3)), "colours differ"
