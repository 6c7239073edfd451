#!/usr/bin/env bash
# Writes the two wheels, target/package/wrapyfi_ros2-VERSION-….whl (the program) and wrapyfi_rs-VERSION-….whl (the library for
# Python), for Linux with glibc 2.28 or newer, and prints their names. What they need of C is inside, with all licences.
#
#   packaging/wheel/build.sh [PROCESSOR...]     x86_64, aarch64; without one, that of this machine. PROFILE=demo
#   compiles in half the time.
set -euo pipefail
cd "$(dirname "$0")/../.."
# shellcheck source=packaging/environment.sh
. packaging/environment.sh

MATURIN_VERSION=1.16.0
ZIG_VERSION=0.13.0
root=$PWD tools=$PWD/target/package/tools
if [ "$("$tools/bin/maturin" --version 2>/dev/null)" != "maturin $MATURIN_VERSION" ] || ! "$tools/bin/python" -c "import ziglang" 2>/dev/null; then
    "${PYTHON3:-/usr/bin/python3}" -m venv --clear "$tools"
    "$tools/bin/pip" install --quiet --disable-pip-version-check "maturin==$MATURIN_VERSION" "ziglang==$ZIG_VERSION"
fi
staged=$(mktemp -d)
trap 'rm -rf "$staged"' EXIT
mkdir -p "$staged/licenses"
scripts/licences.py --texts "$staged/licenses/licenses-of-crates.txt"
# What zig links in place of the system's libgcc.
zig=$("$tools/bin/python" -c 'import ziglang; print(*ziglang.__path__)')
cp "$zig/LICENSE" "$staged/licenses/zig"
cp "$zig/lib/libunwind/LICENSE.TXT" "$staged/licenses/llvm-libunwind"
cp -r packaging/wheel "$staged/wrapyfi_ros2"
cp -rL wrapyfi_rs "$staged/wrapyfi_rs" # the package of messages is a link to wrapyfi_py

export PYO3_NO_PYTHON=1 TURBOJPEG_SOURCE=explicit PATH=$tools/bin:$PATH
CARGO_TARGET_DIR=$(realpath -m "${CARGO_TARGET_DIR:-target}")
CMAKE_BUILD_PARALLEL_LEVEL=$(nproc)
export CARGO_TARGET_DIR CMAKE_BUILD_PARALLEL_LEVEL
for processor in "${@:-$(uname -m)}"; do
    libraries=$root/target/package/libraries/$processor
    packaging/wheel/libraries.sh "$processor" "$libraries"
    export TURBOJPEG_LIB_DIR=$libraries/lib TURBOJPEG_INCLUDE_DIR=$libraries/include
    for package in wrapyfi_ros2 wrapyfi_rs; do
        cp -r LICENSE-* THIRD_PARTY.md "$staged/licenses" "$staged/$package"
        cp "$libraries"/licenses/* "$staged/$package/licenses"
        sed -i -E "s|^manifest-path = \"(\.\./)+|manifest-path = \"$root/|" "$staged/$package/pyproject.toml"
        grep -q ^license-files "$staged/$package/pyproject.toml" ||
            sed -i 's|^license = .*|&\nlicense-files = ["LICENSE-*", "THIRD_PARTY.md", "licenses/*"]|' "$staged/$package/pyproject.toml"
        rm -f target/package/$package-*_"$processor".whl
        (cd "$staged/$package" && maturin build --quiet --profile "${PROFILE:-dist}" --zig --target "$processor-unknown-linux-gnu" \
            --compatibility manylinux_2_28 --out "$root/target/package")
        ls target/package/$package-*_"$processor".whl
    done
done
