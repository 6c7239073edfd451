#!/usr/bin/env bash
# Compiles wrapyfi_core, wrapyfi_data, wrapyfi_plugins and wrapyfi_bridge with each feature alone, and with none. Features that
# need something of the system which few have (`rmw`, `rosidl`: a sourced ROS 2; `candle-cuda`: CUDA) are left out. And the extension
# for Python as a free-threaded Python has it, which needs none.
set -euo pipefail
cd "$(dirname "$0")/.."

features() {
    cargo metadata --no-deps --locked --format-version 1 | python3 -c '
import json, sys
package = next(p for p in json.load(sys.stdin)["packages"] if p["name"] == sys.argv[1])
print("\n".join(sorted(set(package["features"]) - {"default", "full", "rmw", "rosidl", "candle-cuda"})))' "$1"
}

for crate in wrapyfi_core wrapyfi_data wrapyfi_plugins wrapyfi_bridge; do
    for feature in "" $(features $crate); do
        echo "features: $crate with ${feature:-none}"
        cargo --quiet clippy --locked --package $crate --no-default-features --features "$feature" -- -D warnings
    done
done

echo "features: wrapyfi_python for a free-threaded Python"
settings=$(mktemp)
trap 'rm "$settings"' EXIT
printf '%s\n' implementation=CPython version=3.14 shared=true abi3=false pointer_width=64 build_flags=Py_GIL_DISABLED \
    suppress_build_script_link_lines=true >"$settings"
PYO3_CONFIG_FILE=$settings cargo --quiet clippy --locked --package wrapyfi_python -- -D warnings
