"""The server of `conurb view` under load, with bad clients and failures. Loopback only, and bounded.
robust.py CONURB DEMO MAKE_PHOTOS. CONURB_VIEW_LONG=1: a minute of 20 viewers and 10,000 connections."""
import json
import os
import random
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time

from checks import check, finish
from cities import change, made_city, new_city, quiet_run
from client import Page, Server, http

conurb, demo, make_photos = sys.argv[1:4]
LONG = os.environ.get("CONURB_VIEW_LONG") == "1"
# A sanitizer keeps freed memory for a while, so resident memory is not checked there.
SANITIZED = "CONURB_SLOW" in os.environ
work = tempfile.mkdtemp(prefix="conurb-robust-")
city = os.path.join(work, "city")
shutil.copytree(demo, city)


def settle(test, seconds=60):
    """Whether the test becomes true."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if test():
            return True
        time.sleep(0.1)
    return test()


def timed(part):
    begin = time.monotonic()
    part()
    print(f"{part.__name__}: {time.monotonic() - begin:.1f} s", flush=True)


def serves(what):
    page = Page(server)
    facts = page.ask("city")[0]
    head = page.ask("view", **fields(facts["views"][0]), moving=True)[0]
    check(head["type"] == "frame", f"{what}: the server still serves")
    page.close()
    check(settle(lambda: server.sockets() == quiet), f"{what}: no connection is left: {server.sockets()}, not {quiet}")


def fields(pose, width=64, height=48):
    return {"rotation": pose["rotation"], "centre": pose["centre"], "vfov_deg": pose["vfov_deg"], "width": width,
            "height": height}


def many_viewers(n=20):
    """Many viewers fly at the same time; each gets its share of pictures."""
    seconds = 60 if LONG else 4
    counts, wrong = [0] * n, []

    def fly(i):
        try:
            page = Page(server)
            views = page.ask("city")[0]["views"]
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                page.ask("view", **fields(views[(i + counts[i]) % len(views)], 48, 36), moving=True)
                counts[i] += 1
            page.close()
        except (OSError, RuntimeError, TimeoutError) as error:
            wrong.append(str(error))

    threads = [threading.Thread(target=fly, args=(i,)) for i in range(n)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    check(not wrong, f"every viewer is served: {wrong}")
    check(min(counts) > 0 and max(counts) <= 3 * min(counts) + 3, f"viewers share fairly: {sorted(counts)}")
    print(f"{n} viewers: {sum(counts) / seconds:.1f} pictures/s together, from {min(counts)} to {max(counts)} each")


def too_many_viewers():
    """More pages than sessions: the surplus is refused, and the others stay."""
    pages = [Page(server) for _ in range(64)]
    try:
        late = Page(server)
        late.send("city")
        late.until(lambda head: False, 20)
        check(False, "one page too many is refused")
    except (ConnectionError, TimeoutError) as error:
        check(isinstance(error, ConnectionError), "one page too many is refused at once")
    check(pages[0].ask("city")[0]["type"] == "city", "those that came before stay")
    for page in pages:
        page.close()


def who_do_not_read():
    """Clients that send requests and never read are disconnected; memory stays bounded."""
    before = server.resident_kb()
    deaf = [Page(server) for _ in range(4)]
    pose = deaf[0].ask("city")[0]["views"][0]
    for page in deaf:
        page.socket.settimeout(0.2)
        try:
            for _ in range(400):
                page.send("points")
                page.send("city")
                page.view(pose, 320, 240)
        except OSError:
            pass  # cut off already, or its own buffer is full
    other = Page(server)
    check(other.ask("view", **fields(pose), moving=True)[0]["type"] == "frame", "others are served meanwhile")
    other.close()
    grown = (server.resident_kb() - before) / 1024
    check(SANITIZED or grown < 400, f"memory stays bounded: it grew by {grown:.0f} MB")
    for page in deaf:
        page.close()


def half_requests():
    """Connections that never finish a request are closed after a while; others are not affected."""
    halves = []
    begun = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    for text in (b"", b"G", begun, begun + b"X: " + b"y" * 3000) * 6:
        halves.append(server.connect())
        halves[-1].sendall(text)
    begin = time.monotonic()
    check(http(server)[0] == 200 and time.monotonic() - begin < 5, "others do not wait for half requests")
    check(settle(lambda: server.sockets() <= quiet, 45), "half requests are given up")
    for half in halves:
        half.close()


def too_many_connections():
    many = []
    try:
        for _ in range(200):
            many.append(server.connect())
    except OSError:
        pass
    time.sleep(0.5)
    check(server.sockets() < 160, f"connections are limited: {server.sockets()}")
    for one in many:
        one.close()
    check(settle(lambda: server.sockets() == quiet), "they are gone")


def one_after_another():
    n = 10000 if LONG else 400
    for _ in range(50):
        http(server)
    before = server.resident_kb()
    for i in range(n):
        if i % 10:
            check(http(server, "/ui.js")[0] == 200, "every connection is served")
        else:
            Page(server).close()
    grown = server.resident_kb() - before
    check(SANITIZED or grown < 4096, f"{n} connections leave nothing behind: {grown} kB")
    print(f"{n} connections one after another: {grown} kB")


def leaving_in_mid_frame():
    for i in range(20):
        page = Page(server)
        pose = page.ask("city")[0]["views"][i]
        for slot in range(3):
            page.view(pose, 1200, 900, slot=slot)
        if i % 2:
            page.until(lambda head: head["type"] == "frame")
        page.close()


def slow_upload():
    """A photo over a slow line. While it is on its way the page answers no ping, and is not cut off."""
    seconds, page = 40 if LONG else 2, Page(server)
    head = json.dumps({"type": "fit", "id": 1, "name": "slow"}).encode()
    data = struct.pack("<I", len(head)) + head + b"\xff\xd8\xff" + b"x" * 1000000
    frame = b"\x82\xff" + struct.pack(">Q", len(data)) + bytes(4) + data
    part = len(frame) // seconds + 1
    for i in range(seconds):
        page.socket.sendall(frame[i * part:(i + 1) * part])
        time.sleep(1)
    done = page.until(lambda head: head["type"] == "fit" and head["state"] != "running")[0]
    check("cannot be read" in done["text"], f"a broken photo over a slow line: {done}")
    page.close()


def slow_download():
    """A film over a slow line: a ping is answered between its pieces, and the page is not cut off."""
    size, rate, answer = 18000000, 3e5 if LONG else 1e9, b"\x8a\x06there?"
    os.makedirs(f"{city}/renders/slow")
    with open(f"{city}/renders/slow/flight.mp4", "wb") as file:
        file.write(bytes(size))
    page = Page(server)
    page.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 17)
    page.send("film_show", name="slow")
    page.fill()
    page.send_raw(b"there?", opcode=9)
    begin, got, answered, end = time.monotonic(), len(page.rest), 0, b""
    while got < size:
        time.sleep(max(got / rate - (time.monotonic() - begin), 0))
        piece = page.socket.recv(1 << 16)
        if not piece:
            break
        got, end = got + len(piece), end[-len(answer):] + piece
        answered = answered or (got if answer in end else 0)
    check(got >= size, f"a page that reads slowly stays: {got} bytes in {time.monotonic() - begin:.0f} s")
    check(0 < answered < size / 2, f"a ping is answered after {answered} of {size} bytes")
    page.close()


def random_bytes():
    rng = random.Random(7)
    for i in range(120):
        noise = rng.randbytes(rng.randrange(1, 3000))
        try:
            if i % 2:
                page = Page(server)
                page.socket.sendall(noise)
                page.socket.settimeout(0.01)
                page.receive_raw()
                page.close()
            else:
                with server.connect() as s:
                    s.sendall(noise)
        except (OSError, ConnectionError, ValueError, IndexError):
            pass
    page = Page(server)
    good = json.dumps({"type": "view", "id": 1, **fields(page.ask("city")[0]["views"][0])}).encode()
    for _ in range(300):
        bad = bytearray(good)
        for _ in range(rng.randrange(1, 4)):
            bad[rng.randrange(len(bad))] = rng.randrange(32, 127)
        try:
            page.send_raw(bytes(bad))
        except OSError:
            page = Page(server)  # whoever does not read the answers is cut off
    page.close()


def broken_tile():
    """A damaged tile is reported; when it is repaired it is shown again."""
    page = Page(server)
    facts = page.ask("city")[0]
    tile = facts["tiles"][0]["id"]
    path = f"{city}/tiles/{tile}/tile.safetensors"
    with open(path, "rb") as file:
        whole = file.read()
    for damaged in (whole[:1000], b"", whole[:8] + b"\xff" * 200 + whole[208:]):
        with open(path + ".new", "wb") as file:
            file.write(damaged)
        os.replace(path + ".new", path)
        try:
            page.ask("view", **fields(facts["views"][0]), name=tile, moving=True)
            check(False, "a damaged tile is said to be")
        except RuntimeError as error:
            check("tile.safetensors" in str(error), f"a damaged tile: {error}")
    with open(path + ".new", "wb") as file:
        file.write(whole)
    os.replace(path + ".new", path)
    check(page.ask("view", **fields(facts["views"][0]), name=tile, moving=True)[0]["type"] == "frame", "a mended tile")
    page.close()


def killed_while_saving():
    """kill -9 at any moment: saved files are complete, and the next server starts."""
    path = {"keyframes": [{"time_s": i, "local": [i, 0, 5], "heading_deg": 0, "pitch_deg": 0} for i in range(200)]}
    folder = f"{city}/views/paths"
    for i in range(12 if LONG else 5):
        one = Server(conurb, city)
        page = Page(one)
        page.ask("save", what="path", name="kept", data=path)
        for k in range(12):
            page.send("save", what="path", name=f"p{k % 3}", data=path)
        time.sleep(0.004 * i)
        one.stop(signal.SIGKILL)
        page.close()
        for name in os.listdir(folder):
            if name.startswith("."):
                continue  # what was not finished
            with open(f"{folder}/{name}", encoding="utf-8") as file:
                check(json.load(file) == path, f"{name} is whole")
    one = Server(conurb, city)
    page = Page(one)
    names = page.ask("list", what="path")[0]["names"]
    check("kept" in names and set(names) <= {"kept", "p0", "p1", "p2"}, f"what was saved is listed: {names}")
    page.close()
    check(one.stop()[0] == 0, "the next server ends well")


def while_it_trains():
    """A page of a city without tiles or GPS. It follows training, and the tile has the same bytes as without it."""
    global server
    seen, alone = made_city(conurb, make_photos, f"{work}/seen", "none"), f"{work}/alone"
    shutil.copytree(seen, alone)
    quiet_run([conurb, "train", alone])
    server = Server(conurb, seen)
    page = Page(server)
    facts = page.ask("city")[0]
    tile = facts["tiles"][0]["id"]
    check(not facts["frame"]["georeferenced"], "a city without GPS")
    check(page.ask("view", **fields(facts["views"][0]), moving=True)[0]["tile"] == "", "no tile, an empty picture")
    training = subprocess.Popen([conurb, "train", seen], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    pictures = 0
    while training.poll() is None:
        page.ask("view", **fields(facts["views"][pictures % len(facts["views"])], 200, 150), moving=True)
        pictures += 1
    check(training.returncode == 0 and pictures > 0, "training ends well while pictures are drawn")
    page.send("city")  # whoever asks is told the state again
    page.until(lambda head: head["type"] == "state" and tile in head["trained"])
    check(page.ask("view", **fields(facts["views"][0]), moving=True)[0]["tile"] == tile, "the tile shows")
    check(page.ask("photo", name=facts["views"][0]["name"], width=32)[1][:2] == b"\xff\xd8", "a photo")
    check(len(page.ask("tile", name=tile)[0]["curve"]["step"]) > 0, "a curve")
    check(not os.path.exists(f"{seen}/tiles/{tile}/unfinished.safetensors"), "what is finished stands alone")
    weights = [f"{folder}/tiles/{tile}/tile.safetensors" for folder in (alone, seen)]
    with open(weights[0], "rb") as one, open(weights[1], "rb") as two:
        check(one.read() == two.read(), "training makes the same tile, whoever looks")
    page.close()
    check(server.stop()[0] == 0, "the server ends well")


def as_it_grows():
    """A tile in training shows as its last checkpoint has it, and again after the next one."""
    global server
    folder = made_city(conurb, make_photos, f"{work}/growing", "all")
    change(folder, lambda text: text.replace("steps: 60\n", "steps: 1000000\n  checkpoint_every_s: 0.5\n", 1))
    server = Server(conurb, folder)
    page = Page(server)
    facts = page.ask("city")[0]
    tile = facts["tiles"][0]["id"]
    training = subprocess.Popen([conurb, "train", folder, "--tile", tile], stdout=subprocess.DEVNULL,
                                stderr=subprocess.DEVNULL)
    try:
        seen = set()
        while len(seen) < 2:
            state = page.until(lambda head: head["type"] == "state" and tile in head["trained"])[0]
            seen.add(state["trained"][tile])
        check(training.poll() is None and not os.path.exists(f"{folder}/tiles/{tile}/DONE"), "the tile is in training")
        answers = [page.ask("view", **fields(facts["views"][0]), moving=True) for _ in range(2)]
        check(answers[0][0]["tile"] == tile, "a tile in training shows")
    finally:
        training.send_signal(signal.SIGINT)
        training.wait()
    check(training.returncode == 75, f"training stops when asked to, with 75, not {training.returncode}")
    check(page.ask("view", **fields(facts["views"][0]), moving=True)[0]["tile"] == tile, "it still shows afterwards")
    page.close()
    check(server.stop()[0] == 0, "the server ends well")


def without_its_lens():
    """A photo to lie beside its render, which is a pinhole's: its lens bends lines inwards at the edges."""
    pictures = []
    for bent in (0, 0.5):
        folder = new_city(conurb, make_photos, f"{work}/lens{bent}", "none")
        with open(f"{folder}-photos/transforms.json", encoding="utf-8") as file:
            poses = json.load(file)
        with open(f"{folder}-photos/transforms.json", "w", encoding="utf-8") as file:
            json.dump({**poses, "k1": bent}, file)
        quiet_run([conurb, "poses", folder])
        quiet_run([conurb, "plan", folder])
        one = Server(conurb, folder)
        page = Page(one)
        name = page.ask("city")[0]["views"][0]["name"]
        pictures.append([page.ask("photo", name=name, straight=straight)[1] for straight in (False, True)])
        page.close()
        one.stop()
    (plain, same), (bent, straight) = pictures
    check(plain == same == bent and straight != bent, "a photo is straightened as far as its lens bends")


