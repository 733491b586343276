#!/usr/bin/env bash
# Formats our own sources with the pinned clang-format; `--check` changes nothing and fails when something would change.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
tool=.deps/clang-format/clang-format
[ -x "$tool" ] || { echo "error: no clang-format in .deps; run ./ars once" >&2; exit 1; }
mapfile -d '' files < <(find app engine model ui tests -type f \( -name '*.h' -o -name '*.cpp' -o -name '*.cu' \) -print0)
if [ "${1:-}" = --check ]; then
    "$tool" --dry-run --Werror "${files[@]}" || { echo "error: run tools/format.sh" >&2; exit 1; }
else
    "$tool" -i "${files[@]}"
fi
