"""The page of `conurb view` in a headless Chromium, on the demo city: uses every control.
page.py CONURB DEMO [FOLDER for screenshots]"""
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time

from browser import Browser
from checks import check, finish, need_chromium, shoot
from client import Server
from controls import choose, faint, look, pose, rest

need_chromium()

conurb, demo = sys.argv[1:3]
work = tempfile.mkdtemp(prefix="conurb-page-")
city = os.path.join(work, "city")
shutil.copytree(demo, city)


def first_picture(browser):
    begin = time.monotonic()
    browser.open(server.url)
    browser.wait("globalThis.conurb && conurb.shown", 20)
    print(f"first picture after {time.monotonic() - begin:.2f} s")
    browser.run("conurb.picture.most = 160; conurb.picture.refresh()")  # what follows needs no fine pictures
    rest(browser)
    check(look(browser)[1] > 0.9, "the first picture is not black")
    check(browser.run("document.title").startswith("city"), "the page bears the city's name")
    shoot(browser, "first")


def moving(browser):
    before, at = look(browser), pose(browser)
    # Wait for a fast picture, which takes long on a busy machine.
    browser.mouse("mousePressed", 300, 300)
    browser.run("conurb.picture.timings = []")
    steps, begin = 0, time.monotonic()
    while not browser.run("conurb.picture.timings.length") and time.monotonic() < begin + 120:
        steps += 1
        browser.mouse("mouseMoved", 300 + steps % 200, 300 + steps % 40)
        time.sleep(0.02)
    browser.mouse("mouseReleased", 300 + steps % 200, 300 + steps % 40, buttons=0)
    after = pose(browser)
    check(after["heading"] != at["heading"] and after["pitch"] != at["pitch"], "a drag turns the camera")
    check(browser.run("conurb.picture.timings.length > 0"), "pictures come while the camera moves")
    rest(browser)
    check(look(browser)[0] != before[0], "a drag changes the picture")
    shoot(browser, "turned")
    browser.click("[data-mode=fly]")
    browser.run("document.getElementById('view').focus()")
    at = pose(browser)
    browser.key("w", seconds=0.6)
    browser.wait(f"conurb.camera.centre[0] !== {at['centre'][0]}", 20)  # W flies ahead
    at = pose(browser)
    browser.key("l", seconds=0.3)
    browser.wait(f"conurb.camera.heading !== {at['heading']}", 20)  # L turns
    browser.key("Home", "Home")
    browser.wait("""conurb.geometry.norm(conurb.geometry.sub(conurb.camera.centre, conurb.city.views[0].centre))
        < 1e-6""", 60)  # Home flies back to the first photo's view
    fly_home(browser)
    browser.click("[data-mode=walk]")
    browser.wait("conurb.standing === false", 60)
    height = pose(browser)["centre"][2]
    browser.run("document.getElementById('view').focus()")
    browser.key("w", seconds=0.5)
    browser.wait("conurb.standing === false", 60)
    walked = pose(browser)["centre"][2]
    check(abs(walked - height) < 1.5, f"walking stays above the ground: {height} m, then {walked} m")
    browser.click("[data-mode=orbit]")
    at = pose(browser)
    browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=300, y=300, deltaX=0, deltaY=-240)
    time.sleep(0.2)
    check(pose(browser)["centre"] != at["centre"], "the wheel brings nearer")
    browser.click("#compass")
    browser.wait("conurb.camera.heading === 0", 20)
    rest(browser)


def fly_home(browser):
    browser.run("conurb.camera.setPose(conurb.city.views[0])")
    rest(browser)


