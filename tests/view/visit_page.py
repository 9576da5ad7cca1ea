"""What a visitor of the page meets beside its controls, in a headless Chromium: links, names in use, servers that stop,
proxies, small windows, and less motion. visit_page.py CONURB DEMO [FOLDER for screenshots]"""
import json
import os
import shutil
import socket
import sys
import tempfile
import threading
import time

from browser import Browser
from checks import check, finish, need_chromium, shoot
from client import Page, Server
from controls import pose, rest

need_chromium()

conurb, demo = sys.argv[1:3]
work = tempfile.mkdtemp(prefix="conurb-visit-")
city = os.path.join(work, "city")
shutil.copytree(demo, city)
MESSAGE = "document.getElementById('message').textContent"
SESSIONS = 64  # CN_SESSION_MAX


def visit(browser, url):
    # The first picture needs not be large.
    browser.call("Page.addScriptToEvaluateOnNewDocument",
                 source="""addEventListener('DOMContentLoaded', () => { const wait = setInterval(() => {
                     if (!globalThis.conurb?.picture) return;
                     conurb.picture.most = 64; clearInterval(wait); }); })""")
    browser.open("about:blank")
    browser.open(url)
    browser.wait("globalThis.conurb && conurb.shown", 60)
    browser.run("conurb.picture.most = 64; conurb.picture.refresh()")
    rest(browser)


def a_link(browser):
    """What a copied address opens is what was seen: camera, lights, crop and settings."""
    light, other = browser.run("conurb.city.views.filter((v) => !v.held_out).map((v) => v.name)")[:2]
    third = browser.run("conurb.city.views.filter((v) => !v.held_out).at(-1).name")
    browser.run(f"conurb.setLights({{ a: {json.dumps(light)}, b: {json.dumps(other)}, t: 0.25, "
                f"more: [{{ light: {json.dumps(third)}, share: 0.5 }}] }})")
    browser.click("#crop")
    browser.run("conurb.picture.setLook({ exposure_ev: 1.5, blend: 'nearest', channel: 'depth' })")
    rest(browser)
    settings = """JSON.stringify([conurb.picture.look.appearance, conurb.picture.look.exposure_ev,
        conurb.picture.look.blend, conurb.picture.look.channel, conurb.picture.look.crop.map((x) => x.toFixed(1))])"""
    address, seen = browser.run("location.href"), browser.run(settings)
    check(len(address) < 2000, f"the address is short: {len(address)}")
    visit(browser, address)
    check(browser.run(settings) == seen, f"the link opens {seen}, not {browser.run(settings)}")
    shown = browser.run("""['Show', 'Blending', 'Exposure', 'From', 'To', 'Between'].map((text) => {
        const label = [...document.querySelectorAll('label')].find((l) => l.textContent === text);
        return document.getElementById(label.htmlFor).value; })""")
    check(shown == ["depth", "nearest", "1.5", light, other, "0.25"], f"the controls show it: {shown}")
    browser.run("location.hash = location.hash.split('&')[0] + '&light=nobody.jpg'")
    browser.wait(f"{MESSAGE}.includes('nobody.jpg')", 20)
    rest(browser)
    check(browser.run("conurb.picture.look.appearance") == "mean" and not browser.run("conurb.picture.look.crop"),
          "an address without settings has none, and a light that is not there is told")
    check("&" not in browser.run("location.hash"), "settings as at first are not in the address")


