"""The page of `conurb export --page --live`, opened from disk in a headless Chromium: it asks for nothing outside its
folder, a known place lies where it should, and the slider changes the light.
live.py CONURB CITY [FOLDER for screenshots]"""
import base64
import json
import math
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import time

from browser import Browser
from checks import check, finish, need_chromium, shoot

conurb, demo = sys.argv[1:3]
work = tempfile.mkdtemp(prefix="conurb-live-")
city, folder, splats = f"{work}/demo", f"{work}/page", f"{work}/splats.ply"
lights = "Clear=run0-clear_air_0003.jpg,Low sun=run2-low-sun_air_0002.jpg"
N = 3000
KNOWN = (1.25, -3.5, 40.0)  # metres; above all else


def export(*options):
    return subprocess.run([conurb, "export", city, *options], capture_output=True, text=True, check=False)


def refused(code, text, *options):
    """One line, and nothing in the folder."""
    done = export("--page", f"{work}/none", "--live", *options)
    lines = [line for line in done.stderr.splitlines() if line.startswith("conurb: ")]
    check(done.returncode == code and len(lines) == 1 and text in lines[0],
          f"{options}: {done.returncode} {done.stderr}")
    check(not os.path.exists(f"{work}/none"), f"{options}: a folder is left")


def write_splats():
    """Discs on a hemisphere of 12 m round the city's origin, and a small one at a known place."""
    names = ("x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3").split()
    with open(splats, "wb") as file:
        file.write("\n".join(["ply", "format binary_little_endian 1.0", f"element vertex {N}",
                              *(f"property float {n}" for n in names), "end_header", ""]).encode())
        for i in range(N):
            a, z = i * 2.399963, (i + 0.5) / N
            r = math.sqrt(1 - z * z)
            place = KNOWN if i == 0 else (12 * r * math.cos(a), 12 * r * math.sin(a), 12 * z - 8)
            grey = 0.2 + 0.6 * (i % 7) / 7
            colour = [(c - 0.5) / 0.28209479 for c in (grey, 0.5, 1 - grey)]
            size = math.log(0.02 if i == 0 else 0.35)
            file.write(struct.pack("<17f", *place, 0, 0, 0, *colour, 4, size, size, size - 2, 1, 0, 0, 0))


def bad_input():
    refused(2, "--size 0.1", "--from", splats, "--size", "0.1")
    refused(2, "nobody.jpg", "--from", splats, "--lights", "mean,nobody.jpg")
    refused(6, "no.ply", "--from", f"{work}/no.ply")
    with open(f"{work}/cut.ply", "wb") as file, open(splats, "rb") as whole:
        file.write(whole.read()[:-100])
    refused(5, "cut off", "--from", f"{work}/cut.ply")
    open(f"{work}/file", "w", encoding="utf-8").close()
    done = export("--page", f"{work}/file", "--live", "--from", splats)
    check(done.returncode == 6 and f"{work}/file" in done.stderr, f"a file where the folder goes: {done.stderr}")
    done = export("--live")
    check(done.returncode == 2 and "--page DIR" in done.stderr, f"no folder: {done.stderr}")


def packed():
    """The chunks' splats and bytes: as many as there should be, and all within --size."""
    chunks = sorted(n for n in os.listdir(folder) if n.startswith("chunk-"))
    total = 0
    for name in chunks:
        with open(f"{folder}/{name}", encoding="ascii") as file:
            data = base64.b64decode(re.fullmatch(r'splatChunk\(\d+,"(.*)"\);\n', file.read()).group(1))
        check(data[:4] == b"CNSP" and data[7] == 2, f"{name} begins as it should")
        total += struct.unpack_from("<I", data, 8)[0]
    check(total == N, f"{total} splats")
    size = sum(os.path.getsize(f"{folder}/{n}") for n in os.listdir(folder))
    print(f"the folder has {size / 1e6:.2f} MB")
    check(size < 3e6, f"{size} bytes")


def settle(page):
    page.wait("live.settled", 300)


def pixels(page):
    """Mean of each channel over the picture."""
    return page.run("""(() => { const { gl, canvas } = live.picture, n = canvas.width * canvas.height;
        const all = new Uint8Array(4 * n), sum = [0, 0, 0];
        gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, all);
        for (let i = 0; i < 4 * n; i++) if (i % 4 < 3) sum[i % 4] += all[i] / n;
        return sum; })()""")


