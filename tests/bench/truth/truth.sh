#!/usr/bin/env bash
# A synthetic city, whose truth is known: what do people, cars, weather and exposure cost; is a light right where it was
# never photographed; is the depth; are poses mended?
# usage: tests/bench/truth/truth.sh CONURB SYNTH COMPARE [STEPS [PHOTOS]]    needs oiiotool (openimageio-tools), python3
# TRUTH_WORK names a folder that is kept, and gone on with; TRUTH_PARTS which parts to do (effects light poses). Prints,
# with true poses but for the last:
#   effects: held-out PSNR (half-photo protocol), trained on photos with people, cars, four lights and exposures, all
#     effects on, beside training on photos of the same views without any of these, in one light; both are scored on
#     the same pictures, clean ones in that light (four in ten of the wild photos are of it); bar: 1.5 dB apart at most
#   light: PSNR of held-out views in the light of a run that did not take them, against the truth; bar: 23 dB; and the
#     median error of depth there, relative; bar: 0.7 %
#   poses: mean error of poses, 0.5 degrees and 15 cm off, before and after training with refinement; bar: half
set -euo pipefail
conurb=$1 synth=$2 compare=$3 steps=${4:-8000} photos=${5:-256} parts=${TRUTH_PARTS:-effects light poses} width=320 \
    height=214
command -v oiiotool >/dev/null || { echo "skipped: no oiiotool here (package openimageio-tools)"; exit 77; }
if [ -n "${TRUTH_WORK:-}" ]; then
    work=$TRUTH_WORK
    mkdir -p "$work"
else
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
fi

trap 'tail -n 3 "$work/log" >&2' ERR
set -E

make() {
    [ -e "$work/$1/truth/truth.json" ] && return
    "$synth" "$work/$1" --seed 3 --photos "$photos" --size 60 --width $width --height $height --gps-noise 0 "${@:2}" \
        2>>"$work/log"
}
make wild
make plain --plain
# Every 8th photo is held out: never trained on, and scored as it is without people and cars, in the one light.
held=$(ls "$work/wild/photos" | awk 'NR % 8 == 1')
mkdir -p "$work/photos-wild" "$work/photos-plain"
cp -n "$work"/plain/photos/* "$work/photos-plain"
for name in $held; do cp -n "$work/plain/photos/$name" "$work/photos-wild"; done
cp -n "$work"/wild/photos/* "$work/photos-wild"

train() { # NAME PHOTOS MODEL EFFECTS
    local city=$work/city-$1
    if [ ! -e "$city/plan/plan.json" ]; then
        rm -rf "$city"
        "$conurb" init "$city" --photos "$work/photos-$2" --import "$3" --width $width 2>>"$work/log"
        sed -i "s/^train:/train:\n  steps: $steps/; s/^field:.*/field:\n  log2_table: 19/; 
            s/^plan:/plan:\n  spacing_m: 300/; s/^effects:.*/effects:\n$4/" \
            "$city/city.yaml"
    fi
    for stage in poses "plan --no-forecast" train; do "$conurb" $stage "$city" 2>>"$work/log"; done
}
half() {
    "$conurb" eval "$work/city-$1" --json 2>>"$work/log" |
        python3 -c "import json, sys; print('%.2f' % json.load(sys.stdin)['half']['psnr'])"
}
median() { sort -g | awk '{ x[NR] = $1 } END { print (x[int((NR + 1) / 2)] + x[int(NR / 2) + 1]) / 2 }'; }
mean() { awk '{ s += $1 } END { printf "%.2f\n", s / NR }'; }

scene='  view_dependence: on\n  sky: on'
all="$scene\n  appearance: on\n  exposure: on\n  transient: on\n  pose_refinement: off"
none="$scene\n  appearance: off\n  exposure: off\n  transient: off\n  pose_refinement: off"

effects() {
    train plain plain "$work/wild/truth/model" "$none"
    train wild wild "$work/wild/truth/model" "$all"
    plain=$(half plain) wild=$(half wild)
    awk -v a="$plain" -v b="$wild" \
        'BEGIN { printf "effects: held-out PSNR plain %s dB, wild %s dB: %.2f dB apart (bar 1.5)\n", a, b, a - b }'
}

# Of the photos of a run, of the street or from the air, that were trained on: the one taken nearest to a view.
nearest() { # VIEW RUN_KIND
    python3 - "$work/wild/truth/truth.json" "$@" $held <<'END'
import json, math, sys

truth, view, run, *held = sys.argv[1:]
photos = json.load(open(truth))["photos"]
at = next(p["centre_m"] for p in photos if p["name"] == view)
of_run = [p for p in photos if p["name"] not in held and p["name"].startswith(run)]
print(min(of_run, key=lambda p: math.dist(p["centre_m"], at))["name"])
END
}

# The light of the next run, as the photo of it shows that stands nearest: a light is a photo's, and a photo knows best
# how it falls about the place where it was taken.
light() {
    train wild wild "$work/wild/truth/model" "$all"
    runs=$(ls "$work/wild/photos" | sed 's/_.*//' | uniq)
    for view in $held; do
        kind=$(echo "$view" | sed 's/^[^_]*_\([a-z]*\)_.*/\1/') run=${view%%_*}
        next=$(printf '%s\n' $runs $runs | awk -v run="$run" \
            'last == run { after = $1 } { last = $1 } END { print after }')
        photo=$(nearest "$view" "${next}_${kind}_")
        "$synth" "$work/wild" --render "${view%.jpg}" --light "$next" --out "$work/relit.exr" 2>>"$work/log"
        out=$work/relit-$view
        "$conurb" render "$work/city-wild" --photo "$view" --appearance "$photo" --width $width \
            --out "$out" 2>>"$work/log"
        psnr=$("$compare" relit "$work/wild/truth/truth.json" "$photo" "$work/relit.exr" "$out/00000.png")
        depth=$("$compare" depth "$work/wild/truth/views/${view%.jpg}.exr" "$out/00000.exr")
        echo "$psnr $depth $view as $photo"
    done | tee "$work/views"
    echo "relighting: mean $(mean <"$work/views") dB (bar 23)"
    echo "depth: median of the views' median relative errors $(cut -d ' ' -f 2 "$work/views" | median) (bar 0.007)"
}

poses() {
    [ -e "$work/planted" ] || "$compare" plant "$work/wild/truth/model" "$work/planted" 0.5 0.15
    train planted plain "$work/planted" "${none%off}on"
    tile=$(echo "$work"/city-planted/tiles/*/tile.safetensors)
    echo "poses: $("$compare" poses "$work/wild/truth/model" "$work/city-planted/poses/model" "$tile") (bar: half)"
}

for part in $parts; do $part; done
