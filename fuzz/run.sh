#!/usr/bin/env bash
# Runs fuzz targets, each for some seconds, and says what each one did.
#
#   fuzz/run.sh [TARGET...]      every target unless named; SECONDS_EACH=60 by default
#
# New inputs stay in target/fuzz/corpus; what fails is shown, and kept in target/fuzz/artifacts.
set -euo pipefail
cd "$(dirname "$0")/.."

seconds=${SECONDS_EACH:-60}
work=target/fuzz
# The sanitizer's flags are accepted by nightly compilers only, unless a stable one is told so.
export RUSTC_BOOTSTRAP=1
export CARGO_TARGET_DIR="$PWD/$work/build"

command -v cargo-fuzz >/dev/null || cargo install cargo-fuzz --locked --target-dir "$work/install"
mkdir -p target && touch target/COLCON_IGNORE
fuzz() { cargo fuzz "$1" --fuzz-dir fuzz/targets "${@:2}"; }

targets=("$@")
[ ${#targets[@]} -gt 0 ] || mapfile -t targets < <(fuzz list)
fuzz build

failed=0
summary=
for target in "${targets[@]}"; do
    mkdir -p "$work"/{corpus,artifacts,log}/"$target"
    log=$work/log/$target/log
    # The first folder is written to: the repository's own corpus is only read.
    if fuzz run "$target" "$work/corpus/$target" "fuzz/corpus/$target" -- \
        -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -max_len=8192 \
        -artifact_prefix="$work/artifacts/$target/" -print_final_stats=1 >"$log" 2>&1; then
        verdict=holds
    else
        verdict="FAILS: $(grep -aoE "$work/artifacts/[^ ]*" "$log" | tail -1)"
        grep -aE 'panicked at|SUMMARY|ERROR' -A1 "$log" | head -8 >&2 || true
        failed=1
    fi
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    coverage=$(grep -aoE 'cov: [0-9]+' "$log" | tail -1)
    summary+=$(printf '%-11s %10s inputs  %-10s %s' "$target" "${runs:-?}" "${coverage:-}" "$verdict")$'\n'
done
printf '%s' "$summary"
exit "$failed"
