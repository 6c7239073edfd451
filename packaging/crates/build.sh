#!/usr/bin/env bash
# Writes target/package/crates/*.crate, what crates.io would get of each crate that is published, and prints their names.
# What is not committed is packed too: `make release` refuses it.
set -euo pipefail
cd "$(dirname "$0")/../.."

crates=target/package/crates
rm -rf "$crates"
mkdir -p "$crates"
packages=$(cargo metadata --no-deps --locked --format-version 1 | "${PYTHON3:-/usr/bin/python3}" -c '
import json, sys
print(*("--package=" + p["name"] for p in json.load(sys.stdin)["packages"] if p["publish"] is None))')
# shellcheck disable=SC2086 # words
cargo --quiet package $packages --locked --no-verify --allow-dirty --target-dir "$crates/made" 2>"$crates/log" ||
    { cat "$crates/log" >&2; exit 1; }
mv "$crates"/made/package/*.crate "$crates"
rm -r "$crates/made" "$crates/log"
ls "$crates"/*.crate
