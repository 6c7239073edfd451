#!/usr/bin/env bash
# Counts the crates of others that wrapyfi_core with `#[communicator]` on ZeroMQ alone depends on: what is heavy is a feature
# that is off, and stays it. Walls between our own crates cost a user nothing.
set -euo pipefail
cd "$(dirname "$0")/.."

LIMIT=64

tree() {
    cargo tree --locked --package wrapyfi_core --no-default-features --features zeromq --edges normal,build \
        --prefix none --no-dedupe
}

crates=$(tree | sort -u | grep -v '^wrapyfi_')
count=$(wc -l <<<"$crates")
if [ "$count" -ge $LIMIT ]; then
    printf '%s\n' "$crates" >&2
    echo "dependencies: wrapyfi_core with feature zeromq depends on $count crates of others, fewer than $LIMIT are allowed: put what was" \
        "added behind a feature" >&2
    exit 1
fi
for heavy in arrow-array cyclors dxr hyper image regex rustdds serde-saphyr tokio turbojpeg; do
    if grep -q "^$heavy v" <<<"$crates"; then
        echo "dependencies: wrapyfi_core with feature zeromq alone has $heavy: put it behind its feature" >&2
        exit 1
    fi
done