def upright(browser):
    """A photo on its side begins the page upright, as high as the photo is wide. One that looks down is not turned."""
    found = browser.run("""(() => { const g = conurb.geometry, out = [];
        for (const [pitch, roll] of [[10, 3], [10, 93], [-20, -88], [5, 178], [-85, 93]]) {
          const view = { rotation: g.rotationOf({ heading: 40, pitch, roll }), vfov_deg: 50, aspect: 1.5 };
          const pose = g.uprightPose(view), angles = g.anglesOf(pose.rotation);
          out.push([angles.heading, angles.pitch, angles.roll, pose.vfov_deg].map((x) => Math.round(100 * x) / 100)); }
        return out; })()""")
    wide = 69.94  # degrees: 2 atan(1.5 tan 25)
    check(found == [[40, 10, 3, 50], [40, 10, 3, wide], [40, -20, 2, wide], [40, 5, -2, 50], [40, -85, 93, 50]],
          f"a photo's pose stands upright: {found}")


def a_drawn_camera(browser):
    """A click on the camera of a photo flies there. Then the picture that is shown is saved as a file."""
    x, y = browser.run("""(() => { const { camera, city, geometry } = conurb, places = city.views.map((view) =>
        geometry.placeIn(camera, camera.aspect, view.centre)).filter((at) => at && Math.abs(at[0]) < 0.7 &&
        Math.abs(at[1]) < 0.7); const box = document.getElementById('view').getBoundingClientRect();
        return [box.x + box.width * (places[0][0] + 1) / 2, box.y + box.height * (places[0][1] + 1) / 2]; })()""")
    browser.click((x, y))
    browser.wait("""conurb.city.views.some((view) =>
        conurb.geometry.norm(conurb.geometry.sub(conurb.camera.centre, view.centre)) < 1e-6)""", 20)
    check(browser.run("!document.getElementById('photos').hidden"), "a click on a drawn camera leads to its photo")
    browser.click("#tab-look")
    fly_home(browser)
    browser.call("Page.setDownloadBehavior", behavior="allow", downloadPath=work)
    browser.click("#save-picture")
    end = time.monotonic() + 30
    while not os.path.exists(f"{work}/city.jpg") and time.monotonic() < end:
        time.sleep(0.1)
    with open(f"{work}/city.jpg", "rb") as file:
        check(file.read(2) == b"\xff\xd8", "the picture is saved as a JPEG")


def channels(browser):
    browser.click("#tab-look")
    seen = {look(browser)[0]}
    browser.run("""(() => { const box = [...document.querySelectorAll('#look label')].find((l) =>
        l.textContent.startsWith('Sparse points')).firstChild; box.click(); box.click();
        return conurb.link.ask('points'); })()""")
    check(not browser.run("conurb.stage.marks.has('points')"), "points that are turned off meanwhile are not drawn")
    for channel in ("depth", "normal", "opacity", "tiles", "coverage", "occlusion"):
        choose(browser, "Show", channel)
        rest(browser)
        check(look(browser)[0] not in seen, f"channel {channel} is a picture of its own")
        seen.add(look(browser)[0])
        shoot(browser, channel)
        if channel in ("depth", "coverage"):
            check(not browser.run("document.getElementById('legend').hidden"), f"{channel} has a legend")
    choose(browser, "Show", "colour")
    rest(browser)
    plain = look(browser)[0]
    for label, value in (("Exposure", "-2"), ("Colour view", "ACES"), ("Blending", "nearest")):
        choose(browser, label, value)
        rest(browser)
        check(look(browser)[0] != plain, f"{label} {value} changes the picture")
        choose(browser, label, "0" if label == "Exposure" else "")
    for box in browser.run("[...document.querySelectorAll('#look input[type=checkbox]')].map((e, i) => i)"):
        browser.run(f"document.querySelectorAll('#look input[type=checkbox]')[{box}].click()")
    browser.wait("conurb.stage.marks.size === 3", 20)
    rest(browser)
    check(look(browser)[0] != plain, "marks are drawn over the picture")
    shoot(browser, "marks")
    a_drawn_camera(browser)
    for box in range(3):
        browser.run(f"document.querySelectorAll('#look input[type=checkbox]')[{box}].click()")
    rest(browser)


