#!/usr/bin/env bash
# Runs `make demo` and `make test`, or the targets that are named, as on a machine that has built nothing: in a new clone
# of the last commit, with an empty CARGO_HOME, without cargo's installed tools and without pip's cache. Packages of apt
# that are installed stay; half an hour on two cores, and 12 GB in /var/tmp until it ends.
#
#   scripts/fresh.sh [TARGET ...]
set -euo pipefail
cd "$(dirname "$0")/.."
[ $# -gt 0 ] || set -- demo test

fresh=$(mktemp -d "${TMPDIR:-/var/tmp}/wrapyfi-fresh.XXXXXX")
trap 'rm -rf "$fresh"' EXIT

# Cargo looks for its tools in CARGO_HOME first, then in PATH, where these stand before those that the machine has.
mkdir "$fresh/bin" "$fresh/cargo"
for tool in cargo-nextest cargo-deny cargo-sbom; do
    printf '#!/bin/sh\nexit 1\n' >"$fresh/bin/$tool"
    chmod +x "$fresh/bin/$tool"
done

git clone --quiet . "$fresh/clone"
cd "$fresh/clone"
unset CARGO_TARGET_DIR
export CARGO_HOME=$fresh/cargo PATH=$fresh/bin:$PATH PIP_NO_CACHE_DIR=1
for target in "$@"; do
    begun=$SECONDS
    make "$target" || { echo "fresh: make $target failed after $((SECONDS - begun)) s" >&2; exit 1; }
    echo "fresh: make $target passed in $((SECONDS - begun)) s"
done
