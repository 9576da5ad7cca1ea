"""The server of `conurb view` from outside: access control, answers, and bad requests.
server.py CONURB DEMO"""
import json
import os
import shutil
import signal
import struct
import sys
import tempfile
import time

from checks import check, finish
from client import Page, Server, http

conurb, demo = sys.argv[1:3]
work = tempfile.mkdtemp(prefix="conurb-view-")
city = os.path.join(work, "city")
shutil.copytree(demo, city)


def refused(**options):
    try:
        Page(server, **options).close()
    except ConnectionError:
        return True
    return False


def digest():
    """Names, sizes and times of the city's files, except those that viewers may save."""
    return sorted((os.path.join(folder, name), os.stat(os.path.join(folder, name)).st_mtime_ns)
                  for folder, _, names in os.walk(city) for name in names if "/views" not in folder)


def the_page():
    status, head, body = http(server)
    check(status == 200 and b"<canvas" in body, "the page is there")
    policy = head.get("content-security-policy", "")
    check("default-src 'none'" in policy and "unsafe" not in policy, "the policy is strict")
    check(head.get("x-content-type-options") == "nosniff", "types are not guessed")
    check(len(body) == int(head["content-length"]), "the page is whole")
    check(http(server, method="HEAD")[2] == b"", "HEAD has no body")
    for path, status in (("/main.js", 200), ("/nothing", 404), ("/../etc/passwd", 404), ("/%2e%2e/etc/passwd", 404)):
        check(http(server, path)[0] in (status, 403), f"{path} is {status}")
    check(http(server, method="POST", body=b"x" * 10, Content_Length="10")[0] in (0, 405), "POST is refused")


def who_may_speak():
    for host in ("evil.example", f"evil.example:{server.port}", "127.0.0.1.evil.example", "192.168.1.1"):
        check(http(server, Host=host)[0] == 403, f"Host {host} gets no page")
        check(refused(host=host), f"Host {host} gets no socket")
    for origin in ("http://evil.example", "null", "http://127.0.0.1:1"):
        check(http(server, Origin=origin)[0] == 403, f"Origin {origin} gets no page")
        check(refused(origin=origin), f"Origin {origin} gets no socket")
    Page(server, origin=f"http://127.0.0.1:{server.port}").close()
    Page(server, host="localhost:8080", origin="http://localhost:8080").close()  # as through ssh -L 8080:...


def priorities(of):
    """How nice each thread of a server is."""
    tasks = f"/proc/{of.process.pid}/task"
    return [int(open(f"{tasks}/{task}/stat").read().rsplit(")", 1)[1].split()[16]) for task in os.listdir(tasks)]


def training_comes_first():
    """Also training that begins later: the threads that render are nicer, unless --share says how many they are."""
    Page(server).close()
    own = os.nice(0)
    lower = sum(nice == min(own + 3, 19) for nice in priorities(server))
    check(lower > os.cpu_count(), "rendering comes after training")
    half = Server(conurb, city, "--share", "0.5")
    Page(half).close()
    check(set(priorities(half)) == {own}, "--share leaves the priority alone")
    half.stop()


