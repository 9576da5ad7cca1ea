#!/usr/bin/env bash
# Known gains and known occluders on the fox photos: are the gains recovered, and does training keep the clean photos'
# PSNR?
# usage: tests/bench/wild/wild.sh CONURB MAKE_WILD [STEPS]        needs python3 and CONURB_DATA/fox
# Prints the held-out PSNR of: the clean photos with exposure on; the wild ones with exposure and transient on (bar:
# within 0.3 dB of the clean ones, by the half-photo protocol: which gain stands for a held-out photo is not known
# otherwise); the wild ones with both off. Then the error of the gains in stops (bar: 0.1): a telephone sets its own
# exposure, so what was put in is held against the difference of the gains that were found with and without it.
set -euo pipefail
conurb=$1 disturb_photo=$2 steps=${3:-6000}
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../../.." && pwd)
fox=${CONURB_DATA:-$root/../shared/data}/fox
[ -f "$fox/transforms.json" ] || { echo "skipped: no fox photos under CONURB_DATA"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

python3 - "$fox" "$work" "$disturb_photo" <<'PY'
import json, os, random, shutil, subprocess, sys
fox, work, disturb_photo = sys.argv[1:]
root = json.load(open(fox + "/transforms.json"))
frames = sorted((f for f in root["frames"] if os.path.exists(os.path.join(fox, f["file_path"]))),
                key=lambda f: f["file_path"])
rng = random.Random(7)
os.makedirs(work + "/photos-clean"); os.makedirs(work + "/photos-wild")
held = [i % 8 == 0 for i in range(len(frames))]
ev = [0 if held[i] else rng.uniform(-1, 0.6) for i in range(len(frames))]
mean = sum(ev) / held.count(False)
gains = {}
for i, f in enumerate(frames):
    name = os.path.basename(f["file_path"])
    source = os.path.join(fox, f["file_path"])
    shutil.copy(source, f"{work}/photos-clean/{name}")
    if held[i]:
        shutil.copy(source, f"{work}/photos-wild/{name}")
        continue
    gains[name] = ev[i] - mean
    subprocess.run([disturb_photo, source, f"{work}/photos-wild/{name}", str(gains[name]), str(i),
                    "2" if i % 2 else "0"], check=True)
for kind in ("clean", "wild"):
    made = dict(root, frames=[dict(f, file_path=os.path.basename(f["file_path"])) for f in frames])
    json.dump(made, open(f"{work}/photos-{kind}/transforms.json", "w"))
json.dump(gains, open(work + "/gains.json", "w"))
PY

train() { # NAME PHOTOS EFFECTS
    local city=$work/$1
    "$conurb" init "$city" --photos "$work/photos-$2" --import "$work/photos-$2/transforms.json" --width 270 2>/dev/null
    sed -i "s/^train:/train:\n  steps: $steps/; s/^effects:.*/effects:\n$3/" "$city/city.yaml"
    for stage in poses "plan --no-forecast" train; do "$conurb" $stage "$city" 2>/dev/null; done
    "$conurb" eval "$city" --json 2>/dev/null |
        python3 -c "import json, sys; e = json.load(sys.stdin)
print('$1: held-out PSNR %.2f dB, half-photo protocol %.2f dB' % (e['psnr'], e['half']['psnr']))"
}
on='  exposure: on\n  transient: on'
gains='  exposure: on\n  transient: off'
off='  exposure: off\n  transient: off'
train clean clean "$gains"
train wild wild "$on"
train wild_off wild "$off"

python3 - "$conurb" "$work" <<'PY'
import json, subprocess, sys
conurb, work = sys.argv[1:]
def found(city, name):
    text = subprocess.run([conurb, "appearance", f"{work}/{city}", "show", name], check=True, stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL).stdout
    ev, unknown, learned = next(iter(json.loads(text)["tiles"].values()))["exposure"]
    return ev + unknown * learned
known = json.load(open(work + "/gains.json"))
errors = [found("wild", name) - found("clean", name) - gain for name, gain in known.items()]
print("gains: rms error %.3f stops, largest %.3f" % ((sum(e * e for e in errors) / len(errors)) ** 0.5,
                                                     max(map(abs, errors))))
PY
