#!/usr/bin/env bash
# The whole job on a small synthetic set: all files exist at the end, a rerun does nothing, and after a change only what
# depends on it is made again.
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"

city town 17 all
expect 0 "flight" "run" "$conurb" run "$work/town"
for file in photos.json frame.json pixels.bin plan/plan.json plan/tiles.geojson plan/plan.svg eval/eval.json \
    renders/flight/00000.png renders/flight/00002.exr renders/flight/flight.mp4; do
    [ -s "$work/town/$file" ] && good || bad "$file is missing"
done
before=$(digest "$work/town")
expect 0 "is done" "run again" "$conurb" run "$work/town"
[ "$before" = "$(digest "$work/town")" ] && good || bad "a second run changed something"
expect 0 "is done" "the plan alone" "$conurb" plan "$work/town" --no-forecast
grep -q "training on this machine" "$work/out" && bad "plan --no-forecast tells what training takes" || good
# Temporary files of a run that was killed while it wrote a frame or the film.
rm "$work"/town/renders/flight/{00001.png,flight.mp4}
touch "$work"/town/renders/flight/.{00001.tmp-4194303.exr,flight.tmp-4194303.mp4,flight.mp4.tmp-4194303.json}
expect 0 "flight" "run after a kill" "$conurb" run "$work/town"
[ -z "$(find "$work/town/renders" -name '.*tmp-*')" ] && good || bad "temporary files are left"
[ "$before" = "$(digest "$work/town")" ] && good || bad "the frame made again is another"
expect 0 '"psnr"' "eval as JSON" "$conurb" eval "$work/town" --json
expect 0 '"tile": "' "eval as JSON names each photo's tile" "$conurb" eval "$work/town" --json
expect 0 "1 frames" "a photo's own view" "$conurb" render "$work/town" --photo 003.jpg --appearance 003.jpg
expect 2 "no photo is named" "an appearance that is not there" "$conurb" render "$work/town" --appearance nobody.jpg
expect 3 "view" "a view that is not in the config" "$conurb" render "$work/town" --view Technicolor --out "$work/t"
cat >"$work/path.json" <<'JSON'
{"fps": 2, "keyframes": [
  {"time_s": 0, "lat": 47.37, "lon": 8.54005, "height_m": 452, "look_at": {"lat": 47.37, "lon": 8.54, "height_m": 450},
   "vfov_deg": 45},
  {"time_s": 1, "lat": 47.37004, "lon": 8.54, "height_m": 452, "look_at": {"lat": 47.37, "lon": 8.54, "height_m": 450},
   "vfov_deg": 45}]}
JSON
expect 0 "frames in" "a path of keyframes" "$conurb" render "$work/town" --path "$work/path.json" --out "$work/path"
[ -s "$work/path/flight.mp4" ] && good || bad "a path's film is missing"
# At another frame rate the same pictures say so.
if command -v oiiotool >/dev/null; then
    for fps in 2 4; do
        sed -i "s/\"fps\": [0-9]*/\"fps\": $fps/" "$work/path.json"
        expect 0 "3 frames" "$fps frames a second" "$conurb" render "$work/town" --path "$work/path.json" --frames 3 \
            --out "$work/rate"
        oiiotool --info -v "$work/rate/00001.exr" | grep -q "frames_per_second: $fps" && good ||
            bad "an EXR does not say $fps frames a second"
    done
fi
# A shorter flight in the folder of a longer one leaves none of its frames, and nothing that is not Conurb's goes.
sequence() { "$conurb" render "$work/town" --path "$work/path.json" --out "$work/shorter" "$@"; }
expect 0 "6 frames" "a long flight" sequence --frames 6 --aov normal
echo '{"note": "of a person"}' >"$work/shorter/00007.json"
cp "$work/shorter/00005.exr" "$work/shorter/00007.exr"
cp "$work/shorter/00005.exr" "$work/shorter/00008.exr"
expect 0 "3 frames" "a shorter flight" sequence --frames 3
[ "$(cd "$work/shorter" && ls | tr '\n' ' ')" = "00000.exr 00000.json 00000.png 00001.exr 00001.json \
00001.png 00002.exr 00002.json 00002.png 00007.exr 00007.json 00008.exr flight.mp4 flight.mp4.json " ] && good ||
    bad "a shorter flight leaves $(ls "$work/shorter" | tr '\n' ' ')"
expect 0 "1 frames" "a single frame" sequence --frames 1
[ -e "$work/shorter/00000.png" ] && [ ! -e "$work/shorter/00001.png" ] && [ ! -e "$work/shorter/flight.mp4" ] &&
    [ ! -e "$work/shorter/flight.mp4.json" ] && [ -e "$work/shorter/00007.exr" ] && good ||
    bad "a single frame leaves $(ls "$work/shorter" | tr '\n' ' ')"
echo '{"fps": 2, "keyframes": [{"time_s": 0, "lat": 95}]}' >"$work/bad.json"
expect 5 "bad.json" "a path that makes no sense" "$conurb" render "$work/town" --path "$work/bad.json"
# Without held-out photos there is no score, and no number is printed.
cp -r "$work/town" "$work/all"
sed -i 's/^plan:/plan:\n  hold_out_every: 0/' "$work/all/city.yaml"
expect 0 "" "a plan that holds nothing out" "$conurb" plan "$work/all" --no-forecast
expect 0 "" "training on all photos" "$conurb" train "$work/all"
expect 0 "There is no score" "eval without held-out photos" "$conurb" eval "$work/all"
grep -q " dB" "$work/out" && bad "eval without held-out photos prints a score" || good
expect 0 '"psnr": null' "the same as JSON" "$conurb" eval "$work/all" --json
[ ! -e "$work/all/eval/eval.json" ] && [ -z "$(find "$work/all/eval" -name '*.png')" ] && good ||
    bad "eval without held-out photos leaves the scores or pictures of an earlier one"
for command in init poses plan train eval render run; do
    expect 0 "example:" "$command --help" "$conurb" "$command" --help
done
finish
