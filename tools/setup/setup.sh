#!/usr/bin/env bash
# Brings a machine to the point where the project builds: distribution packages, LibTorch, Dear ImGui, clang-format.
# Every step can be repeated after an interruption and does only what is missing. Called by ./ars.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
deps=$root/.deps
# shellcheck source=pins.env
source "$root/tools/setup/pins.env"

say() { printf '\033[1m==\033[0m %s\n' "$*" >&2; }
fail() {
    printf 'error: %s\n' "$*" >&2
    exit 1
}

distribution() {
    [ -r /etc/os-release ] || fail "unknown distribution: there is no /etc/os-release; ARS Studio is set up on Debian 12 and Ubuntu 24.04"
    # shellcheck disable=SC1091
    local id like
    id=$(. /etc/os-release && echo "${ID:-}")
    like=$(. /etc/os-release && echo "${ID_LIKE:-}")
    case " $id $like " in
        *" ubuntu "*) echo ubuntu ;;
        *" debian "*) echo debian ;;
        *) fail "unknown distribution \"$id\": install what tools/setup/apt-packages.txt lists by your own means, then run ARS_SKIP_PACKAGES=1 ./ars" ;;
    esac
}

install_packages() {
    [ -z "${ARS_SKIP_PACKAGES:-}" ] || return 0
    local kind wanted missing=()
    kind=$(distribution)
    wanted=$(sed -e 's/#.*//' -e "s/^$kind://" -e '/^[a-z]*:/d' -e '/^ *$/d' "$root/tools/setup/apt-packages.txt")
    # One query for all: a name that is not known at all prints nothing.
    # shellcheck disable=SC2086
    local name installed
    installed=$(dpkg-query -W -f '${db:Status-Abbrev} ${Package}\n' $wanted 2>/dev/null | sed -n 's/^ii *//p' || true)
    for name in $wanted; do
        grep -qxF -- "$name" <<<"$installed" || missing+=("$name")
    done
    [ ${#missing[@]} -gt 0 ] || return 0
    say "installing ${#missing[@]} packages of the distribution: ${missing[*]}"
    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || fail "packages are missing and this is not root; run as root: apt-get install -y --no-install-recommends ${missing[*]}"
        as_root=(sudo)
    fi
    export DEBIAN_FRONTEND=noninteractive
    local apt=("${as_root[@]}" apt-get -o DPkg::Lock::Timeout=600 -y --no-install-recommends)
    [ -t 2 ] || apt+=(-qq)
    "${apt[@]}" update >&2 || fail "the package lists could not be fetched; check the network and run ./ars again"
    "${apt[@]}" install "${missing[@]}" >&2 ||
        fail "packages could not be installed; the line above says why. After mending it run ./ars again, or by hand: apt-get install ${missing[*]}"
}

# fetch NAME PROJECT FOLDER PATTERN...
fetch() {
    local name=$1 project=$2 folder=$3 version file sha
    shift 3
    version=${name}_VERSION file=${name}_FILE sha=${name}_SHA256
    local stamp=$deps/$folder/.version
    if [ "$(cat "$stamp" 2>/dev/null)" = "${!sha}" ]; then return 0; fi
    say "fetching $project ${!version}"
    python3 "$root/tools/setup/fetch.py" "$project" "${!file}" "${!sha}" "$deps/downloads" "$deps/$folder" "$@" || exit 1
    echo "${!sha}" >"$stamp"
}

fetch_torch() {
    [ -z "${ARS_TORCH_DIR:-}" ] || return 0
    fetch TORCH torch torch 'torch/lib/libtorch_cpu.so' 'torch/lib/libc10.so' 'torch/lib/libgomp.so.1' 'torch/include/*' \
        'torch-*/licenses/*' 'torch-*/METADATA'
    local lib=$deps/torch/torch/lib name
    for name in cudart cupti; do
        [ -e "$lib/lib$name.so.13" ] && continue
        say "making the stand-in lib$name.so.13 (LibTorch names it, a machine without NVIDIA does not need it)"
        printf 'lib%s.so.13 { *; };\n' "$name" >"$lib/$name.map"
        cc -shared -fPIC -O1 "-DARS_STUB_${name^^}" "-Wl,-soname,lib$name.so.13" "-Wl,--version-script,$lib/$name.map" \
            "$root/tools/setup/cuda_stubs.c" -o "$lib/lib$name.so.13" || fail "the C compiler could not make lib$name.so.13"
    done
}

fetch_imgui() {
    local top="imgui_bundle-$IMGUI_VERSION/external"
    fetch IMGUI imgui-bundle imgui "$top/imgui/imgui/*:3" "$top/implot/implot/*:3" "$top/ImGuizmo/ImGuizmo/*:3" \
        "$top/imgui_test_engine/imgui_test_engine/imgui_test_engine/*:4" \
        "$top/portable_file_dialogs/portable_file_dialogs/*:3" \
        "$top/imgui-command-palette/imgui-command-palette/*:3"
}

mkdir -p "$deps"
exec 9>"$deps/.lock"
flock -n 9 || { say "another ./ars is setting up; waiting for it"; flock 9; }
install_packages
fetch_torch
fetch_imgui
fetch CLANG_FORMAT clang-format clang-format 'clang_format/data/bin/clang-format:3'
cat "$root"/tools/setup/{pins.env,apt-packages.txt} >"$deps/.ready.new"
mv "$deps/.ready.new" "$deps/.ready"
say "set up"