def cropping(browser):
    whole = look(browser)
    browser.click("#crop")
    rest(browser)
    part = look(browser)
    check(part[1] < 0.9 * whole[1], f"a crop leaves things out: {part[1]} of {whole[1]} is lit")
    check(browser.run("conurb.stage.marks.has('crop')"), "the box is drawn")
    shoot(browser, "crop")
    high = browser.run("conurb.picture.look.crop[5]")
    choose(browser, "Up to", str(browser.run("conurb.picture.look.crop[2]") + 0.1))
    rest(browser)
    check(browser.run("conurb.picture.look.crop[5]") < high and look(browser)[1] < part[1], "a slider moves a face")
    choose(browser, "East from", "1e6")
    off = browser.run("""(() => { const label = [...document.querySelectorAll('label')].find((l) => l.textContent ===
        'East from'), e = document.getElementById(label.htmlFor);
        return Math.abs(e.value - conurb.picture.look.crop[0]) / e.step; })()""")
    check(off <= 1, f"a face that meets the other one is shown where it is: {off} steps off")
    browser.click("#crop-off")
    rest(browser)
    check(look(browser)[0] == whole[0], "everything is there again")


def comparing(browser):
    """Two blendings with the divider between them, and a picture that is kept."""
    choose(browser, "With blending", "ownership")
    browser.wait("conurb.stage.frames[1] && conurb.picture.beside.blend === 'ownership'", 120)
    rest(browser)
    check(browser.run("document.getElementById('divider-names').textContent").endswith("ownership"), "it is named")
    shoot(browser, "blendings")
    browser.click("#keep")
    choose(browser, "Exposure", "-2")
    rest(browser)
    browser.wait("conurb.stage.frames[1]", 120)
    check(browser.run("conurb.picture.beside.exposure_ev === 0 && conurb.picture.look.exposure_ev === -2"),
          "the right picture stays as it was")
    shoot(browser, "kept")
    choose(browser, "Exposure", "0")
    browser.run("conurb.compare(null)")
    rest(browser)


def measuring(browser):
    browser.click("#measure")
    browser.click((300, 560))
    browser.wait("conurb.stage.marks.has('measure')", 60)
    browser.click((500, 560))
    browser.wait("conurb.measured", 60)
    distance = browser.run("conurb.measured.distance")
    check(0.1 < distance < 100, f"two places on the street are {distance} m apart")
    shoot(browser, "measured")
    browser.click("#measure")
    browser.mouse("mouseMoved", 400, 600, buttons=0)
    time.sleep(0.2)
    there = browser.run("document.getElementById('under').textContent")
    check("°" in there, "the readout has latitude and longitude")
    browser.run("conurb.camera.setPose(conurb.city.views[3])")
    rest(browser)
    check(browser.run("document.getElementById('under').textContent") != there, "it is of the picture that is shown")
    browser.mouse("mouseMoved", 1100, 500, buttons=0)
    time.sleep(0.2)
    check(browser.run("document.getElementById('under').textContent") == "", "nothing is under a cursor elsewhere")
    browser.click("#measure")
    browser.run("document.getElementById('view').focus()")
    browser.key("Enter", "Enter")
    browser.wait("conurb.stage.marks.has('measure')", 60)
    browser.click("#measure")
    at_once = browser.run("""Promise.race([new Promise((yes) => setTimeout(yes, 60000)),
        Promise.all([1, 2, 3].map((i) => conurb.picture.probe({...conurb.camera.state(), vfov: i / 10})))])""")
    check(at_once and len(at_once) == 3, f"depths that are asked for at once are all answered: {at_once}")
    fly_home(browser)


