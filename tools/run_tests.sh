#!/usr/bin/env bash
# Everything `./ars test` does after the set-up: formatting, build, unit tests, the same under sanitizers, fuzzers.
#   --require-data    fail when a test did not run because something is missing here
#   --quick           neither sanitizers nor fuzzers
#   --fuzz-seconds N  time for each fuzzer (default 5)
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
quick= fuzz_seconds=5
while [ $# -gt 0 ]; do
    case $1 in
        --require-data) export ARS_REQUIRE_DATA=1 ;;
        --quick) quick=1 ;;
        --fuzz-seconds) fuzz_seconds=${2:?--fuzz-seconds needs a number}; shift ;;
        *) echo "error: ./ars test knows --require-data, --quick and --fuzz-seconds N, found \"$1\"" >&2; exit 2 ;;
    esac
    shift
done

say() { printf '\033[1m==\033[0m %s\n' "$*"; }
failures=()
if [ -z "${ARS_TEST_DATA:-}" ]; then
    say "ARS_TEST_DATA is not set: tests that need the shared test data will say NOT RUN"
fi

# build PRESET: configures when needed and builds everything of it.
build() {
    mkdir -p "build/$1"
    if [ ! -f "build/$1/build.ninja" ]; then
        say "configuring build/$1"
        cmake --preset "$1" >"build/$1/configure.log" 2>&1 || { cat "build/$1/configure.log"; exit 1; }
    fi
    say "building build/$1"
    NINJA_STATUS='    [%f/%t] ' ninja -C "build/$1" | awk '/\[[0-9]+\/[0-9]+\]/ {last = $0; if (++n % 20 == 0) print; next} {print} END {print last}' ||
        { echo "error: the build of build/$1 failed" >&2; exit 1; }
}

# tests PRESET: runs CTest there; the whole output stays in build/PRESET/tests.log, and the end of what a failed test said is shown.
tests() {
    local folder=$root/build/$1/Testing/Temporary log=$root/build/$1/tests.log passed=yes names name
    say "tests in build/$1"
    rm -f "$folder/LastTestsFailed.log"
    ctest --test-dir "build/$1" --timeout 1500 | { grep -vE '^ +Start +[0-9]+:' || true; } || passed=
    cp "$folder/LastTest.log" "$log"
    [ -z "$passed" ] || return 0
    names=$(sed -n 's/^[0-9]*://p' "$folder/LastTestsFailed.log" 2>/dev/null || true)
    failures+=("tests in build/$1: $(paste -sd ' ' <<<"$names")")
    for name in $names; do
        say "what $name said: its failures, then its last lines"
        sed -n "/^[0-9]*\/[0-9]* Test: $name\$/,/^<end of output>/p" "$log" >"$log.$name"
        grep -E '^\[  FAILED  \]|: Failure$|^FAILED' "$log.$name" | sort -u | head -n 40 || true
        tail -n 60 "$log.$name"
    done
}

say "formatting"
tools/format.sh --check || failures+=(formatting)
build "${ARS_PRESET:-release}"
tests "${ARS_PRESET:-release}"
if [ -z "$quick" ]; then
    build fuzz
    tests fuzz
    say "fuzzers, $fuzz_seconds s each"
    tools/fuzz.sh "$fuzz_seconds" || failures+=(fuzzers)
fi

logs=$(cat build/"${ARS_PRESET:-release}"/tests.log build/fuzz/tests.log 2>/dev/null | grep '^NOT RUN:' | sort -u || true)
# Every operator's tests say so on a machine without a GPU; once is enough.
hostonly=$(grep -c 'on CUDA: no CUDA device$' <<<"$logs" || true)
logs=$(grep -v 'on CUDA: no CUDA device$' <<<"$logs" || true)
[ "$hostonly" -eq 0 ] || logs="$logs${logs:+$'\n'}NOT RUN: $hostonly tests of operators on CUDA: no CUDA device (they ran on the processor)"
count=$(grep -c . <<<"$logs" || true)
if [ "$count" -gt 0 ]; then
    say "$count tests did not run here, or not all of them:"
    echo "$logs"
fi
if [ ${#failures[@]} -gt 0 ]; then
    printf 'error: failed: %s\n' "$(IFS=';'; echo "${failures[*]}")" >&2
    exit 1
fi
say "all green; $count NOT RUN"
