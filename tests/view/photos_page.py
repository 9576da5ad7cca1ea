"""The page of `conurb view` on a city with photos, in a headless Chromium: while it trains, a photo beside its render
and its error, and the light of a photo that is dropped on the page.
photos_page.py CONURB MAKE_PHOTOS [FOLDER for screenshots]"""
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import time

from browser import Browser, find_chromium
from cities import change, made_city
from client import Server
from controls import look, rest

if not find_chromium():
    print("SKIP: there is no Chromium here; apt-get install chromium")
    sys.exit(77)

conurb, make_photos = sys.argv[1:3]
shots = sys.argv[3] if len(sys.argv) > 3 else None
work = tempfile.mkdtemp(prefix="conurb-photos-")
failed = []


def check(good, what):
    if not good:
        failed.append(what)
        print("FAILED:", what, flush=True)


def shoot(browser, name):
    if shots:
        os.makedirs(shots, exist_ok=True)
        browser.screenshot(f"{shots}/{name}.png")


def model_with_query(folder, out):
    """The city's model with one more photo, at the place of the first one."""
    shutil.copytree(f"{folder}/poses/model", out)
    with open(f"{out}/images.bin", "rb") as file:
        data = file.read()
    count, first = struct.unpack_from("<Q", data)[0], 8
    end = data.index(b"\0", first + 64) + 1
    pose, camera = data[first + 4:first + 60], data[first + 60:first + 64]
    query = struct.pack("<I", 4000) + pose + camera + b"conurb-query.jpg\0" + struct.pack("<Q", 0)
    with open(f"{out}/images.bin", "wb") as file:
        file.write(struct.pack("<Q", count + 1) + data[8:] + query)
    check(data[first + 64:end].endswith(b".jpg\0"), "the model's first image has a name")


def stand_in(folder):
    """A program in place of COLMAP that hands out models: the photos are too small for the real one."""
    program = f"{work}/colmap"
    model_with_query(folder, f"{work}/with")
    with open(program, "w", encoding="utf-8") as file:
        file.write("#!/bin/sh\nfor a; do [ \"$last\" = --output_path ] && out=$a; "
                   "[ \"$last\" = --database_path ] && : >> $a; last=$a; done\n"
                   f"case $1 in\nmapper) cp -r {folder}/poses/model $out/0;;\n"
                   f"image_registrator) cp {work}/with/* $out;;\nesac\n")
    os.chmod(program, 0o755)
    change(folder, lambda text: text.replace("poses:\n", f"poses:\n  colmap: {program}\n  match_with: colmap\n", 1))


def listing(folder):
    return sorted((os.path.join(at, name), os.stat(os.path.join(at, name)).st_mtime_ns)
                  for at, _, names in os.walk(folder) for name in names if "/views/" not in f"{at}/")


def while_it_trains(browser):
    """The page of a city without tiles or GPS: it says so, and shows the tile as soon as it is there."""
    browser.open(server.url)
    browser.wait("globalThis.conurb && conurb.city && conurb.shown", 60)
    check(not browser.run("conurb.city.frame.georeferenced"), "a city without GPS")
    check(look(browser)[1] == 0, "no tile, an empty picture")
    browser.click("#tab-training")
    browser.wait("document.querySelectorAll('#training strong').length >= 1", 30)
    training = subprocess.Popen([conurb, "train", city], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    browser.wait("Object.keys(conurb.trained || {}).length > 0", 120)
    check(training.wait() == 0, "training ends well")
    browser.wait("document.querySelector('#training svg.curve')", 30)
    browser.wait("conurb.shown && conurb.shown.tile", 60)
    rest(browser)
    check(look(browser)[1] > 0.2, "the tile is shown without a reload")
    check("°" not in browser.run("document.getElementById('place').textContent"), "no latitude without GPS")
    shoot(browser, "trained")


def a_photo(browser):
    browser.click("#tab-photos")
    browser.wait("document.querySelectorAll('#photos .card img').length >= 3", 60)
    browser.click("#photos .card")
    browser.wait("document.getElementById('photo-beside')", 20)
    rest(browser)
    browser.click("#photo-beside")
    browser.wait("conurb.stage.frames[1] && conurb.stage.split !== null", 30)
    check(browser.run("document.getElementById('divider-names').textContent") == "RenderPhoto", "render and photo")
    shoot(browser, "beside")
    browser.click("#photo-error")
    browser.wait("document.querySelector('#photos canvas.error')", 60)
    check("dB" in browser.run("document.getElementById('photos').textContent"), "the error has a figure")
    shoot(browser, "error")
    browser.run("conurb.compare(null)")
    browser.run("[...document.querySelectorAll('#photos button')].find((b) => b.textContent === 'Transients').click()")
    browser.wait("document.getElementById('message').textContent.includes('trained')", 30)


def drop(browser, path):
    """As a person drags a file from their desktop."""
    x, y = browser.middle("#view")
    data = {"items": [], "files": [path], "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver", "drop"):
        browser.call("Input.dispatchDragEvent", type=kind, x=x, y=y, data=data)


def a_dropped_photo(browser):
    before = listing(city)
    drop(browser, f"{city}-photos/transforms.json")
    browser.wait("document.getElementById('message').textContent.includes('JPEG')", 20)
    shutil.copy(f"{city}-photos/004.jpg", f"{work}/Evening, by the river.jpg")
    drop(browser, f"{work}/Evening, by the river.jpg")
    browser.wait("!document.getElementById('fit-photo').disabled", 20)
    check(browser.run("document.getElementById('light').hidden") is False, "the panel of lights is open")
    shoot(browser, "dropped")
    browser.click("#fit-photo")
    browser.wait("conurb.fit && conurb.fit.state !== 'running'", 120)
    check(browser.run("conurb.fit.state") == "done", f"a light is fitted: {browser.run('conurb.fit')}")
    name = browser.run("conurb.fit.name")
    check(os.path.exists(f"{city}/views/fitted/{name}.json"), f"{name} is kept")
    browser.wait(f"conurb.picture.look.appearance === '{name}'", 20)
    rest(browser)
    check(listing(city) == before, "nothing else of the city has changed")
    shoot(browser, "fitted")
    browser.run("conurb.picture.setLook({appearance: 'mean:" + name + ":0.5'})")
    rest(browser)
    # The name means a light on the command line, too.
    done = subprocess.run([conurb, "appearance", city, "show", name], capture_output=True, text=True, check=False)
    check(done.returncode == 0 and '"tiles"' in done.stdout, f"conurb appearance knows it: {done.stderr}")
    # And after a reload.
    browser.open(server.url)
    browser.wait("globalThis.conurb && conurb.city", 30)
    check(name in browser.run("conurb.city.named"), "it is listed again")
    rest(browser)


city = made_city(conurb, make_photos, f"{work}/city", "none")
stand_in(city)
change(city, lambda text: text.replace("steps: 60\n", "steps: 2500\n", 1))  # a curve has two places at least
server = Server(conurb, city)
page = Browser()
try:
    for part in (while_it_trains, a_photo, a_dropped_photo):
        begin = time.monotonic()
        part(page)
        print(f"{part.__name__}: {time.monotonic() - begin:.1f} s", flush=True)
    check(not page.errors, f"the page logs no errors: {page.errors}")
finally:
    page.close()
    code, err = server.stop()
check(code == 0, f"the server ends with 0, not {code}: {err[-2000:]}")
shutil.rmtree(work)
print(f"{len(failed)} failed")
sys.exit(bool(failed))
