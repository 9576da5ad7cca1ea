#!/usr/bin/env bash
# tiles/demo has tiles of an earlier version. This program must open, render and relight them without their photos.
# demo.sh CONURB MAKE_PHOTOS PICTURES DEMO
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
pictures=$3
demo=$4
cp -r "$demo" "$work/demo"
day=run0-clear_street_0006.jpg night=run3-night_street_0010.jpg view=run0-clear_air_0003.jpg

[ "$(ls "$work"/demo/tiles/*/tile.safetensors | wc -l)" -ge 3 ] && good || bad "fewer than three tiles"
[ "$(du -sk "$demo" | cut -f 1)" -lt 8192 ] && good || bad "the folder is 8 MB or more"
grep -rlaE '/(tmp|home|root|work)/' "$demo" >"$work/out" && bad "a file names a place of the machine that made it" ||
    good
# The reference pictures are older than the filling of empty places.
sed -i 's/^render:/render:\n  unseen: black/' "$work/demo/city.yaml"
expect 0 "2 frames" "a flight" "$conurb" render "$work/demo" --frames 2 --width 96 --out "$work/flight"
expect 0 "1 frames" "a view" "$conurb" render "$work/demo" --photo "$view" --appearance "$day" --out "$work/day"
expect 0 "1 frames" "channels" "$conurb" render "$work/demo" --photo "$view" --width 64 --aov normal,coverage \
    --out "$work/channels"
for name in normal.X normal.Y normal.Z coverage.Y; do
    oiiotool --info -v "$work/channels/00000.exr" | grep -qF "$name" && good || bad "the EXR lacks $name"
done
[ -s "$work/channels/00000.normal.png" ] && [ ! -e "$work/channels/00000.depth.png" ] && good || bad "PNGs of channels"
expect 2 "'colour' is no channel" "an unknown channel" "$conurb" render "$work/demo" --aov depth,colour
expect 0 "2 frames" "relighting" "$conurb" relight "$work/demo" --photo "$view" --from "$day" --to "$night" --frames 2 \
    --out "$work/relit"
[ -s "$work/relit/flight.mp4" ] && good || bad "relighting leaves no film"
# The first frame is the view by day, the last one is not.
[ "$("$pictures" differ "$work/relit/00000.png" "$work/day/00000.png")" = 0 ] && good ||
    bad "relighting does not begin by day"
[ "$("$pictures" differ "$work/relit/00001.png" "$work/day/00000.png")" -gt 64 ] && good || bad "night looks like day"
# A light with a name is listed, and serves where a photo does.
expect 0 "wrote $work/noon.json" "a light in a file" \
    "$conurb" appearance "$work/demo" export "$day" "$work/noon.json"
expect 0 "'noon' is there" "a light with a name" "$conurb" appearance "$work/demo" import "$work/noon.json" noon
expect 0 "a light with a name" "its place in the list" "$conurb" appearance "$work/demo" list
expect 2 "no photo is named 'darker', and no light" "a light that is not there" "$conurb" relight "$work/demo" \
    --from "$day" --to darker
# Compare with the pictures made with the tiles; instruction sets may round differently.
for light in day night; do
    [ $light = day ] && frame=00000 || frame=00001
    psnr=$("$pictures" psnr "$work/relit/$frame.png" "$demo/$light.png")
    awk -v psnr="$psnr" 'BEGIN { exit !(psnr > 40) }' && good || bad "the view by $light is $psnr dB from what it was"
done
# A light's name may have a comma.
echo '{"tiles": {}}' >"$work/mean,1.json" # no rows: every tile in its mean light
expect 0 "2 frames" "relighting to a file with a comma" "$conurb" relight "$work/demo" --photo "$view" --from "$day" \
    --to "$work/mean,1.json" --frames 2 --out "$work/comma"
expect 0 "3 frames" "a sequence with a comma in a name" "$conurb" relight "$work/demo" --photo "$view" \
    --sequence "$day,$work/mean,1.json,mean" --frames 3 --width 48 --out "$work/sequence"
expect 2 "give --from A --to B" "no last light" "$conurb" relight "$work/demo" --from "$day"
# Commands that need the photos say so.
expect 4 "pixels.bin" "evaluation without photos" "$conurb" eval "$work/demo"
finish
