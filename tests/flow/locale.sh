#!/usr/bin/env bash
# A program that sets a locale with decimal commas uses the library: files, keys and answers are as without it.
# locale.sh CONURB MAKE_PHOTOS COMMA
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
comma=$3
export LOCPATH=$work/locales
# With LOCPATH set, glibc's setlocale never frees a list. This is not a leak of the library.
export ASAN_OPTIONS=${ASAN_OPTIONS:+$ASAN_OPTIONS:}detect_leaks=0
mkdir "$LOCPATH"
if ! localedef -i de_DE -f UTF-8 "$LOCPATH/de_DE.UTF-8" >"$work/out" 2>&1 && [ ! -d "$LOCPATH/de_DE.UTF-8" ]; then
    echo "skipped: localedef cannot make de_DE.UTF-8 here: $(tail -n 1 "$work/out")"
    exit 77
fi
german() { LC_ALL=de_DE.UTF-8 "$comma" "$@"; }
if [ "$(LC_ALL=de_DE.UTF-8 "$BASH" -c 'printf "%.1f" 0,5' 2>/dev/null)" != 0,5 ]; then
    echo "skipped: de_DE.UTF-8 has no decimal comma here"
    exit 77
fi

city town 9 all
sed -i 's/^plan:/plan:\n  overlap: 0.25/; s/^train:/train:\n  learning_rate: 0.0125/' "$work/town/city.yaml"
cp -r "$work/town" "$work/fresh"
expect 0 "flight" "a run without the locale" "$conurb" run "$work/town"
before=$(digest "$work/town")
expect 0 "is done" "the same run with decimal commas" german run "$work/town"
[ "$before" = "$(digest "$work/town")" ] && good || bad "under another locale something was made again"

# Start again at the same path, because files contain it.
mv "$work/town" "$work/dots"
mv "$work/fresh" "$work/town"
expect 0 "flight" "a run with decimal commas" german run "$work/town"
for file in photos.json frame.json plan/plan.json plan/tiles.geojson plan/plan.svg renders/flight/00000.exr; do
    cmp -s "$work/town/$file" "$work/dots/$file" && good || bad "$file is another under a locale with commas"
done
grep -q '"seconds":[0-9]*\.[0-9]' "$work"/town/tiles/*/log.jsonl && good || bad "log.jsonl has no dots"

# Numbers in the input: an orbit, a track, a mix of two lights.
cat >"$work/track.kml" <<'KML'
<?xml version="1.0"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Placemark><gx:Track>
<altitudeMode>absolute</altitudeMode>
<when>2020-01-01T00:00:00.25Z</when><when>2020-01-01T00:00:01.5Z</when>
<gx:coord>8.54005 47.37 452.5</gx:coord><gx:coord>8.54 47.37004 452.5</gx:coord>
</gx:Track></Placemark></kml>
KML
dots() { "$conurb" "$@"; }
for run in dots german; do
    expect 0 "3 frames" "$run: an orbit" $run render "$work/town" --orbit 47.37,8.54,4.5,2.5 --out "$work/orbit-$run" \
        --frames 3
    expect 0 "2 frames" "$run: a track" $run render "$work/town" --path "$work/track.kml" --out "$work/track-$run" \
        --frames 2
    expect 0 "1 frames" "$run: a mix" $run render "$work/town" --photo 003.jpg --appearance 003.jpg:002.jpg:0.25 \
        --out "$work/mix-$run"
done
finish
