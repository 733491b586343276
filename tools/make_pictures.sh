#!/usr/bin/env bash
# Makes the pictures of README and docs anew, with the program itself: run it when the renderer changes.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$root/ars" render --avatar rest:open --surfels 120000 --pose relaxed --azimuth 28 --fov 22 --size 320x480 --env studio:three_point \
    --curve agx --exposure 0.3 --background 0.13 --aov beauty,normal,ao,radius,importance --write buffers --out "$work"
mkdir -p "$root/docs/pictures"
for name in beauty normal ao radius importance; do
    cp "$work/0000_$name.png" "$root/docs/pictures/$name.png"
done
