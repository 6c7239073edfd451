#!/usr/bin/env bash
# Writes target/package/wrapyfi_VERSION_ARCHITECTURE.deb for the system that it runs on, and prints its name.
# PROFILE=dev packs the development build: quick, to try a change of what is packed.
set -euo pipefail
cd "$(dirname "$0")/../.."
# shellcheck source=packaging/environment.sh
. packaging/environment.sh

CARGO_DEB_VERSION=3.8.0
profile=${PROFILE:-dist}
target=${CARGO_TARGET_DIR:-target}
case $profile in
dev) program=$target/debug/wrapyfi ;;
*) program=$target/$profile/wrapyfi ;;
esac

if ! cargo deb --version 2>/dev/null | grep -qF "$CARGO_DEB_VERSION"; then
    echo "deb: cargo install cargo-deb $CARGO_DEB_VERSION (two minutes, once)" >&2
    CARGO_PROFILE_DEV_DEBUG=0 cargo install --quiet --locked --debug "cargo-deb@$CARGO_DEB_VERSION"
fi
# Addresses that the loader corrects, packed: a twentieth of the file, and of what a bridge at rest has in memory. glibc 2.36 reads it.
# And functions that came out the same, once, where the linker can: a hundredth.
options=("-Clink-arg=-Wl,-z,pack-relative-relocs")
[ "$profile" = dev ] || [ "$(uname -m)" != x86_64 ] || options+=("-Clink-arg=-Wl,--icf=all") # by lld, which Rust brings there
cargo --quiet rustc --profile "$profile" --locked --package wrapyfi_bridge --bin wrapyfi -- "${options[@]}"

# What is made and not written: wrapyfi_bridge/Cargo.toml names it beside what the repository has.
made=target/package/made
rm -rf "$made"
mkdir -p "$made"/{bin,nodes,completions}
"$program" man "$made/man1"
gzip -9n "$made"/man1/*.1
"$program" completions bash >"$made/completions/wrapyfi"
"$program" completions zsh >"$made/completions/_wrapyfi"
"$program" completions fish >"$made/completions/wrapyfi.fish"
scripts/licences.py --texts "$made/licenses-of-crates.txt"
gzip -9n "$made/licenses-of-crates.txt"
# The program is the node by whose name it is started. `bridge` is not on PATH, where iproute2 has one.
for node in bridge ros1_bridge yarp_bridge zeromq_bridge; do
    ln -s ../../bin/wrapyfi "$made/nodes/$node"
    [ "$node" = bridge ] || ln -s wrapyfi "$made/bin/$node"
done

rm -f target/package/wrapyfi_*.deb
cargo deb --quiet --no-build --profile "$profile" --locked --package wrapyfi_bridge --output target/package/
ls target/package/wrapyfi_*.deb