def lights(browser):
    browser.click("#tab-light")
    browser.wait("document.querySelectorAll('#light .card img').length >= 4", 120)
    shoot(browser, "lights")
    plain = look(browser)[0]
    name = browser.run("conurb.city.views.find((v) => !v.held_out && v.name.startsWith('run3')).name")
    browser.click(f"#light .card[data-light='{name}']")
    rest(browser)
    night = look(browser)[0]
    check(night != plain, "a photo's light changes the picture")
    shoot(browser, "night")
    choose(browser, "To", browser.run("conurb.city.views.find((v) => !v.held_out).name"))
    choose(browser, "Between", "0.5")
    rest(browser)
    check(look(browser)[0] not in (plain, night), "a mix is between both")
    two = look(browser)[0]
    browser.click("#mix-another")
    check(browser.run("conurb.picture.look.appearance").endswith(":mean:0.33"), "the mean can be mixed in")
    choose(browser, "Share of light 3", "0.8")
    rest(browser)
    check(look(browser)[0] not in (plain, night, two), "a third light changes the mix")
    check(browser.run("conurb.picture.look.appearance.split(':').length") == 5, "the mix is of three lights")
    shoot(browser, "mixed")
    browser.run("document.getElementById('save-light').previousElementSibling.value = 'half night'")
    browser.click("#save-light")
    browser.wait("[...document.querySelectorAll('#light .row button')].some((b) => b.textContent === 'half night')", 20)
    check(os.path.exists(f"{city}/views/lights/half night.json"), "a light is saved")
    browser.click("#compare-lights")
    browser.wait("conurb.stage.frames[1] && conurb.shown.last", 120)
    rest(browser)
    check(not browser.run("document.getElementById('divider').hidden"), "the divider is there")
    shoot(browser, "compared")
    browser.run("conurb.compare(null)")
    times(browser)
    browser.run("conurb.picture.setLook({appearance: ''})")
    rest(browser)


def times(browser):
    """The capture runs: one button each, and the slider through their photos."""
    runs = browser.run("document.querySelectorAll('#runs button').length")
    check(runs == len(set(browser.run("conurb.city.views.filter((v) => !v.held_out).map((v) => v.run)"))),
          f"a button for each of {runs} capture runs")
    browser.click("#runs button:last-child")
    last = browser.run("conurb.city.views.filter((v) => !v.held_out && v.run).sort((a, b) => a.time_s - b.time_s)"
                       ".at(-1).run")
    check(browser.run("conurb.city.views.find((v) => v.name === conurb.light.a).run") == last, "a run's light")
    choose(browser, "Taken at", "0.5")
    check(browser.run("conurb.light.t === 0.5 && conurb.light.a !== conurb.light.b"), "between two photos of a run")
    rest(browser)
    browser.middle("#runs")
    shoot(browser, "times")


def photos(browser):
    browser.click("#tab-photos")
    browser.wait("document.querySelectorAll('#photos .card img').length >= 3", 120)
    name = browser.run("conurb.city.views[5].name")
    browser.click(f"#photos .card[data-name='{name}']")
    browser.wait("conurb.geometry.norm(conurb.geometry.sub(conurb.camera.centre, conurb.city.views[5].centre)) < 1e-6",
                 20)
    rest(browser)
    check(look(browser)[1] > 0.8, "the view of a photo shows the city")
    shoot(browser, "photo")
    held = browser.run("conurb.city.views.find((v) => v.held_out).name")
    for one in (name, held):
        browser.run(f"conurb.light.more.push({{ light: 'mean', share: 0.5 }}); conurb.flyToPhoto('{one}')")
        browser.click("#photo-light")
        lit = browser.run("[conurb.picture.look.appearance, document.querySelector('#light select').value]")
        check(lit == [one, one], f"a photo's light is that of the panel, too: {lit}")
    browser.run("conurb.setLight('mean')")
    rest(browser)


