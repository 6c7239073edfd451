#!/usr/bin/env bash
# Writes the archive that bloom imports: every colcon package complete in its own folder, the crates of others beside ours, so
# that it is built without a network and without what lies above it (docs/adr/012-releases-and-the-build-farm.md).
#
#   packaging/bloom.sh FILE.tar.gz      of the commit that is checked out
set -euo pipefail
file=$(realpath -m "${1:?usage: packaging/bloom.sh FILE.tar.gz}")
cd "$(dirname "$0")/.."
# shellcheck source=packaging/environment.sh
. packaging/environment.sh

made=target/package/bloom
rm -rf "$made"
mkdir -p "$made/sources" "$made/packages"
git archive HEAD | tar --extract --directory "$made/sources"
cp -r "$made"/sources/wrapyfi{_msgs,_py} "$made/packages"
(
    cd "$made/sources"
    cargo --quiet vendor --locked vendor
    # For Windows: Cargo reads their manifests and nothing else.
    rm -rf vendor/winapi-*-pc-windows-gnu/lib vendor/windows_*/lib
)
for package in wrapyfi_core wrapyfi_bridge wrapyfi; do
    folder=$made/packages/$package
    mkdir "$folder"
    cp "$made/sources/$package/package.xml" "$folder"
    # Not where a link in what is installed points to.
    sed '/CREATE_LINK/!s:\.\./:sources/:g' "$made/sources/$package/CMakeLists.txt" >"$folder/CMakeLists.txt"
    case $package in
    wrapyfi) mkdir "$folder/sources" && cp -r "$made"/sources/{cmake,config,launch} "$folder/sources" ;;
    *)
        cp -rl "$made/sources" "$folder/sources"
        # Above the sources, whose own settings of Cargo are installed for others.
        mkdir "$folder/.cargo"
        printf '[source.crates-io]\nreplace-with = "vendored"\n[source.vendored]\ndirectory = "sources/vendor"\n' >"$folder/.cargo/config.toml"
        ;;
    esac
done
for package in wrapyfi wrapyfi_bridge wrapyfi_core wrapyfi_msgs wrapyfi_py; do
    python3 scripts/changelog.py "$package" >"$made/packages/$package/CHANGELOG.rst"
done
tar --create --sort name --mtime "@$SOURCE_DATE_EPOCH" --owner 0 --group 0 --numeric-owner --hard-dereference \
    --directory "$made/packages" . | gzip -9n >"$file"
