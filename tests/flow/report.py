"""report.html holds what report.json holds, and nothing from another host.  usage: report.py POSES_FOLDER"""
import html
import json
import re
import sys

folder = sys.argv[1]
report = json.load(open(folder + "/report.json"))
page = open(folder + "/report.html").read()
faults = []


def section(title):
    found = re.search(r"<h2>%s</h2>(.*?)(<h2>|</body>)" % title, page, re.S)
    if not found:
        faults.append("no section " + title)
    return found.group(1) if found else ""


def rows(title):
    """The cells of each row, by its first one."""
    out = {}
    for row in re.findall(r"<tr><td.*?</tr>", section(title), re.S):
        cells = [html.unescape(re.sub(r"<[^>]*>", "", c)) for c in re.findall(r"<td.*?</td>", row, re.S)]
        out[cells[0]] = cells
    return out


def same(what, shown, value, digits):
    wanted = "-" if value is None else "%.*f" % (digits, value)
    if shown != wanted:
        faults.append("%s: the page has %s, report.json %s" % (what, shown, wanted))


def check_photos():
    table = rows("Photos")
    for photo in report["photos"][:500]:
        cells = table.get(photo["name"])
        if not cells:
            faults.append("photo %s is not on the page" % photo["name"])
            continue
        for k, axis in enumerate(("east", "north", "up")):
            same(photo["name"] + " " + axis, cells[1 + k], photo["centre_minus_gps_m"][k], 3)
        same(photo["name"] + " points", cells[6], photo["sparse_points"], 0)
        same(photo["name"] + " error", cells[7], photo["error_px"], 2)


def check_control():
    table = rows("Control and check points")
    for point in report["control"]["points"]:
        cells = table[point["name"]]
        if (cells[1] == "check") != point["check"]:
            faults.append("point %s: use" % point["name"])
        for k in range(3):
            same("point " + point["name"], cells[3 + k], point["residual_m"][k], 3)
    rms = sum(v * v for v in report["control"]["check_rms_m"]) ** 0.5
    if "Check points: %.3f m rms" % rms not in page:
        faults.append("the check points' error is not %.3f m" % rms)


check_photos()
if "control" in report:
    check_control()
for photo in report["unregistered"]:
    if rows("Photos without a pose").get(photo["name"], [None, None])[1] != photo["why"]:
        faults.append("photo %s without a pose is not on the page" % photo["name"])
total = len(report["photos"]) + len(report["unregistered"])
if "%d of %d photos have a pose" % (report["registered"], total) not in page:
    faults.append("the number of photos")
if len(rows("Cameras")) < 1:
    faults.append("no camera")
if "<svg" not in section("Map"):
    faults.append("no map")
if re.search(r"(src|href)\s*=|url\(|@import|<script", page):
    faults.append("the page needs another file, or runs a script")
for fault in faults:
    print(fault)
if not faults:
    print("the page holds the report")
sys.exit(1 if faults else 0)