def plan(browser):
    browser.click("#tab-map")
    check(browser.run("document.querySelectorAll('#map .tile').length") == 3, "the plan shows the tiles")
    tile = browser.run("conurb.city.tiles[1].id")
    browser.run(f"document.querySelector(\"#map .tile[data-id='{tile}']\").dispatchEvent(new Event('click'))")
    browser.wait(f"conurb.tileShown === '{tile}'", 20)
    check("appearance" in browser.run("document.getElementById('map').textContent"), "a tile's effects are told")
    width = "document.querySelector('svg.plan').viewBox.baseVal.width"
    whole = browser.run(width)
    x, y = browser.middle("svg.plan")
    browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-240)
    browser.wait(f"{width} < 0.6 * {whole}", 20)
    browser.run("[...document.querySelectorAll('#map button')].find((b) => b.textContent === 'All').click()")
    check(browser.run(width) == whole, "the map zooms, and shows everything again")
    shoot(browser, "map")
    name = browser.run("conurb.city.views[2].name")
    browser.run("document.querySelectorAll('#map .photo')[2].dispatchEvent(new Event('click'))")
    browser.wait("conurb.geometry.norm(conurb.geometry.sub(conurb.camera.centre, conurb.city.views[2].centre)) < 1e-6",
                 20)
    check(name, "a photo of the plan can be flown to")
    rest(browser)


def paths(browser):
    browser.click("#tab-path")
    for view in (0, 3, 6):
        browser.run(f"conurb.camera.setPose(conurb.city.views[{view}])")
        browser.click("#add-key")
    check(browser.run("conurb.path.keys().length") == 3, "three keyframes")
    on_the_time_line(browser)
    choose(browser, "Time line", "1.5")
    check(pose(browser)["centre"] != browser.run("conurb.city.views[0].centre"), "the time line moves the camera")
    choose(browser, "Time line", "3")
    there = browser.run("conurb.geometry.norm(conurb.geometry.sub(conurb.camera.centre, conurb.city.views[3].centre))")
    check(there < 1e-6, "a keyframe is met")
    browser.click("#play")
    browser.wait("document.getElementById('play').textContent === 'Play'", 60)
    browser.run("document.querySelector('#path input[type=text]').value = 'tour'")
    browser.click("#save-path")
    file = f"{city}/views/paths/tour.json"
    end = time.monotonic() + 20
    while not os.path.exists(file) and time.monotonic() < end:
        time.sleep(0.05)
    with open(file, encoding="utf-8") as text:
        check(len(json.load(text)["keyframes"]) == 3, "the path is saved")
    shoot(browser, "path")
    as_its_film(browser)
    browser.run("[...document.querySelectorAll('#path button')].find((b) => b.textContent === 'Clear').click()")
    check(browser.run("conurb.path.keys().length") == 0, "the keyframes are cleared")
    browser.wait("[...document.querySelectorAll('#path button')].some((b) => b.textContent === 'tour')", 20)
    browser.run("[...document.querySelectorAll('#path button')].find((b) => b.textContent === 'tour').click()")
    browser.wait("conurb.path.keys().length === 3", 20)
    choose(browser, "Width", "160")
    browser.run("conurb.path.keys().splice(2); conurb.path.keys()[0].time = 0; conurb.path.keys()[1].time = 0.3")
    # The film has the settings of the picture.
    browser.run("""conurb.picture.setLook({ exposure_ev: 0.5, blend: 'ownership' });
        conurb.link.send = function (type, fields) {
        if (type === 'film') conurb.asked = fields;
        return Object.getPrototypeOf(this).send.call(this, type, fields); }""")
    browser.click("#render-path")
    browser.wait("conurb.film && conurb.film.state !== 'running'", 300)
    check(browser.run("conurb.film.state") == "done", f"a film is rendered: {browser.run('conurb.film')}")
    other = browser.run("""['appearance', 'display_view', 'look', 'exposure_ev', 'blend', 'crop'].filter((one) =>
        conurb.asked[one] !== conurb.picture.look[one])""")
    check(not other, f"the film is as the picture, but for: {other}")
    browser.run("delete conurb.link.send; conurb.picture.setLook({ exposure_ev: 0, blend: '' })")
    check(browser.run("conurb.jobFrame") >= 1, "its pictures are shown as they come")
    check(browser.run("document.getElementById('job-told').textContent") == "Film tour: done", "and that it is done")
    browser.run("document.getElementById('tab-look').click()")
    browser.click("#job-show")
    check(browser.run("!document.getElementById('path').hidden"), "a button leads to the film")
    check(os.path.exists(f"{city}/renders/tour/00000.png"), "its frames are there")
    browser.wait("document.querySelector('#film video')", 30)
    # A browser without the codec still has the controls.
    browser.run("conurb.video = document.querySelector('#film video')")
    browser.wait("conurb.video.readyState > 1 || conurb.video.error", 30)
    check(browser.run("document.querySelector('#film video').videoWidth") in (160, 0), "the film plays in the page")
    browser.middle("#film")
    shoot(browser, "film")
    missed_the_end(browser)


