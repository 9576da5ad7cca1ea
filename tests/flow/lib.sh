# Shared by the flow tests: conurb=..., photos=..., a temporary folder in $work, and checks that count.
set -uo pipefail
conurb=$1
photos=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
passed=0
failed=0
export CONURB_DEVICE=${CONURB_DEVICE:-cpu} # also where there is a graphics processor
slow=${CONURB_SLOW:-1} # how many times slower than a plain build the program is
sanitized() { [ "$slow" != 1 ]; }
# Sanitized, a field is trained for a few steps, and how well it learns is not measured: sanitizers do not change that.
steps_of() { if sanitized; then echo 40; else echo "$1"; fi; }

good() { passed=$((passed + 1)); }
bad() {
    failed=$((failed + 1))
    echo "FAILED: $*"
    sed 's/^/    /' "$work/out" | tail -n 12
}

# expect CODE TEXT NAME COMMAND...: checks the exit code, and that the output contains TEXT.
expect() {
    local code=$1 text=$2 name=$3 got=0
    shift 3
    "$@" >"$work/out" 2>&1 || got=$?
    if [ "$got" != "$code" ]; then
        bad "$name: exit code $got, not $code"
    elif ! grep -qF -- "$text" "$work/out"; then
        bad "$name: the answer lacks '$text'"
    elif [ "$code" != 0 ] && [ "$(grep -c '^conurb: ' "$work/out")" != 1 ]; then
        bad "$name: an error is one line that begins with 'conurb: '"
    else
        good
    fi
}

# city NAME N [GPS]: photos, and a city that imports their transforms.json and trains in a moment.
city() {
    mkdir -p "$work/$1-photos"
    "$photos" "$work/$1-photos" "$2" "${3:-none}"
    "$conurb" init "$work/$1" --photos "$work/$1-photos" --import "$work/$1-photos/transforms.json" \
        --width 48 2>/dev/null
    cat >>"$work/$1/city.yaml" <<'YAML'
  width_px: 48
  frames: 3
YAML
    sed -i 's/^train:/train:\n  steps: 40\n  samples_per_step: 8192/; 
        s/^field:.*/field:\n  log2_table: 12\n  levels: 6\n  finest_resolution: 128/' "$work/$1/city.yaml"
}

# three_tiles NAME: a city of three tiles that train in a moment and write checkpoints all the time. No photo is held
# out.
three_tiles() {
    city "$1" 9 all
    sed -i 's/^plan:/plan:\n  hold_out_every: 0\n  min_photos: 3\n  layout: centres\n  centres: centres.geojson/' \
        "$work/$1/city.yaml"
    sed -i 's/^train:/train:\n  checkpoint_every_s: 0.05/; s/steps: 40/steps: 24/' "$work/$1/city.yaml"
    python3 - "$work/$1/centres.geojson" <<'PY'
import json, sys
places = [(8.53998, 47.369987), (8.54002, 47.369987), (8.54, 47.370013)]
json.dump({"type": "FeatureCollection", "features": [
    {"type": "Feature", "properties": {}, "geometry": {"type": "Point",
                                                       "coordinates": p}} for p in places]}, open(sys.argv[1], "w"))
PY
}

digest() { (cd "$1" && find . -type f -print0 | sort -z | xargs -0 sha256sum) | sha256sum; }

finish() {
    echo "$passed passed, $failed failed"
    [ "$failed" = 0 ]
}
