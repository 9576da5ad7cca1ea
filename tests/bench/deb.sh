#!/usr/bin/env bash
# Builds the Debian package, installs it on a fresh Debian 12 (debootstrap), and renders and relights tiles/demo there.
# deb.sh BUILD [ROOT]: as root, with a network. BUILD is an empty folder or one from before. ROOT is the fresh Debian;
# it is made where it is not there, and is a temporary folder by default.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
build=$1
debian=${2:-}
[ "$(id -u)" = 0 ] || { echo "deb.sh: has to run as root, for debootstrap and chroot" >&2; exit 77; }
for program in debootstrap dpkg-shlibdeps; do
    command -v $program >/dev/null || { echo "deb.sh: $program is not installed" >&2; exit 77; }
done
if [ -z "$debian" ]; then
    debian=$(mktemp -d)
    trap 'rm -rf "$debian"' EXIT
fi

cmake -S "$root" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCONURB_TESTS=OFF
cmake --build "$build"
rm -f "$build"/conurb_*.deb
(cd "$build" && cpack -G DEB)
[ -e "$debian/bin/bash" ] || debootstrap --variant=minbase bookworm "$debian"

rm -rf "$debian/conurb" && mkdir "$debian/conurb"
cp "$build"/conurb_*.deb "$debian/conurb/"
cp -r "$root/tiles/demo" "$debian/conurb/demo"
cat >"$debian/conurb/try.sh" <<'SH'
set -eu
apt-get update -q
DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends /conurb/conurb_*.deb
conurb --version
conurb doctor /conurb/demo
conurb render /conurb/demo --photo=run0-clear_air_0003.jpg --appearance run0-clear_street_0006.jpg --out /conurb/day
conurb relight /conurb/demo --from run0-clear_street_0006.jpg --to run3-night_street_0010.jpg \
    --photo run0-clear_air_0003.jpg --frames 2 --out /conurb/relit
[ -s /conurb/day/00000.png ]
[ -s /conurb/relit/flight.mp4 ]
[ -s /usr/share/bash-completion/completions/conurb ]
# The pages are in the package; a minimal Debian is told to leave out manuals.
dpkg -L conurb | grep -q /man1/conurb-train.1
SH
chroot "$debian" /bin/bash /conurb/try.sh
echo "deb.sh: $(basename "$build"/conurb_*.deb) installs and passes the demo"