def pictures():
    page = Page(server)
    facts = page.ask("city")[0]
    check(len(facts["tiles"]) == 3 and facts["views"] and facts["frame"]["georeferenced"], "the facts of the city")
    pose = facts["views"][0]
    number = page.view(pose)
    passes = []
    while not passes or not passes[-1]["last"]:
        head, jpeg, tail = page.until(lambda h: h.get("id") == number)
        check(jpeg[:2] == b"\xff\xd8", "a pass is a JPEG")
        check(len(tail) == 2 * head["grid"][0] * head["grid"][1], "depths fill their grid")
        passes.append(head)
    # A page that reads slowly gets only the newest pass.
    check(passes[-1]["pass"] == 8 and passes[-1]["width"] == 64, "the last pass is the full one")
    colour = page.ask("view", **view_fields(pose), moving=True)[1]
    for channel in ("depth", "normal", "opacity", "tiles", "occlusion", "coverage"):
        check(page.ask("view", **view_fields(pose), moving=True, channel=channel)[1] != colour, f"channel {channel}")
    other = page.ask("view", **view_fields(pose), moving=True, appearance="run3-night_street_0010.jpg")[1]
    check(other != colour, "another light is another picture")
    mixed = page.ask("view", **view_fields(pose), moving=True, appearance="mean:run3-night_street_0010.jpg:0.5")[1]
    check(mixed not in (colour, other), "a mix of the mean and a photo is a third one")
    far = page.ask("view", **view_fields(pose), moving=True, crop=[9e5] * 3 + [9.1e5] * 3)
    check(not any(struct.unpack(f"<{len(far[2]) // 2}e", far[2])), "nothing is left of a crop elsewhere")
    size = {"width": 64, "height": round(64 / pose["aspect"]), "moving": True, "photo": pose["name"]}
    elsewhere = {**view_fields(pose), "centre": [0, 0, 999], "vfov_deg": 20, **size}
    of_photo = page.ask("view", **elsewhere)[1]
    check(of_photo == page.ask("view", **{**view_fields(pose), **size})[1], "a photo's name gives its pose and lens")
    check(of_photo != page.ask("view", **{**elsewhere, "photo": ""})[1], "which the page's own are not")
    head, _, tail = page.ask("view", **{**view_fields(pose), "width": 3, "height": 3}, slot=3)
    check(head["jpeg"] == 0 and struct.unpack("<9e", tail)[4] > 0, "a probe says how far it is")
    for fields, text in (({"appearance": "no such photo"}, "no photo is named"),
                         ({"name": "nowhere"}, "no trained tile"),
                         ({"photo": "nowhere.jpg"}, "nowhere.jpg"),
                         ({"display_view": "nonsense"}, "view")):
        try:
            page.ask("view", **view_fields(pose), **fields)
            check(False, f"{fields} is refused")
        except RuntimeError as error:
            check(text in str(error), f"{fields}: {error}")
    page.close()


def view_fields(pose):
    return {"rotation": pose["rotation"], "centre": pose["centre"], "vfov_deg": pose["vfov_deg"], "width": 64,
            "height": 48}


def a_new_picture_ends_the_old_one():
    page = Page(server)
    pose = page.ask("city")[0]["views"][0]
    old = page.view(pose, 1600, 1200)
    page.until(lambda h: h.get("id") == old)
    begin = time.monotonic()
    new = page.view(pose, 32, 24, moving=True)
    ids = []
    while not ids or ids[-1] != new:
        ids.append(page.until(lambda h: h["type"] == "frame")[0]["id"])
    check(len(ids) <= 2, f"what is left of the old picture is dropped: {ids}")
    check(time.monotonic() - begin < 10, "the new picture does not wait for the old one")
    page.close()


def other_questions():
    page = Page(server)
    tile = page.ask("city")[0]["tiles"][0]["id"]
    facts = page.ask("tile", name=tile)[0]
    check({"appearance", "sky"} <= {e["name"] for e in facts["effects"]} and facts["photos"], "a tile's facts")
    head, _, points = page.ask("points")
    check(head["n"] > 0 and len(points) == 16 * head["n"], "points")
    for kind, fields in (("tile", {"name": "nowhere"}), ("photo", {"name": "nowhere"}),
                         ("photo", {"name": facts["photos"][0]})):
        try:
            page.ask(kind, **fields)
            check(False, f"{kind} {fields} fails in a city without photos")
        except RuntimeError as error:
            check(len(str(error)) > 10, f"{kind}: {error}")
    page.close()


