#!/usr/bin/env bash
# Runs every libFuzzer target of build/fuzz for N seconds (default 5), from its seeds; prints one line for each.
# A finding stays in build/fuzz/findings/NAME-*.
set -uo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
seconds=${1:-5}
cd "$root/build/fuzz" || { echo "error: no build/fuzz; configure it with: cmake --preset fuzz" >&2; exit 1; }
mkdir -p findings
failed=0
run() {
    local name=$1 corpus=corpus/$1 seeds=$root/tests/fuzz/seeds/${1#fuzz_} log=findings/$1.log
    mkdir -p "$corpus"
    [ -d "$seeds" ] || seeds=
    # 2 GiB: a reader that lets a small file ask for more has failed.
    "bin/$name" -max_total_time="$seconds" -rss_limit_mb=2560 -malloc_limit_mb=2048 -timeout=20 -print_final_stats=1 \
        -artifact_prefix="findings/$name-" "$corpus" $seeds >"$log" 2>&1
    local code=$?
    printf '    %-18s %9s runs  %s\n' "$name" "$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")" \
        "$([ $code -eq 0 ] && echo ok || { echo "FAILED (build/fuzz/$log):"; grep -E 'ERROR|SUMMARY|runtime error' "$log" | head -3; })"
    return $code
}
for program in bin/fuzz_*; do
    run "$(basename "$program")" || failed=1
done
exit $failed
