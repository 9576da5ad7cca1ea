#!/usr/bin/env bash
# Checks README.md: its C program compiles against the installed library and runs. Its commands and the files that it
# names exist.
# readme.sh CONURB MAKE_PHOTOS BUILD
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
build=$3

sed -n '/^```c$/,/^```$/{/^```/!p}' "$root/README.md" >"$work/example.c"
expect 0 "conurb.pc" "install" cmake --install "$build" --prefix "$work/prefix"
[ -s "$work/prefix/share/man/man1/conurb-train.1" ] && good || bad "no man page is installed"
[ -s "$work/prefix/share/bash-completion/completions/conurb" ] && good || bad "no completion is installed"
pc=$(find "$work/prefix" -name conurb.pc -print -quit)
export PKG_CONFIG_PATH=${pc%/*}
if grep -q '^CONURB_SANITIZE:STRING=.' "$build/CMakeCache.txt"; then
    echo "the example is not run against a library with sanitizers"
else
    # Flags are words to split.
    # shellcheck disable=SC2046
    gcc -std=c17 -Wall -Wextra -Werror "$work/example.c" -o "$work/example" $(pkg-config --cflags --libs conurb) \
        >"$work/out" 2>&1 && good || bad "the example of README.md does not compile"
    cp -r "$root/tiles/demo" "$work/demo"
    export LD_LIBRARY_PATH=$(pkg-config --variable=libdir conurb)
    "$work/example" "$work/demo" "$work/pictures" >"$work/out" 2>&1 && good || bad "the example of README.md fails"
    [ -s "$work/pictures/00002.png" ] && good || bad "the example renders nothing"
    "$work/example" "$work/nowhere" >"$work/out" 2>&1
    [ $? = 2 ] && grep -q 'is not there' "$work/out" && good || bad "the example does not say what is wrong"
fi

for command in $(grep -hoE '^    conurb [a-z]+' "$root/README.md" | awk '{ print $2 }' | sort -u); do
    "$conurb" "$command" --help >"$work/out" 2>&1 && good || bad "README.md names conurb $command"
done
for file in $(grep -oE '\]\([a-zA-Z/._-]+\)' "$root/README.md" | tr -d '()]'); do
    [ -e "$root/$file" ] && good || bad "README.md names $file, which is not there"
done
finish