def saving():
    page = Page(server)
    path = {"fps": 24, "keyframes": [{"time_s": 0, "local": [0, 0, 5], "heading_deg": 0, "pitch_deg": 0},
                                     {"time_s": 1, "local": [1, 0, 5], "heading_deg": 10, "pitch_deg": 0}]}
    page.ask("save", what="path", name="round", data=path)
    check(page.ask("list", what="path")[0]["names"] == ["round"], "a saved path is listed")
    check(page.ask("load", what="path", name="round")[0]["data"] == path, "a saved path is loaded")
    with open(f"{city}/views/paths/round.json", encoding="utf-8") as file:
        check(json.load(file) == path, "the file is what was saved")
    try:
        page.ask("save", what="path", name="bad", data={"keyframes": [{"nonsense": 1}]})
        check(False, "a path that cannot be rendered is not saved")
    except RuntimeError as error:
        check("nonsense" in str(error), f"a bad path: {error}")
    check(os.listdir(f"{city}/views/paths") == ["round.json"], "nothing else is left")
    os.makedirs(f"{city}/renders/flight")
    for name, text in (("round", "a path is named 'round'"), ("flight", "renders/flight")):
        try:
            page.ask("save", what="path", name=name, data=path, fresh=True)
            check(False, f"{name} is in use")
        except RuntimeError as error:
            check(text in str(error), f"a name in use: {error}")
    os.rmdir(f"{city}/renders/flight")
    check(os.listdir(f"{city}/views/paths") == ["round.json"], "nothing is saved under a name in use")
    page.ask("save", what="light", name="dusk", data={"appearance": "mean"}, fresh=True)
    check(page.ask("list", what="light")[0]["names"] == ["dusk"], "a saved light is listed")
    page.close()


def made_film(page, **fields):
    """Makes a film of the saved path; what the server says at its end."""
    page.send("film", name="round", width=32, **fields)
    return page.until(lambda h: h["type"] == "failed" or h["type"] == "film" and h["state"] != "running", 300)[0]


def films():
    page = Page(server)
    done = made_film(page)
    check(done["state"] == "done" and os.path.exists(f"{city}/renders/round/flight.mp4"), f"a film is made: {done}")
    late = Page(server)
    late.send("city")
    again = late.until(lambda h: h["type"] == "film")[0]
    check(again == done, f"a page that was away is told how it ended: {again}")
    late.close()
    film = page.ask("film_show", name="round")[2]
    with open(f"{city}/renders/round/flight.mp4", "rb") as file:
        check(film == file.read(), "the page gets the film")
    check(page.ask("film_show", name="round", frame=2)[2][:4] == b"\x89PNG", "and one of its pictures")
    try:
        page.ask("film_show", name="round", frame=9999)
        check(False, "a picture that the film does not have is refused")
    except RuntimeError as error:
        check("09998.png" in str(error), f"a picture that the film does not have: {error}")
    try:
        page.ask("film_show", name="no-film")
        check(False, "a film that was not made is refused")
    except RuntimeError as error:
        check("'no-film' has no film yet" in str(error), f"a film that was not made: {error}")
    first = page.ask("film_show", name="round", frame=1)[2]
    done = made_film(page, exposure_ev=2, display_view="Raw")
    check(done["state"] == "done" and page.ask("film_show", name="round", frame=1)[2] != first,
          f"a film has the page's exposure and view: {done}")
    for fields in ({"crop": [9e5] * 3 + [9.1e5] * 3}, {"blend": "ownership"}):
        done = made_film(page, **fields)
        other = page.ask("film_show", name="round", frame=1)[2]
        check(done["state"] == "done" and other != first, f"a film with {fields} is another one: {done}")
    for fields in ({"display_view": "nonsense"}, {"look": "nonsense"}, {"blend": "nonsense"}):
        done = made_film(page, **fields)
        check(done["state"] == "failed" and "nonsense" in done["text"], f"a film with {fields}: {done}")
    page.close()


