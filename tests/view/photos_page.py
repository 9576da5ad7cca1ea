"""The page of `conurb view` on a city with photos, in a headless Chromium: while it trains, a photo beside its render
its error and its transients, the light of a photo that is dropped on the page, and the pages that `train --view` and
`run --view` open.
photos_page.py CONURB MAKE_PHOTOS [FOLDER for screenshots]"""
import base64
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time

from browser import Browser
from checks import check, finish, need_chromium, shoot
from cities import change, made_city, new_city, quiet_run
from client import Server
from controls import look, rest

need_chromium()

conurb, make_photos = sys.argv[1:3]
work = tempfile.mkdtemp(prefix="conurb-photos-")


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
        file.write("#!/bin/sh\n[ \"$2\" = -h ] && exit 0\nfor a; do [ \"$last\" = --output_path ] && out=$a; "
                   "[ \"$last\" = --database_path ] && : >> $a; last=$a; done\n"
                   f"case $1 in\nmapper) cp -r {folder}/poses/model $out/0;;\n"
                   f"image_registrator) cp {work}/with/* $out;;\nesac\n")
    os.chmod(program, 0o755)
    change(folder, lambda text: text.replace("poses:\n", f"poses:\n  colmap: {program}\n  match_with: colmap\n", 1))


def listing(folder):
    return sorted((os.path.join(at, name), os.stat(os.path.join(at, name)).st_mtime_ns)
                  for at, _, names in os.walk(folder) for name in names if "/views/" not in f"{at}/")


SMALL = "conurb.picture.most = 160; conurb.picture.refresh()"  # no test here needs a fine picture