def as_its_film(browser):
    """A path is played with the cameras that its film has: they turn far, and twice they stay where they are."""
    keys = [{"time_s": i, "local": place, "heading_deg": h, "pitch_deg": p, "roll_deg": r, "vfov_deg": vfov}
            for i, (place, h, p, r, vfov) in enumerate((
                ([0, 0, 5], 10, -45, 0, 60), ([3, 1, 5], 160, -50, 20, 20), ([3, 1, 5], 250, 80, 0, 40),
                ([9, 4, 7], 20, 10, -30, 90), ([9, 4, 7], 20, 10, -30, 90)))]
    with open(f"{work}/turns.json", "w", encoding="utf-8") as file:
        json.dump({"fps": 10, "keyframes": keys}, file)
    subprocess.run([conurb, "export", city, "--camera", f"{work}/turns.chan", "--path", f"{work}/turns.json"],
                   check=True, capture_output=True)
    with open(f"{work}/turns.chan", encoding="utf-8") as file:
        film = [[float(x) for x in line.split()] for line in file]
    played = browser.run(f"""(() => {{ const keys = {json.dumps(keys)}.map((k) => ({{ time: k.time_s, state: {{
        centre: k.local, heading: k.heading_deg, pitch: k.pitch_deg, roll: k.roll_deg, vfov: k.vfov_deg }} }}));
        const n = {len(film)};
        return [...Array(n).keys()].map((i) => {{ const s = conurb.path.stateAt(keys, 4 * i / (n - 1));
          return {{ ...s, r: conurb.geometry.rotationOf(s) }}; }}); }})()""")
    apart = [0, 0, 0]
    for (_, x, y, z, *angles, vfov), here in zip(film, played):
        (sx, cx), (sy, cy), (sz, cz) = ((math.sin(math.radians(a)), math.cos(math.radians(a))) for a in angles)
        # The rotation is Ry Rx Rz; y is up and z south. The camera looks along -z, and its x is to the right.
        ahead, right = (-sy * cx, sx, -cy * cx), (cy * cz + sy * sx * sz, cx * sz, -sy * cz + cy * sx * sz)
        there = [(x, -z, y), *((v[0], -v[2], v[1]) for v in (right, ahead))]
        ours = [here["centre"], here["r"][:3], here["r"][6:]]
        apart[0] = max(apart[0], math.dist(there[0], ours[0]))
        apart[1] = max(apart[1], math.dist(there[1], ours[1]), math.dist(there[2], ours[2]))
        apart[2] = max(apart[2], abs(vfov - here["vfov"]))
    check(len(film) > 30 and max(apart) < 1e-3, f"a path is played as its film: {apart} apart in {len(film)} frames")


