#!/usr/bin/env bash
# Splats of tiles/demo: files, messages, what stops them.
# splats.sh CONURB MAKE_PHOTOS DEMO
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
cp -r "$3" "$work/demo"
light=run0-clear_street_0006.jpg
out=$work/out-of-it
mkdir "$out"

# A fit of a few steps: what is around it.
expect 0 "held-out views to the field's renders" "splats" "$conurb" export "$work/demo" --splats "$out/s.ply" \
    --budget 2000 --minutes 0.03 --appearance "$light"
head -c 1200 "$out/s.ply" | tr -d '\0' | sed '/end_header/q' >"$work/header"
for line in "format binary_little_endian 1.0" "comment light: $light" "comment tiles: 3: " "comment origin: 48" \
    "property float f_dc_0" "property float rot_3"; do
    grep -qaF "$line" "$work/header" && good || bad "the PLY lacks '$line'"
done
n=$(sed -n 's/^element vertex //p' "$work/header")
[ "$n" -gt 500 ] && [ "$n" -le 2000 ] && good || bad "$n splats"
length=$(sed '/end_header/q' "$out/s.ply" | wc -c)
[ "$(stat -c %s "$out/s.ply")" = $((length + n * 68)) ] && good || bad "the PLY has another size than $n rows"
grep -q latitude_deg "$out/s.frame.json" && good || bad "no frame beside the PLY"

expect 2 "ends with .ply or .spz" "another ending" "$conurb" export "$work/demo" --splats "$out/s.splat"
expect 2 "--budget 10" "a small budget" "$conurb" export "$work/demo" --splats "$out/t.ply" --budget 10
expect 2 "--minutes -1" "no time" "$conurb" export "$work/demo" --splats "$out/t.ply" --minutes -1
expect 6 "nowhere" "a folder that is not there" "$conurb" export "$work/demo" --splats "$out/nowhere/t.ply"
expect 6 "cannot write" "a disk that is full" \
    bash -c "ulimit -f 60; trap '' XFSZ; exec '$conurb' export '$work/demo' --splats '$out/t.ply' --budget 2000"

# Ctrl-C while the views are rendered. Before the program has started, the signal would end the shell that starts it.
: >"$work/out"
"$conurb" export "$work/demo" --splats "$out/t.ply" >"$work/out" 2>&1 &
for ((i = 0; i < 600 * slow; i++)); do
    grep -q "splats: views" "$work/out" && break
    sleep 0.1
done
kill -INT $!
wait $!
code=$?
[ $code = 75 ] && grep -q "stopped while rendering" "$work/out" && good || bad "Ctrl-C ends with $code"
[ "$(ls -A "$out" | wc -l)" = 2 ] && good || bad "something is left of what failed: $(ls -A "$out")"
finish