def page_of_files(folder):
    """`export --page`: the files that index.html refers to exist, and no other host is contacted."""
    out = f"{work}/page"
    quiet_run([conurb, "export", folder, "--page", out, "--minutes", "0.1"])
    with open(f"{out}/index.html", encoding="utf-8") as file:
        text = file.read()
    named = re.findall(r'(?:src|href)="([^"]*)"', text)
    check(len(named) >= 4 and all(os.path.getsize(f"{out}/{name}") > 0 for name in named), f"a page of files: {named}")
    check("http" not in text, "the page of files asks nothing of other hosts")


def beside_training():
    """`train --view`: one command trains and serves the page; Ctrl-C ends both."""
    global server
    shown = made_city(conurb, make_photos, f"{work}/shown", "all")
    server = Server(conurb, shown, command=[conurb, "train", shown, "--view"])
    page = Page(server)
    page.send("city")
    tile = page.until(lambda head: head["type"] == "state" and head["trained"])[0]
    check(tile, "the page sees the tile")
    page.close()
    # This waits until no process holds the server's output any more. Its port tells nothing: another test that runs at
    # the same time may have it by now.
    code, err = server.stop(signal.SIGINT)
    check(code in (0, 75), f"Ctrl-C ends both: {code}, {err[-500:]}")
    page_of_files(f"{work}/shown")


server = Server(conurb, city)
try:
    # Count before the first connection: later, a connection that is being closed may count.
    quiet = server.sockets()
    http(server)
    for part in (many_viewers, too_many_viewers, leaving_in_mid_frame, who_do_not_read, half_requests,
                 too_many_connections, one_after_another, slow_upload, slow_download, random_bytes, broken_tile):
        timed(part)
        serves(part.__name__)
finally:
    code, err = server.stop()
check(code == 0, f"the server ends with 0, not {code}: {err[-3000:]}")
for part in (killed_while_saving, while_it_trains, as_it_grows, beside_training, without_its_lens):
    timed(part)
shutil.rmtree(work)
finish()