def a_name_in_use(browser):
    """A path that another page saved is not lost; asked twice, it is replaced."""
    other = Page(server)
    keys = [{"time_s": t, "local": [0, 0, 5], "heading_deg": 90, "pitch_deg": 0} for t in (0, 1)]
    other.ask("save", what="path", name="walk", data={"fps": 24, "keyframes": keys})
    other.close()
    browser.click("#tab-path")
    browser.run("document.querySelector('#path input[type=text]').value = 'walk'")
    browser.click("#save-path")
    browser.wait(f"{MESSAGE} === 'Add a view to the path first.'", 20)
    browser.click("#add-key")

    def saved():
        with open(f"{city}/views/paths/walk.json", encoding="utf-8") as file:
            return len(json.load(file)["keyframes"])

    browser.click("#save-path")
    browser.wait(f"{MESSAGE}.includes('already')", 20)
    check(saved() == 2, "a path of another page stays")
    browser.click("#save-path")
    browser.wait(f"{MESSAGE} === 'Saved.'", 20)
    check(saved() == 1, "asked again, it is replaced")


def undone(browser):
    """Keyframes that were cleared or deleted come back."""
    browser.click("#tab-path")
    browser.click("#add-key")
    n = browser.run("conurb.path.keys().length")
    for button in ("Clear", "×"):
        browser.run(f"[...document.querySelectorAll('#path button')].find((b) => b.textContent === '{button}').click()")
        check(browser.run("conurb.path.keys().length") < n, f"{button} takes keyframes away")
        browser.click("#undo-path")
        check(browser.run("conurb.path.keys().length") == n, f"they come back after {button}")


def measured(browser):
    """The distance can be read as long as its line is there."""
    browser.click("#measure")
    for where in ([260, 400], [300, 420]):
        browser.click(where)
        browser.wait(f"conurb.stage.marks.has('measure') && /second| across/.test({MESSAGE})", 60)
    browser.wait(f"{MESSAGE}.includes(' across')", 60)
    time.sleep(4.5)  # longer than other texts stay
    check(" across" in browser.run(MESSAGE), "a distance stays until it is told away")
    browser.click("#measure")
    check(browser.run(MESSAGE) == "", "and is gone after that")


def windows(browser):
    """Nothing is cut off in a window of 320 px, and buttons are under nothing but their own text."""
    for width, height, touch in ((320, 568, True), (667, 375, True), (568, 320, True), (320, 256, False)):
        browser.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
                     mobile=touch)
        browser.call("Emulation.setTouchEmulationEnabled", enabled=touch)
        browser.click("[data-mode=fly]")
        time.sleep(0.3)
        rest(browser)
        shoot(browser, f"window-{width}-{height}")
        # Buttons that others cover, or that are outside.
        bad = browser.run("""[...document.querySelectorAll('#top button, #tabs button, #compass, #pad button')]
            .filter((e) => e.getClientRects().length).filter((e) => { const b = e.getBoundingClientRect();
              const at = document.elementFromPoint(b.x + b.width / 2, b.y + b.height / 2);
              return b.left < 0 || b.right > innerWidth || !e.contains(at); }).map((e) => e.textContent.trim())""")
        check(not bad, f"{width} x {height}: {bad} can be pressed")
        under = browser.run("""(() => { const boxes = (q) => [...document.querySelectorAll(q)].map((e) =>
            e.getBoundingClientRect()).filter((b) => b.width); return boxes('#readout span').some((a) =>
            boxes('#top button, #pad button').some((b) => a.left < b.right && b.left < a.right && a.top < b.bottom &&
            b.top < a.bottom)); })()""")
        check(not under, f"{width} x {height}: no text covers a button")
    browser.click("[data-mode=orbit]")
    browser.call("Emulation.setDeviceMetricsOverride", width=900, height=600, deviceScaleFactor=1, mobile=False)
    browser.call("Emulation.setTouchEmulationEnabled", enabled=False)
    rest(browser)


def less_motion(browser):
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
    browser.run("conurb.camera.flyTo({ ...conurb.camera.state(), heading: 123 })")
    check(pose(browser)["heading"] == 123, "who wants less motion is there at once")
    browser.call("Emulation.setEmulatedMedia", features=[])