def missed_the_end(browser):
    """A page whose line broke while a film was made is told how it ended. What the server does not make is hidden."""
    told = "[document.getElementById('job').hidden, document.getElementById('job-told').textContent]"
    for name, then in (("tour", [False, "Film tour: done"]), ("gone", [True, "Film gone: it begins"])):
        browser.run(f"conurb.link.say('film', {{ state: 'running', name: '{name}' }})")
        check(browser.run(told) == [False, f"Film {name}: it begins"], "a film that runs is shown")
        browser.run("conurb.link.socket.close()")
        browser.wait(f"JSON.stringify({told}) === JSON.stringify({json.dumps(then)})", 30)
    rest(browser)


def on_the_time_line(browser):
    """Keyframes are dragged along the time line, and moved by keys; the whole path is made longer, and drawn."""
    check(browser.run("conurb.stage.marks.has('path')"), "the path is drawn in the picture")
    x, y = browser.middle(".track button:nth-child(2)")
    browser.drag((x, y), (x + 40, y))
    dragged = browser.run("conurb.path.keys()[1].time")
    check(3.2 < dragged < 5, f"a keyframe is dragged from 3 s to {dragged}")
    browser.run("document.querySelector('.track button:nth-child(2)').focus()")
    browser.key("ArrowLeft", "ArrowLeft")
    check(abs(browser.run("conurb.path.keys()[1].time") - dragged + 0.5) < 1e-6, "an arrow key moves it half a second")
    choose(browser, "Length, s", "12")
    check(browser.run("conurb.path.keys().at(-1).time") == 12, "the whole path is made longer")
    shoot(browser, "time-line")
    browser.run("conurb.path.keys()[1].time = 3")
    choose(browser, "Length, s", "6")
    browser.run("conurb.path.keys()[1].time = 3")


def kept_in_the_address(browser):
    """The address has the view: a reload comes back to it."""
    rest(browser)
    at = pose(browser)
    check(browser.run("location.hash.split(',').length") == 7, "the address has the view")
    browser.call("Page.reload")
    time.sleep(0.3)
    browser.wait("globalThis.conurb && conurb.shown", 60)
    browser.run("conurb.picture.most = 160; conurb.picture.refresh()")
    near = browser.run("conurb.camera.centre")
    check(all(abs(a - b) < 2e-3 for a, b in zip(at["centre"], near)), f"a reload comes back to {at}, not {near}")
    rest(browser)
    browser.run("location.hash = '#1,2,30,40,-50,0,60'")
    browser.wait("conurb.camera.centre[2] === 30 && conurb.camera.heading === 40", 20)  # an address that is pasted
    fly_home(browser)


def broken(browser):
    """A tile that is damaged while the page looks at it is told, and shown again when it is mended."""
    path = f"{city}/tiles/{browser.run('conurb.shown.tile')}/tile.safetensors"
    with open(path, "rb") as file:
        whole = file.read()
    for data in (whole[:1000], whole):
        with open(path + ".new", "wb") as file:
            file.write(data)
        os.replace(path + ".new", path)
        browser.run("conurb.picture.refresh()")
        if data != whole:
            browser.wait("document.getElementById('message').textContent.includes('tile.safetensors')", 60)
            check(browser.run("document.getElementById('message').classList.contains('bad')"), "a broken tile is told")
    rest(browser)
    check(look(browser)[1] > 0.8, "the mended tile is shown")


def training(browser):
    browser.click("#tab-training")
    browser.wait("document.querySelectorAll('#training strong').length >= 3", 20)
    shoot(browser, "training")
    # A tile that is replaced is drawn again.
    before = browser.run("conurb.shown.id")
    tile = browser.run("conurb.city.tiles[0].id")
    for name in ("tile.safetensors", "DONE"):
        path = f"{city}/tiles/{tile}/{name}"
        shutil.copy(path, path + ".new")
        os.replace(path + ".new", path)
    browser.wait(f"conurb.shown.id > {before}", 60)


