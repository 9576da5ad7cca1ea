"""Training's share of the processor beside three viewers that ask for pictures of 960 x 540 without pause.
share.py CONURB CITY [SECONDS]
CITY is planned and has a trained tile; it is copied, and the copy is trained anew. Two ways: `conurb view CITY` first
and then `conurb train COPY`; and `conurb train COPY --view` with the viewers on its page."""
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "view"))
from client import Page, Server  # noqa: E402

conurb, city = sys.argv[1:3]
seconds = float(sys.argv[3]) if len(sys.argv) > 3 else 30
TICK = os.sysconf("SC_CLK_TCK")


def spent_s(pid):
    """Processor time of a process, in seconds."""
    with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def child_of(pid):
    with open(f"/proc/{pid}/task/{pid}/children", encoding="utf-8") as file:
        return int(file.read().split()[0])


def look(server, done):
    page = Page(server)
    view = page.ask("city")[0]["views"][0]
    while not done.is_set():
        number = page.view(view, 960, 540)
        page.until(lambda h: h.get("id") == number and (h["type"] == "failed" or h["last"]), 300)
    page.close()


def share(name, server, trainer, viewer):
    """Training's part of what both spend, while three clients look."""
    done = threading.Event()
    clients = [threading.Thread(target=look, args=(server, done)) for _ in range(3)]
    for client in clients:
        client.start()
    time.sleep(5)  # photos are loaded, and the first pictures are there
    before = spent_s(trainer), spent_s(viewer)
    time.sleep(seconds)
    training, viewing = spent_s(trainer) - before[0], spent_s(viewer) - before[1]
    print(f"{name}: training has {training / (training + viewing):.2f} of what both spend "
          f"({training:.1f} and {viewing:.1f} s of processors in {seconds:.0f} s)", flush=True)
    done.set()
    for client in clients:
        client.join()


with tempfile.TemporaryDirectory() as folder:
    copy = os.path.join(folder, "city")
    shutil.copytree(city, copy)
    train = [conurb, "train", copy, "--quality", "reference"]

    def begin_anew():
        shutil.rmtree(os.path.join(copy, "tiles"))
        os.mkdir(os.path.join(copy, "tiles"))

    begin_anew()
    server = Server(conurb, city)
    training = subprocess.Popen(train, stderr=subprocess.DEVNULL)
    share("conurb view, then conurb train", server, training.pid, server.process.pid)
    training.terminate()
    training.wait()
    server.stop()

    shutil.rmtree(os.path.join(copy, "tiles"))
    shutil.copytree(os.path.join(city, "tiles"), os.path.join(copy, "tiles"))
    server = Server(conurb, copy, command=[*train, "--view"])
    page_of = child_of(server.process.pid)
    share("conurb train --view", server, server.process.pid, page_of)
    server.stop()
