#!/usr/bin/env bash
# Photos as phones make them: HEIC, with the same EXIF and the same pixels as JPEG.
# types.sh CONURB MAKE_PHOTOS
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
for tool in heif-enc oiiotool; do
    command -v "$tool" >/dev/null && continue
    echo "skipped: $tool is not installed (apt-get install libheif-examples openimageio-tools)"
    exit 77
done

# heif-enc writes pictures below 64 pixels in a way that phones do not, so photos are enlarged.
city jpeg 8 all
city heic 8 all
for photo in "$work"/{jpeg,heic}-photos/*.jpg; do
    oiiotool "$photo" --resize 192x144 -o "$photo" >/dev/null 2>&1 || bad "oiiotool fails on $photo"
done
for photo in "$work"/heic-photos/*.jpg; do
    heif-enc -q 95 "$photo" -o "${photo%.jpg}.HEIC" >/dev/null 2>&1 || bad "heif-enc fails on $photo"
    rm "$photo"
done
sed -i 's/\.jpg/.HEIC/' "$work/heic-photos/transforms.json"
for town in jpeg heic; do
    expect 0 "eval" "a run with $town" "$conurb" run "$work/$town" --threads 2
done
python3 - "$work" >"$work/out" 2>&1 <<'PY' && good || bad "HEIC and JPEG differ"
import json, sys
def read(name): return json.load(open(f"{sys.argv[1]}/{name}"))
a, b = (read(f"{town}/photos.json")["photos"] for town in ("jpeg", "heic"))
assert len(a) == len(b) == 8, (len(a), len(b))
for x, y in zip(a, b):
    assert y["name"].endswith(".HEIC"), y
    for key in x.keys() - {"name", "hash"}: assert x[key] == y[key], (key, x, y)
    assert "latitude_deg" in y and y["exposure_s"] > 0, y
psnr = [read(f"{town}/eval/eval.json")["psnr"] for town in ("jpeg", "heic")]
assert abs(psnr[0] - psnr[1]) < 0.5, psnr
print("held-out PSNR", psnr)
PY
cat "$work/out"
finish
