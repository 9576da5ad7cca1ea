"""The live page's server as a page uses it: pictures a second while the camera moves, how long one takes from asking to
having it, also when it cancels a larger one, how long the whole picture takes at rest, coverage, and memory.
live.py CONURB CITY [SECONDS]
The width of pictures while moving is steered to 100 ms as the page does (src/view/page/picture.js)."""
import os
import statistics
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "view"))
from client import Page, Server  # noqa: E402

conurb, city = sys.argv[1:3]
seconds = float(sys.argv[3]) if len(sys.argv) > 3 else 10
GOAL_S, LEAST, MOST, REST = 0.1, 96, 960, (640, 360)


def between(a, b, t):
    return [x + (y - x) * t for x, y in zip(a, b)]


def picture(page, pose, width, height, **more):
    begin = time.monotonic()
    number = page.view(pose, width, height, **more)
    while True:
        head, jpeg, _ = page.until(lambda h: h.get("id") == number)
        if head["type"] == "failed":
            raise RuntimeError(head["text"])
        if head["last"]:
            return time.monotonic() - begin, len(jpeg)


server = Server(conurb, city, "--share", "1")
before = server.resident_kb()
page = Page(server)
views = page.ask("city")[0]["views"]
first, _ = picture(page, views[0], 96, 54, moving=True)
tiles = server.resident_kb()
took, widths, sizes, width, i = [], [], [], 320.0, 0
end = time.monotonic() + seconds
warm_up = time.monotonic() + 2
while time.monotonic() < end:
    # A flight from photo to photo, looking as the first of the two does.
    a, b, i = views[i // 20 % len(views)], views[(i // 20 + 1) % len(views)], i + 1
    pose = {**a, "centre": between(a["centre"], b["centre"], i % 20 / 20)}
    s, size = picture(page, pose, int(width), int(width * 9 / 16), moving=True)
    if time.monotonic() > warm_up:
        took.append(s)
        widths.append(width)
        sizes.append(size)
    width = min(max(width * min(max((GOAL_S / s) ** 0.5, 0.75), 1.25), LEAST), MOST)
took.sort()
print(f"moving: {len(took) / sum(took):.1f} pictures/s at {statistics.median(widths):.0f} px (16:9), "
      f"{statistics.median(took) * 1000:.0f} ms median, {took[int(0.95 * (len(took) - 1))] * 1000:.0f} ms p95, "
      f"{statistics.mean(sizes) / 1000:.1f} kB each", flush=True)
rest = [picture(page, views[k * len(views) // 3], *REST)[0] for k in range(3)]


def after_a_motion(pose):
    """From a motion to its picture while a large picture at rest is in the making: seconds, and without that."""
    number = page.view(pose, 1600, 900)
    page.until(lambda h: h.get("id") == number)
    time.sleep(0.05)
    return picture(page, pose, 96, 54, moving=True)[0], picture(page, pose, 96, 54, moving=True)[0]


pairs = [after_a_motion(views[k * len(views) // 15]) for k in range(15)]
late = sorted(a - b for a, b in pairs)
print(f"a motion while 1600 x 900 is refined: its picture comes {statistics.median(late) * 1000:.0f} ms later than "
      f"without, {late[13] * 1000:.0f} ms p95 (of {len(late)})", flush=True)
begin = time.monotonic()
number = page.view(views[0], *REST, channel="coverage")
page.until(lambda h: h.get("id") == number)
coverage = time.monotonic() - begin
page.until(lambda h: h.get("id") == number and h["last"], 300)
print(f"photos that see it: first picture after {coverage:.2f} s, whole after {time.monotonic() - begin:.1f} s")
print(f"first picture {first * 1000:.0f} ms; at rest {REST[0]} x {REST[1]}: whole after "
      f"{statistics.median(rest):.2f} s (median of {len(rest)})")
print(f"memory: {before / 1024:.0f} MB, {tiles / 1024:.0f} MB with the tiles of the first picture, "
      f"{server.resident_kb() / 1024:.0f} MB at the end")
page.close()
server.stop()
