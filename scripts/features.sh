#!/usr/bin/env bash
# Compiles wrapyfi_core, wrapyfi_data, wrapyfi_plugins and wrapyfi_bridge with each feature alone, and with none. Features that
# need something of the system which few have (`rmw`: a sourced ROS 2; `candle-cuda`: CUDA) are left out.
set -euo pipefail
cd "$(dirname "$0")/.."

features() {
    cargo metadata --no-deps --locked --format-version 1 | python3 -c '
import json, sys
package = next(p for p in json.load(sys.stdin)["packages"] if p["name"] == sys.argv[1])
print("\n".join(sorted(set(package["features"]) - {"default", "full", "rmw", "candle-cuda"})))' "$1"
}

for crate in wrapyfi_core wrapyfi_data wrapyfi_plugins wrapyfi_bridge; do
    for feature in "" $(features $crate); do
        echo "features: $crate with ${feature:-none}"
        cargo --quiet clippy --locked --package $crate --no-default-features --features "$feature" -- -D warnings
    done
done
