#!/usr/bin/env bash
# The EXR of a flight through ocioconvert and the project's config is the PNG that Conurb wrote, to one code value of
# 8 bits.
# colour.sh CONURB MAKE_PHOTOS PICTURES CONFIG
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
pictures=$3
config=$4
if ! command -v ocioconvert >/dev/null; then
    echo "skipped: no ocioconvert here (package opencolorio-tools)"
    exit 77
fi

# compare FOLDER VIEW: every frame.
compare() {
    local exr frames=0 off worst=0
    for exr in "$1"/*.exr; do
        "$pictures" colour "$exr" "$work/in.exr" &&
            OCIO=$config ocioconvert --view "$work/in.exr" ACEScg "$work/out.png" sRGB "$2" >"$work/out" 2>&1 &&
            off=$("$pictures" differ "$work/out.png" "${exr%.exr}.png") || off=255
        [ "$off" -gt "$worst" ] && worst=$off
        frames=$((frames + 1))
    done
    echo "$2: $frames frames, at most $worst of 255 apart"
    [ "$frames" -ge 3 ] && [ "$worst" -le 1 ] && good || bad "$2: ocioconvert and Conurb differ by $worst"
}

unset OCIO
city town 9
echo "  unseen: black" >>"$work/town/city.yaml" # an EXR is not filled, so compare with a PNG that is not
expect 0 "" "poses" "$conurb" poses "$work/town"
expect 0 "" "plan" "$conurb" plan "$work/town" --no-forecast
expect 0 "" "train" "$conurb" train "$work/town"
sed -i 's/^  # transient: auto/  transient: on/' "$work/town/city.yaml"
expect 0 "the plan is older than city.yaml (effects.transient is on, was auto)" "a change after the plan" \
    "$conurb" train "$work/town"
sed -i 's/^  transient: on/  # transient: auto/' "$work/town/city.yaml"
for view in sRGB ACES; do
    expect 0 "3 frames" "a flight for $view" "$conurb" render "$work/town" --view "$view" --out "$work/$view"
    compare "$work/$view" "$view"
done
# The comparison can fail: frames of the two views differ.
cp "$work"/ACES/*.png "$work/sRGB"
"$pictures" colour "$work/sRGB/00001.exr" "$work/in.exr"
OCIO=$config ocioconvert --view "$work/in.exr" ACEScg "$work/out.png" sRGB sRGB >"$work/out" 2>&1
[ "$("$pictures" differ "$work/out.png" "$work/sRGB/00001.png")" -gt 1 ] && good ||
    bad "another view's frames pass for the same"
# With another OpenColorIO config the frames are rendered again; with the same one they are kept.
cp "$config" "$work/mine.ocio"
export OCIO=$work/mine.ocio
expect 0 "" "a flight by a config of one's own" "$conurb" render "$work/town" --view sRGB --out "$work/own"
before=$(stat -c %Y.%i "$work/own/00001.png")
expect 0 "" "the same config" "$conurb" render "$work/town" --view sRGB --out "$work/own"
[ "$(stat -c %Y.%i "$work/own/00001.png")" = "$before" ] && good || bad "frames of the same config were made anew"
echo "# changed" >>"$work/mine.ocio"
expect 0 "" "a changed config" "$conurb" render "$work/town" --view sRGB --out "$work/own"
[ "$(stat -c %Y.%i "$work/own/00001.png")" != "$before" ] && good ||
    bad "frames of another OpenColorIO config were kept"
# Scores are by Conurb's own config. The user's lacks the view sRGB, or its sRGB is another encoding.
unset OCIO
figures() { # of a command: without the time that it took
    "$conurb" "$@" --json 2>"$work/out" | sed 's/"render_s": [0-9.]*//'
}
eval_figures=$(figures eval "$work/town")
steady_figures=$(figures steady "$work/town")
sed 's/{name: sRGB, view_transform/{name: Film, view_transform/; s/^active_views: .*/active_views: [Film, ACES, Raw]/' \
    "$config" >"$work/film.ocio"
sed 's/{name: sRGB, view_transform: Plain/{name: sRGB, view_transform: ACES SDR/' "$config" >"$work/aces.ocio"
for theirs in film aces; do
    export OCIO=$work/$theirs.ocio
    [ -n "$eval_figures" ] && [ "$(figures eval "$work/town")" = "$eval_figures" ] && good ||
        bad "scores depend on OCIO ($theirs)"
    [ -n "$steady_figures" ] && [ "$(figures steady "$work/town")" = "$steady_figures" ] && good ||
        bad "the figures of steady depend on OCIO ($theirs)"
done
finish