def keyboard_only(browser):
    """The tabs by arrows, as their role says."""
    browser.run("document.getElementById('tab-look').click(); document.getElementById('tab-look').focus()")
    browser.key("ArrowRight", "ArrowRight")
    check(browser.run("document.activeElement.id") == "tab-light", "arrows go through the tabs")
    named = browser.run("""[...document.querySelectorAll('button, input, select')]
        .filter((e) => !(e.textContent.trim() ||
        e.getAttribute('aria-label') || e.title || e.placeholder || e.labels?.length)).map((e) => e.outerHTML)""")
    check(not named, f"every control has a name: {named}")
    check(not faint(browser), f"texts stand out from what is behind them: {faint(browser)}")


def pinch(browser):
    """Two fingers that part bring nearer."""
    at = pose(browser)
    for kind, half in (("touchStart", 30), ("touchMove", 45), ("touchMove", 60), ("touchEnd", None)):
        fingers = [{"x": 195 + half * side, "y": 250, "id": side} for side in (-1, 1)] if half else []
        browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=fingers)
    ahead = browser.run(f"""(() => {{ const now = conurb.camera.state(), from = {at['centre']}, r =
        conurb.geometry.rotationOf(now); return [0, 1, 2].reduce((sum, i) => sum + (now.centre[i] - from[i]) * r[6 + i],
        0); }})()""")
    check(ahead > 0.1, f"two fingers that part bring nearer: {ahead} m")


def by_buttons(browser):
    """Who has no keys walks by the buttons over the picture; a pinch does not leave the ground."""
    browser.click("[data-mode=walk]")
    browser.wait("conurb.standing === false", 60)
    at = pose(browser)
    x, y = browser.middle("#pad .ahead")
    for kind in ("touchStart", "touchEnd"):
        browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y}] * (kind == "touchStart"))
        time.sleep(0.6)
    walked = pose(browser)
    moved = [b - a for a, b in zip(at["centre"], walked["centre"])]
    check(moved[0] ** 2 + moved[1] ** 2 > 0.01 and abs(moved[2]) < 1.5, f"a button walks ahead, on the ground: {moved}")
    rest(browser)
    shoot(browser, "phone-walk")
    browser.click("[data-mode=orbit]")


def on_a_phone():
    browser = Browser(390, 780, dark=True, touch=True)
    try:
        browser.open(server.url)
        browser.wait("globalThis.conurb && conurb.shown", 60)
        browser.run("conurb.picture.most = 160; conurb.picture.refresh()")
        rest(browser)
        check(browser.run("document.getElementById('panel').getBoundingClientRect().right <= 390 "
                          "&& innerWidth === 390"), "nothing is wider than a phone")
        at = pose(browser)
        for kind, x in (("touchStart", 150), ("touchMove", 180), ("touchMove", 220), ("touchEnd", None)):
            browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": 200}] if x else [])
        check(pose(browser)["heading"] != at["heading"], "a finger turns the camera")
        rest(browser)
        shoot(browser, "phone")
        pinch(browser)
        by_buttons(browser)
        check(not faint(browser), f"texts stand out in the dark: {faint(browser)}")
        check(not browser.errors, f"no errors on a phone: {browser.errors}")
    finally:
        browser.close()


server = Server(conurb, city)
page = Browser()
try:
    for part in (first_picture, moving, upright, fly_home, channels, cropping, comparing, measuring, lights, photos,
                 plan, paths, training, broken, kept_in_the_address, keyboard_only):
        begin = time.monotonic()
        part(page)
        print(f"{part.__name__}: {time.monotonic() - begin:.1f} s", flush=True)
    check(not page.errors, f"the page logs no errors: {page.errors}")
    foreign = [url for url in page.requests if not url.startswith((server.url, "blob:", "data:", "about:"))]
    check(not foreign, f"nothing is asked of other hosts: {foreign}")
    on_a_phone()
finally:
    page.close()
    code, err = server.stop()
check(code == 0, f"the server ends with 0, not {code}: {err[-2000:]}")
shutil.rmtree(work)
finish()
