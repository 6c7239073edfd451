#!/usr/bin/env bash
# Runs the tests of the crate around CycloneDDS under AddressSanitizer: its Rust, and the C below it.
#
#   scripts/test-asan.sh [arguments of the test program...]
#
# What is built for it lies apart, in target/asan: other flags would have everything compiled anew.
set -euo pipefail
cd "$(dirname "$0")/.."

host=$(rustc -vV | sed -n 's/^host: //p')
# The sanitizer's flags are accepted by nightly compilers only, unless a stable one is told so.
export RUSTC_BOOTSTRAP=1
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$PWD/target/asan}"
# With a target, these are not the flags of build scripts and macros.
export RUSTFLAGS="-Zsanitizer=address -Cforce-frame-pointers=yes"
export "CFLAGS_${host//-/_}=-fsanitize=address -fno-omit-frame-pointer -g1"
export CARGO_PROFILE_DEV_DEBUG=line-tables-only
# The optimiser takes several times as long over what the sanitizer adds, and may take away what it should find.
export CARGO_PROFILE_DEV_OPT_LEVEL=0
# Threads of CycloneDDS that a process leaves behind hold memory of theirs: that is no leak to find here.
export ASAN_OPTIONS="${ASAN_OPTIONS:-detect_leaks=0:detect_stack_use_after_return=1}"

build=(cargo --quiet test --locked --package wrapyfi_ros2 --lib --target "$host")
"${build[@]}" --no-run
# A process each would be slower, and hide what one test leaves for the next.
# One test reads how much memory the process holds: the sanitizer holds back what is freed, to find who still uses it.
scripts/lo-namespace.sh "${build[@]}" -- --skip what_cyclone_lent_goes_back_where_a_callback_panics "$@"