def many_photos(browser):
    """Lists that are cut say so."""
    browser.run("""(() => { const { views } = conurb.city; conurb.kept = views.length;
        for (let i = 0; i < 1000; i++) views.push({ ...views[0], name: `more-${i}.jpg` }); })()""")
    browser.click("#tab-photos")
    told = browser.run("document.getElementById('photos-rest').textContent")
    check("The first 1000 of" in told, f"a list of 1000 photos says that there are more: {told}")
    browser.run("conurb.city.views.splice(conurb.kept)")
    browser.click("#tab-look")
    browser.click("#tab-photos")
    check(browser.run("document.getElementById('photos-rest').hidden"), "a whole list does not")


def too_many_pages(browser):
    others = []
    try:
        for _ in range(SESSIONS):
            others.append(Page(server))
            others[-1].ask("list", what="path")
    except ConnectionError:
        pass  # this page's connection is one of them
    browser.run("conurb.link.socket.close()")
    time.sleep(0.2)
    others.append(Page(server))
    browser.wait(f"{MESSAGE}.includes('too many pages')", 30)
    for one in others:
        one.close()
    browser.wait(f"{MESSAGE} === ''", 30)  # nothing is wrong any more


def proxy_to(port, path):
    """The port of a proxy that serves what is on another port below a path, and keeps the browser's headers."""
    front = socket.create_server(("127.0.0.1", 0))

    def pump(source, sink, change):
        try:
            while data := source.recv(65536):
                sink.sendall(data.replace(f" {path}/".encode(), b" /") if change else data)
        except OSError:
            pass
        for one in (source, sink):
            one.close()

    def serve():
        while True:
            one = front.accept()[0]
            other = socket.create_connection(("127.0.0.1", port))
            for args in ((one, other, True), (other, one, False)):
                threading.Thread(target=pump, args=args, daemon=True).start()

    threading.Thread(target=serve, daemon=True).start()
    return front.getsockname()[1]


def behind_a_proxy(browser):
    visit(browser, f"http://127.0.0.1:{proxy_to(server.port, '/beach')}/beach/")
    check(browser.run("conurb.link.socket.url").endswith("/beach/socket"), "the page works below a path")


def another_city(browser):
    """A server of another city at the address of an open page: the page begins anew."""
    other = os.path.join(work, "lake")
    shutil.copytree(demo, other)
    first = Server(conurb, city)
    visit(browser, first.url)
    first.stop()
    second = Server(conurb, other, command=[conurb, "view", other, "--port", str(first.port)])
    try:
        browser.run("conurb.old = true")
        browser.wait("globalThis.conurb && !conurb.old && conurb.city?.name === 'lake' && conurb.shown", 60)
        check(browser.run("document.title").startswith("lake"), "the page is of the other city")
    finally:
        second.stop()


def a_new_token(browser):
    """A server that is started again under an open page, and asks for another token."""
    options = ("--host", "0.0.0.0")
    first = Server(conurb, city, *options)
    visit(browser, first.url.replace("localhost", "127.0.0.1"))
    command = [conurb, "view", city, "--port", str(first.port), *options]
    first.stop()
    browser.wait(f"{MESSAGE}.includes('was lost')", 30)
    second = Server(conurb, city, command=command)
    try:
        browser.wait(f"{MESSAGE}.includes('new token')", 30)
    finally:
        second.stop()


server = Server(conurb, city)
page = Browser(900, 600)
try:
    visit(page, server.url)
    for part in (a_link, a_name_in_use, undone, measured,
                 windows, less_motion, many_photos, too_many_pages, behind_a_proxy):
        begin = time.monotonic()
        part(page)
        print(f"{part.__name__}: {time.monotonic() - begin:.1f} s", flush=True)
    check(not page.errors, f"the page logs no errors: {page.errors}")
    another_city(page)
    a_new_token(page)
finally:
    page.close()
    code, err = server.stop()
check(code == 0, f"the server ends with 0, not {code}: {err[-2000:]}")
shutil.rmtree(work)
finish()
