"""`conurb view` on the processor and on a graphics processor (a software one will do): the same pictures within a
bound, in several blends, lights and channels, and the same film.
device.py CONURB DEMO COMPARE_PICTURES"""
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile

from checks import check, finish
from client import Page, Server

conurb, demo, compare = sys.argv[1:4]
work = tempfile.mkdtemp(prefix="conurb-view-device-")
PATH = {"fps": 24, "keyframes": [{"time_s": 0, "local": [0, -18, 2], "heading_deg": 0, "pitch_deg": -5},
                                 {"time_s": 0.1, "local": [1, -18, 2], "heading_deg": 10, "pitch_deg": -5}]}
ASKED = [{"blend": "distance_2d"}, {"blend": "ownership"},
         {"blend": "ownership", "appearance": "run3-night_street_0010.jpg"},
         {"blend": "distance_2d", "appearance": "mean:run3-night_street_0010.jpg:0.5", "exposure_ev": 1},
         {"blend": "ownership", "channel": "depth"}, {"blend": "ownership", "channel": "normal"},
         {"blend": "distance_2d", "channel": "occlusion"}, {"blend": "ownership", "channel": "tiles"}]
os.environ["CONURB_CPU"] = "ref"  # the reference's kernels: others may multiply in bfloat16


def differ(first, second, suffix):
    """PSNR and largest difference of two pictures' bytes."""
    names = []
    for i, data in enumerate((first, second)):
        names.append(f"{work}/{i}.{suffix}")
        with open(names[-1], "wb") as file:
            file.write(data)
    return [float(x) for x in subprocess.run([compare, *names], capture_output=True, text=True,
                                             check=True).stdout.split()]


def look(device):
    """The last pass of every picture asked for, with its depths, and the film's pictures."""
    city = f"{work}/{device.replace(':', '')}"
    shutil.copytree(demo, city)
    server = Server(conurb, city, "--device", device)
    shown, film = [], []
    try:
        page = Page(server)
        pose = page.ask("city")[0]["views"][5]
        for fields in ASKED:
            number = page.view(pose, 48, 36, **fields)
            head = {}
            while not head.get("last"):
                head, jpeg, tail = page.until(lambda h: h.get("id") == number, 300)
            shown.append((jpeg, struct.unpack(f"<{len(tail) // 2}e", tail)))
        page.ask("save", what="path", name="walk", data=PATH)
        page.send("film", name="walk", width=32)
        done = page.until(lambda h: h["type"] == "film" and h["state"] != "running", 300)[0]
        check(done["state"] == "done", f"{device}: a film is made: {done}")
        names = sorted(n for n in os.listdir(f"{city}/renders/walk") if n.endswith(".exr"))
        for name in names:
            with open(f"{city}/renders/walk/{name}", "rb") as file:
                film.append(file.read())
        page.close()
    finally:
        code, err = server.stop()
    check(code == 0, f"{device}: the server ends with 0, not {code}: {err[-2000:]}")
    check("the processor does it instead" not in err, f"{device}: nothing is left to the processor: {err[-2000:]}")
    return shown, film, err


doctor = subprocess.run([conurb, "doctor"], capture_output=True, text=True, check=False).stdout
device = re.search(r"gpu:\d+", doctor)
if not device:
    print("skipped: conurb doctor lists no graphics processor, not even a software one")
    sys.exit(77)
device = device.group(0)
by_processor, its_film, _ = look("cpu")
by_device, other_film, err = look(device)
check("device: " in err, "the server says which device it uses: " + err)
for fields, (jpeg, depths), (wanted, wanted_depths) in zip(ASKED, by_device, by_processor):
    psnr, most = differ(jpeg, wanted, "jpg")
    far = sum(abs(a - b) > 0.01 * b for a, b in zip(depths, wanted_depths))
    print(f"{device}: {fields}: PSNR {psnr} dB, largest difference {most}; {far} of {len(depths)} depths differ",
          flush=True)
    check(psnr > 45, f"{fields}: the picture is the processor's")
    check(any(depths) and far <= len(depths) / 100, f"{fields}: the depths are the processor's")
check(len(other_film) == len(its_film) >= 2, f"{len(other_film)} and {len(its_film)} pictures of a film")
same = 0
for i, (picture, wanted) in enumerate(zip(other_film, its_film)):
    psnr, most = differ(picture, wanted, "exr")
    print(f"{device}: film, picture {i}: PSNR {psnr} dB, largest difference {most}", flush=True)
    check(psnr > 60, f"picture {i} of the film is the processor's")
    same += psnr == float("inf")
check(same < len(its_film), "the film was rendered on the device: rounding shows it")
shutil.rmtree(work)
finish()
