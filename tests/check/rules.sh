#!/usr/bin/env bash
# What scripts/check finds, and what it lets pass. rules.sh SCRIPTS
set -uo pipefail
scripts=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failed=0

# tree: an empty source tree in $tree.
tree() {
    tree=$(mktemp -d "$work/XXXXXX")
    mkdir -p "$tree/src/room" "$tree/include/conurb" "$tree/tests" "$tree/build/src"
}

# finds TEXT NAME COMMAND...: the command fails and says TEXT; with TEXT empty it succeeds and says nothing.
finds() {
    local text=$1 name=$2 answer code=0
    shift 2
    answer=$("$@" 2>&1) || code=$?
    if [ -z "$text" ] && { [ $code != 0 ] || [ -n "$answer" ]; }; then
        echo "FAILED: $name: $answer"
        failed=$((failed + 1))
    elif [ -n "$text" ] && { [ $code = 0 ] || [[ $answer != *"$text"* ]]; }; then
        echo "FAILED: $name: not found: $answer"
        failed=$((failed + 1))
    fi
}

# --- Circles
tree
echo '#include "room/b.h"' >"$tree/src/room/a.c"
echo '#include <conurb/room.h>' >"$tree/src/room/b.h"
touch "$tree/include/conurb/room.h"
finds '' "headers that go one way" "$scripts/circles" "$tree"
echo '#include "room/a.h"' >"$tree/src/room/b.c"
touch "$tree/src/room/a.h"
finds 'src/room/a' "two files that include each other's header" "$scripts/circles" "$tree"

tree
for name in a b c; do echo '#include "room/all.h"' >"$tree/src/room/$name.c"; done
echo 'int a(void); int b(void); int c(void);' >"$tree/src/room/all.h"
echo 'int a(void) { return b(); }' >>"$tree/src/room/a.c"
echo 'int b(void) { return c(); }' >>"$tree/src/room/b.c"
echo 'int c(void) { return 0; }' >>"$tree/src/room/c.c"
compile() {
    local objects=$tree/build/src/room/CMakeFiles/conurb_room.dir
    mkdir -p "$objects"
    for name in a b c; do cc -I"$tree/src" -c "$tree/src/room/$name.c" -o "$objects/$name.c.o" || exit 1; done
}
compile
finds '' "calls that go one way" "$scripts/circles" "$tree" "$tree/build"
sed -i 's/return 0/return a()/' "$tree/src/room/c.c"
compile
finds 'src/room/c' "three files in a circle through one header" "$scripts/circles" "$tree" "$tree/build"

# --- Style
for program in clang-format ctags; do
    command -v $program >/dev/null || { echo "skipped: $program is not installed"; exit $((failed ? 1 : 77)); }
done
tree
printf 'BasedOnStyle: LLVM\nColumnLimit: 120\n' >"$tree/.clang-format"
printf 'int a(void) { return 1; }\n' >"$tree/src/room/a.c"
mkdir "$tree/city-demo"
printf '# %0130d\n' 0 >"$tree/city-demo/city.yaml"
finds '' "what is in style, beside a city that scripts/run made" "$scripts/style" "$tree"
printf 'int  b( void ) {return 1;}\n' >"$tree/src/room/b.c"
finds 'src/room/b.c: clang-format would change it' "what clang-format would change" "$scripts/style" "$tree"
rm "$tree/src/room/b.c"
{ echo 'int c(int x) {'; for _ in $(seq 59); do echo '  x++;'; done; echo '}'; } >"$tree/tests/c.c"
finds 'tests/c.c:1: c has 61 lines' "a function of 61 lines" "$scripts/style" "$tree"
sed -i '2d' "$tree/tests/c.c"
finds '' "a function of 60 lines" "$scripts/style" "$tree"
printf 'int d(int a, int b, int c, int d, int e, int (*f)(int, int), int g);\n' >"$tree/include/conurb/room.h"
finds 'include/conurb/room.h:1: d has 7 parameters' "a function of seven parameters" "$scripts/style" "$tree"
printf 'int d(int a, int b, int c, int d, int e, int (*f)(int, int));\n' >"$tree/include/conurb/room.h"
finds '' "a function of six parameters" "$scripts/style" "$tree"
printf '# %0119d\n' 0 >"$tree/src/CMakeLists.txt"
finds 'src/CMakeLists.txt:1: a line of 121' "a long line" "$scripts/style" "$tree"
for file in tests/run.sh tests/run.py tests/chart.awk jobs/street.yaml scripts/run; do
    tree
    mkdir -p "$tree/jobs" "$tree/scripts"
    printf '# %0119d\n' 0 >"$tree/$file"
    finds "$file:1: a line of 121" "a long line of $file" "$scripts/style" "$tree"
done

[ $failed = 0 ] && echo "all rules hold"
exit $failed
