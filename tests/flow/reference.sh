#!/usr/bin/env bash
# The reference of the C library builds without a warning and contains the comments of the headers.
# reference.sh DOXYFILE
set -euo pipefail
command -v doxygen >/dev/null || { echo "skipped: doxygen is not installed"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
{ cat "$1"; echo "OUTPUT_DIRECTORY = $work"; } >"$work/Doxyfile"
doxygen "$work/Doxyfile"
# A comment before a function, one behind a member, and one of a file.
grep -q 'Lens models, with COLMAP.s ids' "$work/html/pose_8h.html" || { echo "cn_lens has no text"; exit 1; }
grep -q 'size of the photos that were' "$work"/html/structcn__camera.html || { echo "a member has no text"; exit 1; }
pages=$(find "$work/html" -name '*_8h.html' | wc -l)
headers=$(find "$(dirname "$0")/../../include/conurb" -name '*.h' | wc -l)
[ "$pages" = "$headers" ] || { echo "$pages pages for $headers headers"; exit 1; }
