#!/usr/bin/env bash
# Compiles what both wheels have inside, for Linux on a processor with glibc 2.28 or newer: libjpeg-turbo, as a static library
# in a folder, with its licence. The sources are those that a crate in Cargo.lock carries.
#
#   packaging/wheel/libraries.sh PROCESSOR FOLDER     with tools of target/package/tools
set -euo pipefail
processor=$1 folder=$(realpath -m "$2") recipe=$(realpath "$0")
cd "$(dirname "$0")/../.."
tools=$PWD/target/package/tools

[ "$(cat "$folder/made" 2>/dev/null)" != "$(cat "$recipe")" ] || exit 0

rm -rf "$folder"
mkdir -p "$folder"/{bin,lib,include,licenses,made.of/jpeg}
for tool in cc c++; do
    printf '#!/bin/sh\nexec "%s/bin/python" -m ziglang %s -target %s-linux-gnu.2.28 -w "$@"\n' "$tools" "$tool" "$processor" >"$folder/bin/$tool"
done
for tool in ar ranlib; do printf '#!/bin/sh\nexec "%s/bin/python" -m ziglang %s "$@"\n' "$tools" "$tool" >"$folder/bin/$tool"; done
chmod +x "$folder"/bin/*
export CC=$folder/bin/cc CXX=$folder/bin/c++ AR=$folder/bin/ar RANLIB=$folder/bin/ranlib
export CFLAGS="${CFLAGS:-} -O2 -g0 -fPIC" CXXFLAGS="${CXXFLAGS:-} -O2 -g0 -fPIC"
# One process for each core: cmake's and make's own choice is as many as there are files.
jobs=$(nproc)

# Where Cargo has the sources of a crate of Cargo.lock.
source_of() {
    cargo metadata --locked --format-version 1 | "$tools/bin/python" -c '
import json, os, sys
print(next(os.path.dirname(p["manifest_path"]) for p in json.load(sys.stdin)["packages"] if p["name"] == sys.argv[1]))' "$1"
}
run() {
    "$@" >>"$folder/log" 2>&1 || { tail -n 20 "$folder/log" >&2; exit 1; }
}

jpeg() {
    local source
    source=$(source_of turbojpeg-sys)/libjpeg-turbo
    cd "$folder/made.of/jpeg"
    run cmake -S "$source" -B . -DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR="$processor" -DCMAKE_AR="$AR" -DCMAKE_RANLIB="$RANLIB" \
        -DCMAKE_BUILD_TYPE=Release -DENABLE_SHARED=OFF -DREQUIRE_SIMD=ON
    run make --jobs "$jobs" turbojpeg-static
    cp libturbojpeg.a "$folder/lib"
    cp "$source/turbojpeg.h" "$folder/include"
    cp "$source/LICENSE.md" "$folder/licenses/libjpeg-turbo"
    cp "$source/README.ijg" "$folder/licenses/libjpeg-turbo.ijg"
}

(jpeg)
cp "$recipe" "$folder/made"