def nonsense():
    for data in (b"", b"{", b"[]", b"\xff\xfe", b"{}", b'{"type":"view"}', b"[" * 5000):
        page = Page(server)
        page.send_raw(data)
        check(page.receive()[0]["type"] == "failed", f"{data[:20]} is answered")
        page.close()
    page = Page(server)
    pose = view_fields(page.ask("city")[0]["views"][0])
    for kind, fields in (("view", {**pose, "vfov_deg": 175}), ("fly", {}), ("film", {"name": "a/b"})):
        number = page.send(kind, **fields)
        told = page.until(lambda h: h["type"] == "failed")[0]
        check(told["id"] == number, f"whoever asks for {kind} {fields} is told that it fails: {told}")
    page.close()
    for data, opcode in ((b"x" * 300000, 1), (b"x", 3)):
        page, closed, told = Page(server), False, []
        try:
            page.send_raw(data, opcode)
            page.until(lambda h: told.append(h), 20)  # the state of the city is told to every page
        except TimeoutError:
            pass
        except OSError:
            closed = True
        check(closed, f"opcode {opcode}, {len(data)} bytes: the connection is closed: {told}")
        page.close()
    check(http(server)[0] == 200, "the server lives")


def uploads():
    """Photos to fit a light to: bad ones are refused, and the page stays connected."""
    page, head = Page(server), json.dumps({"type": "fit", "id": 9, "name": "dusk"}).encode()
    good = struct.pack("<I", len(head)) + head
    for data, text in ((b"x", "whole head"), (good + b"<html>", "no JPEG or PNG"), (b"\xff" * 8, "whole head"),
                       (good + b"\xff\xd8\xff" + b"x" * (33 << 20), "32 MB")):
        page.send_raw(data, 2)
        told = page.until(lambda h: h["type"] == "failed")[0]["text"]
        check(text in told, f"a photo of {len(data)} bytes: {told}")
    page.send_raw(good + b"\xff\xd8\xff broken", 2)
    done = page.until(lambda h: h["type"] == "fit" and h["state"] != "running")[0]
    check(done["state"] == "failed" and "photo.jpg" in done["text"], f"a broken photo: {done}")
    check(page.ask("city")[0]["type"] == "city", "the page is still served")
    check(not os.path.exists(f"{city}/views/fitted"), "nothing is kept")
    page.close()


def two_servers(cookie):
    """A browser sends the cookies of all servers of a host to each of them, and keeps one of a name."""
    other = Server(conurb, city, "--host", "0.0.0.0")
    try:
        head = http(other, f"/?token={other.token}")[1]
        kept = dict(one.split("=") for one in (cookie, head["set-cookie"].split(";")[0]))
        both = "; ".join(f"{name}={value}" for name, value in kept.items())
        check(http(server, "/main.js", Cookie=both)[0] == 200 and http(other, "/main.js", Cookie=both)[0] == 200,
              "two servers do not throw out each other's pages")
    finally:
        other.stop()


def with_a_token():
    global server
    server = Server(conurb, city, "--host", "0.0.0.0")
    try:
        check(server.token and len(server.token) == 32, "a token is printed")
        check(http(server)[0] == 401, "no page without the token")
        check(http(server, f"/?token={'0' * 32}")[0] == 401, "no page with another token")
        status, head, _ = http(server, f"/?token={server.token}")
        cookie = head.get("set-cookie", "")
        check(status == 200 and "HttpOnly" in cookie and "SameSite=Strict" in cookie, "the token opens the page")
        cookie = cookie.split(";")[0]
        check(http(server, "/main.js", Cookie=cookie)[0] == 200 and http(server, "/main.js")[0] == 401,
              "files by cookie")
        check(refused() and refused(cookie=cookie[:-1] + "x"), "no socket without the token")
        Page(server, cookie=cookie).close()
        two_servers(cookie)
        check(http(server, f"/?token={server.token}", Host="evil.example")[0] == 403, "a foreign name stays out")
    finally:
        check(server.stop()[0] == 0, "the server with a token ends well")


server = Server(conurb, city)
try:
    before = digest()
    for part in (the_page, who_may_speak, training_comes_first, pictures, a_new_picture_ends_the_old_one,
                 other_questions, nonsense, uploads):
        part()
    check(digest() == before, "nothing was written into the city")
    saving()
    films()
finally:
    code, err = server.stop(signal.SIGINT)
check(code == 0, f"Ctrl-C ends the server with 0, not {code}: {err[-3000:]}")
with_a_token()
shutil.rmtree(work)
finish()
