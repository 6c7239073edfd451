#!/usr/bin/env bash
# Installs the program as `cargo install wrapyfi_bridge` will from crates.io: with nothing of the repository but what is in its
# crates, and not its settings of Cargo. Runs the demo, and looks for what removal leaves.
#
#   packaging/crates/test.sh [FOLDER]     FOLDER keeps what was compiled, target/package/crates/installed unless given
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
folder=$(realpath -m "${1:-$here/target/package/crates/installed}")

fail() {
    printf 'package crates: %s\n' "$1" >&2
    exit 1
}

# crates.io as a folder: the crates of others, of the versions in Cargo.lock, and ours beside them.
registry=$folder/registry
rm -rf "$registry" "$folder/root"
mkdir -p "$folder"
(cd "$here" && cargo --quiet vendor --locked "$registry") || fail "cargo vendor"
printf '[source.crates-io]\nreplace-with = "folder"\n[source.folder]\ndirectory = "%s"\n' "$registry" >"$folder/config.toml"
for crate in "$here"/target/package/crates/*.crate; do
    tar --extract --file "$crate" --directory "$registry"
    name=$(basename "$crate" .crate)
    [ -f "$registry/$name/LICENSE-MIT" ] || fail "$name has no licence in it"
    printf '{"files":{},"package":"%s"}' "$(sha256sum <"$crate" | cut -d' ' -f1)" >"$registry/$name/.cargo-checksum.json"
done

# Where no configuration of ours is above. Not optimised, which would take three times as long and test nothing more.
(cd "$folder" && CARGO_PROFILE_DEV_DEBUG=0 CARGO_TARGET_DIR=$folder/target cargo --quiet install --config "$folder/config.toml" \
    --offline --locked --debug --root "$folder/root" wrapyfi_bridge) || fail "cargo install"
wrapyfi=$folder/root/bin/wrapyfi
"$here/scripts/lo-namespace.sh" "$wrapyfi" demo --seconds 5 >"$folder/demo.log" 2>&1 ||
    { tail -n 30 "$folder/demo.log" >&2; fail "wrapyfi demo --seconds 5"; }
echo 'endpoints: { zeromq: { curve: { server_key: "Yne@$w-vo<fVvi]a<NY6T1ed:M$fCG*[IaLV{hID" } } }
routes: [{ from: "zeromq:/camera", to: "ros2:/camera", type: Image }]' >"$folder/curve.yaml"
"$wrapyfi" check "$folder/curve.yaml" >/dev/null || fail "a configuration with keys is refused"
cargo uninstall --quiet --root "$folder/root" wrapyfi_bridge 2>/dev/null
! find "$folder/root" -type f ! -name '.crates*' | grep . || fail "removal left something, above"
echo "package crates: installed, used and removed: wrapyfi_bridge and the $(ls "$here"/target/package/crates/*.crate | wc -l) crates it is of"
