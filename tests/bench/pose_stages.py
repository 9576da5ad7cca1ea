"""Seconds of each stage from photos to poses, side by side on one machine: with COLMAP's matcher and mapper, with
Conurb's matcher, and with Conurb's global mapper too.
pose_stages.py OLD NEW OUT SET...     SET: a folder of CONURB_DATA, such as castle
OLD is the conurb that runs COLMAP's matcher, NEW the one that runs the others; they may be the same.
Writes OUT/SET-WAY.json, which are not measured again. Seconds are by the clock; processor time is of all stages.
"rest" has the features and maps of further attempts, the alignment, and the adjustment."""
import glob
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import time

DATA = os.environ.get("CONURB_DATA", os.path.join(os.path.dirname(__file__), "..", "..", "..", "shared", "data"))
STAGES = ("features", "matches", "mapping")
# Settings of city.yaml; one that OLD does not know is not in its city.yaml, and stays out.
WAYS = {"colmap": {"match_with": "colmap", "mapper": "incremental"}, "matcher": {"mapper": "incremental"}, "global": {}}


def quietly(*command):
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def measure(conurb, out, name, way):
    city, photos = os.path.join(out, f"{name}-{way}"), os.path.join(DATA, name, "photos")
    shutil.rmtree(city, ignore_errors=True)
    quietly(conurb, "init", city, "--photos", photos)
    path = os.path.join(city, "city.yaml")
    with open(path, encoding="utf-8") as file:
        text = file.read()
    for key, value in WAYS[way].items():
        text = re.sub(f"(?m)^  # {key}: .*$", f"  {key}: {value}", text)
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
    quietly(conurb, "poses", city)
    ended, after = time.time(), resource.getrusage(resource.RUSAGE_CHILDREN)
    # Each stage leaves a file when it is done.
    at = began
    result = {"set": name, "way": way}
    for stage in STAGES:
        done = min(os.path.getmtime(path) for path in glob.glob(os.path.join(city, "poses", f"{stage}*.done.json")))
        result[f"{stage}_s"], at = done - at, done
    result.update(rest_s=ended - at, total_s=ended - began,
                  cpu_s=after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    with open(os.path.join(city, "poses", "report.json"), encoding="utf-8") as file:
        report = json.load(file)
    result["posed"] = report["registered"]
    result["photos"] = report["registered"] + len(report["unregistered"])
    return result


def main():
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    old, new, out = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2]), sys.argv[3]
    os.makedirs(out, exist_ok=True)
    print("set          way       features  matches  mapping     rest    total  processors  posed")
    for name in sys.argv[4:]:
        for way in WAYS:
            path = os.path.join(out, f"{name}-{way}.json")
            if not os.path.exists(path):
                result = measure(old if way == "colmap" else new, out, name, way)
                with open(path, "w", encoding="utf-8") as file:
                    json.dump(result, file)
            with open(path, encoding="utf-8") as file:
                r = json.load(file)
            columns = [f"{stage}_s" for stage in (*STAGES, "rest", "total")]
            seconds = "".join(f"{r[column]:9.0f}" for column in columns)
            print(f"{r['set']:12} {r['way']:8}{seconds}{r['cpu_s']:12.0f}  {r['posed']} of {r['photos']}",
                  flush=True)


main()
