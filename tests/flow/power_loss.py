#!/usr/bin/env python3
"""What a power loss leaves of a folder, from the notes that synced.c took.

power_loss.py begin STORE ROOT         notes that all of ROOT is on the disk
power_loss.py cut STORE ROOT SEED      makes ROOT what it may be after the power was cut: with SEED 0 only what
                                       was synced; with others each unsynced file content and folder listing
                                       survives by the toss of a coin
"""
import os, random, shutil, sys


def birth(path):
    # os.stat has no time of birth; stat(1) prints it to the nanosecond.
    text = os.popen("stat -c '%i %.9W' '" + path + "'").read().split()
    return text[0] + "-" + text[1]


def entries(folder):
    for name in sorted(os.listdir(folder)):
        path = os.path.join(folder, name)
        yield (birth(path) if os.path.isdir(path) else str(os.stat(path).st_ino)), name, path


def begin(store, root):
    for kind in ("data", "names", "pin"):
        os.makedirs(os.path.join(store, kind))
    for folder, _, files in os.walk(root):
        with open(os.path.join(store, "names", birth(folder)), "w") as out:
            for key, name, _ in entries(folder):
                out.write(f"{key} {name}\n")
        for name in files:
            path = os.path.join(folder, name)
            inode = str(os.stat(path).st_ino)
            shutil.copyfile(path, os.path.join(store, "data", inode))
            os.link(path, os.path.join(store, "pin", inode))


def cut(store, root, seed):
    toss = random.Random(seed)
    now = {}  # what the folders hold before the power goes

    def look(folder):
        now[birth(folder)] = [(key, name) for key, name, _ in entries(folder)]
        for key, _, path in entries(folder):
            if os.path.isdir(path):
                look(path)
            elif not os.path.exists(os.path.join(store, "pin", key)):
                os.link(path, os.path.join(store, "pin", key))

    look(root)
    lost = 0

    def rebuild(key, out):
        nonlocal lost
        os.makedirs(out)
        noted = os.path.join(store, "names", key)
        synced = [tuple(line.rstrip("\n").split(" ", 1)) for line in open(noted)] if os.path.exists(noted) else []
        names = synced
        if key in now and sorted(now[key]) != sorted(synced):
            if seed and toss.random() < 0.5:
                names = now[key]
            else:
                lost += 1
        for child, name in names:
            path = os.path.join(out, name)
            if "-" in child:
                rebuild(child, path)
                continue
            data, pin = os.path.join(store, "data", child), os.path.join(store, "pin", child)
            synced_data = open(data, "rb").read() if os.path.exists(data) else b""
            current = open(pin, "rb").read() if os.path.exists(pin) else synced_data
            if current != synced_data and not (seed and toss.random() < 0.5):
                lost += 1
                current = synced_data
            with open(path, "wb") as stream:
                stream.write(current)

    rebuild(birth(root), root + ".after")
    shutil.rmtree(root)
    os.rename(root + ".after", root)
    print(lost)


if __name__ == "__main__":
    if sys.argv[1] == "begin":
        begin(sys.argv[2], sys.argv[3])
    else:
        cut(sys.argv[2], sys.argv[3], int(sys.argv[4]))
