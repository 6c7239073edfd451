#!/usr/bin/env bash
# Writes target/package/wrapyfi_ros2-VERSION-….whl for Linux with glibc 2.28 or newer, and prints its name. What the program needs
# of C is inside, with all licences.
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
# Outside: in the repository Cargo reads that the system's libzmq is linked.
staged=$(mktemp -d)
trap 'rm -rf "$staged"' EXIT
mkdir -p "$staged"/{.cargo,wrapyfi_ros2/licenses}
scripts/licences.py --texts "$staged/wrapyfi_ros2/licenses/licenses-of-crates.txt"
cp -r packaging/wheel/{pyproject.toml,README.md} LICENSE-* THIRD_PARTY.md "$staged/wrapyfi_ros2"
sed -i -E "s|^manifest-path = \"(\.\./)+|manifest-path = \"$root/|" "$staged/wrapyfi_ros2/pyproject.toml"

export PYO3_NO_PYTHON=1 TURBOJPEG_SOURCE=explicit PATH=$tools/bin:$PATH
CARGO_TARGET_DIR=$(realpath -m "${CARGO_TARGET_DIR:-target}")
CMAKE_BUILD_PARALLEL_LEVEL=$(nproc)
export CARGO_TARGET_DIR CMAKE_BUILD_PARALLEL_LEVEL
for processor in "${@:-$(uname -m)}"; do
    libraries=$root/target/package/libraries/$processor
    packaging/wheel/libraries.sh "$processor" "$libraries"
    export TURBOJPEG_LIB_DIR=$libraries/lib TURBOJPEG_INCLUDE_DIR=$libraries/include
    cat >"$staged/.cargo/config.toml" <<END_OF_CONFIG
[target.$processor-unknown-linux-gnu.zmq]
rustc-link-search = ["native=$libraries/lib"]
rustc-link-lib = ["static=zmq", "static=sodium", "c++"]
END_OF_CONFIG
    cp "$libraries"/licenses/* "$staged/wrapyfi_ros2/licenses"
    rm -f target/package/wrapyfi_ros2-*_"$processor".whl
    (cd "$staged/wrapyfi_ros2" && maturin build --quiet --profile "${PROFILE:-dist}" --zig --target "$processor-unknown-linux-gnu" \
        --compatibility manylinux_2_28 --out "$root/target/package")
    ls target/package/wrapyfi_ros2-*_"$processor".whl
done