def in_the_browser(page):
    page.open(f"file://{folder}/live.html")
    page.wait("typeof live !== 'undefined'", 60)
    check(page.run("document.getElementById('message').hidden"), "no message")
    page.wait("live && live.done", 120)
    settle(page)
    shoot(page, "light-0")
    first = pixels(page)
    page.run("(() => { const e = document.getElementById('light'); e.value = 1; "
             "e.dispatchEvent(new Event('input')); })()")
    settle(page)
    time.sleep(0.2)
    shoot(page, "light-1")
    last = pixels(page)
    check(max(abs(a - b) for a, b in zip(first, last)) > 3, f"the slider changes the light: {first} {last}")
    check(page.run("document.getElementById('light').getAttribute('aria-valuetext')") == "Low sun", "the light's name")
    page.run("live.setLight(0.5)")
    check("50 % Clear" in page.run("document.getElementById('light').getAttribute('aria-valuetext')"), "the mix's name")


def places(page):
    """A click on the known place: local metres in the page, and on Earth by the frame's own matrix."""
    page.run("live.camera.show({eye: [1.25, -23.5, 40], forward: [0, 1, 0], vfov: 45, distance: 20})")
    settle(page)
    found = page.run("(() => { const b = live.canvas.getBoundingClientRect(); "
                     "return live.pick(b.x + b.width / 2, b.y + b.height / 2); })()")
    check(found and math.dist(found, KNOWN) < 0.01, f"the known place: {found}")
    latitude, longitude, height = page.run(f"geodeticOf(splatCity.frame, {list(KNOWN)})")
    with open(f"{city}/frame.json", encoding="utf-8") as file:
        origin = json.load(file)["origin"]
    place = "+lat_0={latitude_deg} +lon_0={longitude_deg} +h_0={height_m}".format(**origin)
    if shutil.which("gdaltransform"):
        steps = ("+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 " + place +
                 " +step +inv +proj=cart +ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg")
        text = subprocess.run(["gdaltransform", "-ct", steps],
                              input="%r %r %r\n" % KNOWN, capture_output=True, text=True, check=True).stdout
        there = [float(v) for v in text.split()]
        metres = math.hypot((there[1] - latitude) * 111e3, (there[0] - longitude) * 75e3, there[2] - height)
        print(f"PROJ's place is {metres:.6f} m away")
        check(metres < 0.01, f"{there} and {longitude}, {latitude}, {height}")


def controls(page):
    """Keys and modes move the camera; the pace is kept by fewer pixels and splats."""
    page.run("live.camera.show(splatCity.views[0])")
    before = page.run("live.camera.eye")
    page.run("live.canvas.focus()")
    page.key("d", "KeyD", 0.3)
    page.wait(f"Math.hypot(...live.camera.eye.map((v, k) => v - {before}[k])) > 0.01", 60)
    page.click("#modes [data-mode=walk]")
    page.wait("live.camera.mode === 'walk' && live.camera.ground", 60)
    feet = page.run("live.camera.eye[2] - live.camera.ground(live.camera.eye[0], live.camera.eye[1])")
    check(abs(feet - 1.7) < 0.01, f"eye height {feet}")
    check(page.run("document.querySelector('[data-mode=walk]').getAttribute('aria-checked')") == "true", "the mode")
    page.run("for (let i = 0; i < 8; i++) live.keepPace(400)")
    check(page.run("live.quality.share < 0.5 && live.quality.scale < 0.8"), "fewer splats where frames are slow")
    page.run("live.changed = 0; live.pace = 5; live.keepPace(5)")
    check(page.run("live.quality.share > 0.1"), "more of them where frames are fast")


def speed(page):
    page.run("live.camera.setMode('orbit'); live.camera.show(splatCity.views[0])")
    settle(page)
    page.run("live.picture.resize(1)")
    full, empty = (min(page.run(f"live.measure(1, {count})") for _ in range(6)) for count in ("Infinity", 0))
    print(f"{page.run('live.picture.order')} splats: {1 / full:.1f} frames a second, {1 / empty:.1f} without any: "
          f"{full / empty:.1f} times as long")


write_splats()
shutil.copytree(demo, city)
bad_input()
begin = time.monotonic()
made = export("--page", folder, "--live", "--from", splats, "--lights", lights, "--size", "3")
check(made.returncode == 0, f"the export: {made.stderr}")
print(f"export: {time.monotonic() - begin:.1f} s", flush=True)
packed()
need_chromium()
browser = Browser(420, 280, dark=True)
try:
    for part in (in_the_browser, places, controls, speed):
        begin = time.monotonic()
        part(browser)
        print(f"{part.__name__}: {time.monotonic() - begin:.1f} s", flush=True)
    check(not browser.errors, f"the page logs no errors: {browser.errors}")
    outside = [r for r in browser.requests if not r.startswith((f"file://{folder}/", "blob:", "data:"))]
    check(len(browser.requests) > 5 and not outside, f"nothing is asked for outside the folder: {outside}")
finally:
    browser.close()
    shutil.rmtree(work, ignore_errors=True)
finish()
