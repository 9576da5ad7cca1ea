#!/usr/bin/env bash
# kill -9 while COLMAP searches for features. The next run goes on with the photos that are left, and photos of one
# lens keep one camera. COLMAP itself runs, started by a script that stops where the test wants it to.
# usage: features.sh CONURB MAKE_PHOTOS
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
colmap=$(command -v colmap) || { echo "skipped: COLMAP is not installed"; exit 77; }
mkdir "$work/photos"
"$photos" "$work/photos" 9 none
rm -f "$work/photos/transforms.json"
: >"$work/out"

# While the file `hang` exists, the search for features takes the first 4 photos of its list, then hangs.
cat >"$work/colmap" <<END
#!/bin/bash
[ "\$2" = -h ] && exec $colmap "\$@"
if [ "\$1" = feature_extractor ]; then
    [ -e $work/hang ] && for ((i = 1; i <= \$#; i++)); do
        [ "\${!i}" = --image_list_path ] && { k=\$((i + 1)); sed -i 4q "\${!k}"; }
    done
    $colmap "\$@" || exit
    [ -e $work/hang ] && echo \$\$ >$work/pid && exec sleep 1000
    exit 0
fi
[ "\$1" = mapper ] && exit 1
exec $colmap "\$@"
END
chmod +x "$work/colmap"

# killed NAME: makes a city and kills its search for features after 4 photos.
killed() {
    town=$work/$1
    "$conurb" init "$town" --photos "$work/photos" 2>/dev/null
    sed -i "s|^poses:|poses:\n  attempts: 1\n  colmap: $work/colmap|" "$town/city.yaml"
    rm -f "$work/pid"
    touch "$work/hang"
    "$conurb" poses "$town" >"$work/out" 2>&1 &
    local run=$! i
    for ((i = 0; i < 600 * slow; i++)); do [ -s "$work/pid" ] && break; sleep 0.1; done
    [ -s "$work/pid" ] || bad "$1: COLMAP did not come to its fourth photo"
    kill -9 "$run"
    wait "$run" 2>/dev/null
    rm "$work/hang"
    database=$(find "$town" -name database.db)
}

# look QUERY: the database's answer.
look() {
    python3 -c 'import sqlite3, sys; print(sqlite3.connect(sys.argv[1]).execute(sys.argv[2]).fetchone()[0])' \
        "$database" "$1"
}
# same NAME WANTED GOT
same() { if [ "$2" = "$3" ]; then good; else bad "$1: $3, not $2"; fi; }

killed town
same "photos before the kill" 4 "$(look 'SELECT COUNT(*) FROM images')"
# Mark the features of the first run, so that they can be told from those of the second.
python3 - "$database" <<'PY'
import sqlite3, sys
base = sqlite3.connect(sys.argv[1])
base.execute("UPDATE keypoints SET rows = 1, data = zeroblob(4 * cols)")
base.execute("UPDATE descriptors SET rows = 1, data = zeroblob(cols)")
base.commit()
PY
"$conurb" poses "$town" >"$work/out" 2>&1
same "a run that goes on says so" 1 "$(grep -c 'the search for features resumes' "$work/out")"
same "photos after the kill" 9 "$(look 'SELECT COUNT(*) FROM images')"
same "photos of before it, left alone" 4 "$(look 'SELECT COUNT(*) FROM keypoints WHERE rows = 1')"
same "cameras of one lens" 1 "$(look 'SELECT COUNT(DISTINCT camera_id) FROM images')"

# A damaged database is made again.
killed lost
rm -f "$database-wal" "$database-shm"
truncate -s 5000 "$database"
"$conurb" poses "$town" >"$work/out" 2>&1
same "a damaged database is named" 1 "$(grep -c 'database.db: this COLMAP database cannot be read' "$work/out")"
same "photos after the loss" 9 "$(look 'SELECT COUNT(*) FROM images')"

# So is one that was made with other settings.
killed other
sed -i "s|^poses:|poses:\n  max_image_px: 64|" "$town/city.yaml"
"$conurb" poses "$town" >"$work/out" 2>&1
same "other settings begin anew" 0 "$(grep -c 'the search for features resumes' "$work/out")"
same "photos of other settings" 9 "$(look 'SELECT COUNT(*) FROM images')"
finish