def while_it_trains(browser):
    """The page of a city without tiles or GPS: it says so, and shows the tile as soon as it is there."""
    browser.open(server.url)
    browser.wait("globalThis.conurb && conurb.city && conurb.shown", 60)
    browser.run(SMALL)
    check(not browser.run("conurb.city.frame.georeferenced"), "a city without GPS")
    check(look(browser)[1] == 0, "no tile, an empty picture")
    check("yet" in browser.run("document.getElementById('empty').textContent"), "the page says why it is empty")
    browser.click("#tab-training")
    browser.wait("document.querySelectorAll('#training strong').length >= 1", 30)
    training = subprocess.Popen([conurb, "train", city], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    browser.wait("Object.keys(conurb.trained || {}).length > 0", 120)
    check(training.wait() == 0, "training ends well")
    browser.wait("document.querySelector('#training svg.curve')", 30)
    browser.wait("conurb.shown && conurb.shown.tile", 60)
    rest(browser)
    check(look(browser)[1] > 0.2, "the tile is shown without a reload")
    check(browser.run("document.getElementById('empty').hidden"), "and nothing says that there is none")
    check("°" not in browser.run("document.getElementById('place').textContent"), "no latitude without GPS")
    shoot(browser, "trained")


FIGURE = "document.getElementById('photos').textContent.match(/PSNR [0-9.]+ dB/)?.[0]"
BRIGHT = """(async () => { const { jpeg } = await conurb.link.ask('photo', { name: conurb.city.views[0].name, width: 32,
    exposure_ev: %d }), map = await createImageBitmap(jpeg), c = new OffscreenCanvas(map.width, map.height);
    const x = c.getContext('2d'); x.drawImage(map, 0, 0); const d = x.getImageData(0, 0, map.width, map.height).data;
    return d.reduce((sum, v) => sum + v, 0) / d.length; })()"""


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
    figure = browser.run(FIGURE)
    check(figure, "the error has a figure")
    shoot(browser, "error")
    browser.run("conurb.picture.setLook({exposure_ev: 3}); document.querySelector('#photos canvas.error').remove()")
    browser.click("#photo-error")
    browser.wait("document.querySelector('#photos canvas.error')", 60)
    check(browser.run(FIGURE) == figure, f"no exposure of the page changes {figure}: {browser.run(FIGURE)}")
    bright = [browser.run(BRIGHT % exposure) for exposure in (0, 3)]
    check(bright[1] > bright[0] + 10, f"a photo is shown with the exposure of its render: {bright}")
    browser.run("conurb.picture.setLook({exposure_ev: 0})")
    browser.run("conurb.compare(null)")
    browser.run("""(() => { document.getElementById('photo-beside').click();
        conurb.flyToPhoto(conurb.city.views[1].name);
        return conurb.link.ask('photo', { name: conurb.city.views[0].name, width: 16 }); })()""")
    rest(browser)
    check(browser.run("!conurb.stage.frames[1]"), "a photo that comes after another was chosen is not shown")
    many_photos(browser)


def many_photos(browser):
    """All cards of a tall window get their photo, also more than the server takes of a page at once."""
    browser.call("Emulation.setDeviceMetricsOverride", width=1200, height=12000, deviceScaleFactor=1, mobile=False)
    n = browser.run("""(() => { const { views } = conurb.city, n = views.length;
        for (let i = n; i < 100; i++) views.push({ ...views[i % n] });
        document.getElementById('tab-look').click(); document.getElementById('tab-photos').click(); return n; })()""")
    cards = "document.querySelectorAll('#photos .card')"
    browser.wait(f"{cards}.length === 100", 20)
    try:
        browser.wait(f"[...{cards}].every((card) => card.querySelector('img'))", 60)
    except RuntimeError:
        got = browser.run(f"[...{cards}].filter((card) => card.querySelector('img')).length")
        check(False, f"all of 100 photos are shown: {got}")
    browser.run(f"conurb.city.views.splice({n})")
    browser.call("Emulation.setDeviceMetricsOverride", width=1200, height=760, deviceScaleFactor=1, mobile=False)


def transients(browser):
    """Of a photo that the tile was trained on, as `conurb appearance transient` has them; none of one held out."""
    name = browser.run("conurb.city.views.find((v) => !v.held_out).name")
    browser.run(f"conurb.flyToPhoto('{name}')")
    rest(browser)
    browser.click("#photo-transients")
    browser.wait("document.querySelector('#photos img.transient')?.naturalWidth > 0", 60)
    shoot(browser, "transients")
    quiet_run([conurb, "appearance", city, "transient", name, "--out", f"{work}/transient.png"])
    with open(f"{work}/transient.png", "rb") as file:
        png = base64.b64encode(file.read()).decode()
    # The command draws the photo, its transients and their alpha side by side.
    differ, lit = browser.run(f"""(async () => {{ const shown = document.querySelector('#photos img.transient');
        await shown.decode(); // it may be there in part only
        const sheet = new Image(); sheet.src = 'data:image/png;base64,{png}'; await sheet.decode();
        const [w, h] = [sheet.width / 3, sheet.height], values = (draw) => {{ const c = new OffscreenCanvas(w, h);
          const x = c.getContext('2d'); draw(x); return x.getImageData(0, 0, w, h).data; }};
        const a = values((x) => x.drawImage(shown, 0, 0, w, h)), b = values((x) => x.drawImage(sheet, -w, 0));
        const alpha = values((x) => x.drawImage(sheet, -2 * w, 0)); let sum = 0, lit = 0;
        for (let i = 0; i < a.length; i += 4) {{ lit += alpha[i] > 40; for (let c = 0; c < 3; c++)
          sum += Math.abs(a[i + c] - b[i + c]); }} return [sum / (3 * w * h), lit / (w * h)]; }})()""")
    check(lit > 0.01, f"the photo has transients: {lit:.3f} of it")
    check(differ < 20, f"the page shows them as the command draws them: {differ:.1f} of 255 apart")
    held = browser.run("conurb.city.views.find((v) => v.held_out).name")
    browser.run(f"conurb.flyToPhoto('{held}')")
    browser.wait("document.getElementById('photo-transients')", 20)
    browser.click("#photo-transients")
    browser.wait("document.getElementById('message').textContent.includes('trained')", 30)


def train_with_view(browser):
    """One command trains and serves the page: it shows the progress and the tile as it grows, and ends with Ctrl-C."""
    folder = made_city(conurb, make_photos, f"{work}/growing", "all")
    change(folder, lambda text: text.replace("steps: 60\n", "steps: 1000000\n  checkpoint_every_s: 1\n", 1))
    both = Server(conurb, folder, command=[conurb, "train", folder, "--view"])
    try:
        browser.open(both.url)
        browser.wait("globalThis.conurb && conurb.city && conurb.city.name === 'growing'", 60)
        browser.run(SMALL)
        browser.errors.clear()
        browser.click("#tab-training")
        browser.wait("document.querySelector('#training progress[max]')?.value > 0", 120)
        browser.wait("/of 1000000.*dB.*samples.s.*left/.test(document.getElementById('training').textContent)", 120)
        browser.wait("conurb.shown && conurb.shown.tile", 120)
        early = browser.run("conurb.trained[conurb.city.tiles[0].id]")
        shown = browser.run("conurb.shown.id")
        browser.wait(f"conurb.trained[conurb.city.tiles[0].id] > {early} && conurb.shown.id > {shown}", 120)
        browser.wait("document.querySelector('#training svg.curve')", 60)
        shoot(browser, "train-view")
        check(not browser.errors, f"the page logs no errors: {browser.errors}")
    finally:
        code, err = both.stop(signal.SIGINT)
    check(code == 75, f"Ctrl-C ends both with 75, not {code}: {err[-500:]}")
    browser.wait("document.getElementById('message').textContent.includes('connection')", 20)
    browser.errors.clear()  # of the connection that was lost


def run_with_view(browser):
    """All stages from one command, with the page beside them. It stays until Ctrl-C."""
    folder = new_city(conurb, make_photos, f"{work}/whole", "all")
    change(folder, lambda text: text.replace("render:\n", "render:\n  frames: 2\n", 1))
    both = Server(conurb, folder, command=[conurb, "run", folder, "--view"])
    try:
        browser.open(both.url)
        browser.wait("globalThis.conurb && conurb.city && conurb.city.name === 'whole'", 60)
        browser.run(SMALL)
        browser.errors.clear()
        browser.click("#tab-training")
        browser.wait("/eval: done/.test(document.getElementById('training').textContent)", 240)
        browser.wait("conurb.shown && conurb.shown.tile", 120)
        rest(browser)
        check(look(browser)[1] > 0.2, "the page shows the city that was made meanwhile")
        shoot(browser, "run-view")
        end = time.monotonic() + 120
        while "render: done" not in browser.run("document.getElementById('training').textContent"):
            if time.monotonic() > end or not both.alive():
                break
            time.sleep(0.2)
        check(both.alive(), "the page stays when all is done")
        check(not browser.errors, f"the page logs no errors: {browser.errors}")
    finally:
        code, err = both.stop(signal.SIGINT)
    check(code == 0, f"after the last stage, Ctrl-C ends it with 0, not {code}: {err[-500:]}")
    browser.errors.clear()


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
    shutil.copy(f"{city}-photos/transforms.json", f"{work}/no photo.jpg")
    drop(browser, f"{work}/no photo.jpg")
    browser.wait("document.getElementById('message').textContent.includes('no photo.jpg cannot be read')", 20)
    check(browser.run("document.getElementById('fit-photo').disabled"), "a file that is no picture is not offered")
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
    browser.run(SMALL)
    check(name in browser.run("conurb.city.named"), "it is listed again")
    rest(browser)


city = made_city(conurb, make_photos, f"{work}/city", "none")
stand_in(city)
# A curve has two places at least, and transients begin after 150 steps.
change(city, lambda text: re.sub("(?m)^effects:.*$", "effects:\n  transient: on",
                                 text.replace("steps: 60\n", "steps: 700\n", 1)))
quiet_run([conurb, "plan", city])
server = Server(conurb, city)
page = Browser()
try:
    for part in (while_it_trains, a_photo, transients, a_dropped_photo, train_with_view, run_with_view):
        begin = time.monotonic()
        part(page)
        print(f"{part.__name__}: {time.monotonic() - begin:.1f} s", flush=True)
    check(not page.errors, f"the page logs no errors: {page.errors}")
finally:
    page.close()
    code, err = server.stop()
check(code == 0, f"the server ends with 0, not {code}: {err[-2000:]}")
shutil.rmtree(work)
finish()
