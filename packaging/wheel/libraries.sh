#!/usr/bin/env bash
# Compiles what both wheels have inside, for Linux on a processor with glibc 2.28 or newer: libzmq with CURVE, libsodium and
# libjpeg-turbo, as static libraries in a folder, with their licences. Sources are those that two crates in Cargo.lock carry, and
# PyNaCl's from PyPI, which carries libsodium's.
#
#   packaging/wheel/libraries.sh PROCESSOR FOLDER     with tools of target/package/tools
set -euo pipefail
processor=$1 folder=$(realpath -m "$2") recipe=$(realpath "$0")
cd "$(dirname "$0")/../.."
tools=$PWD/target/package/tools

PYNACL_VERSION=1.6.2 # libsodium 1.0.20
PYNACL_SHA256=018494d6d696ae03c7e656e5e74cdfd8ea1326962cc401bcf018f1ed8436811c
[ "$(cat "$folder/made" 2>/dev/null)" != "$(cat "$recipe")" ] || exit 0

rm -rf "$folder"
mkdir -p "$folder"/{bin,lib,include,licenses,made.of/{sodium,jpeg,zmq}}
for tool in cc c++; do
    printf '#!/bin/sh\nexec "%s/bin/python" -m ziglang %s -target %s-linux-gnu.2.28 -w "$@"\n' "$tools" "$tool" "$processor" >"$folder/bin/$tool"
done
for tool in ar ranlib; do printf '#!/bin/sh\nexec "%s/bin/python" -m ziglang %s "$@"\n' "$tools" "$tool" >"$folder/bin/$tool"; done
chmod +x "$folder"/bin/*
# Before CC is set: pip asks the sources for their name, by what it compiles for that.
"$tools/bin/pip" download --quiet --disable-pip-version-check --no-deps --no-binary pynacl --dest "$folder/made.of" "pynacl==$PYNACL_VERSION"
echo "$PYNACL_SHA256 $folder/made.of/pynacl-$PYNACL_VERSION.tar.gz" | sha256sum --quiet --check
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

sodium() {
    tar --extract --file "$folder/made.of/pynacl-$PYNACL_VERSION.tar.gz" --directory "$folder/made.of" --strip-components 2 "pynacl-$PYNACL_VERSION/src/libsodium"
    cd "$folder/made.of/sodium"
    run ../libsodium/configure --host="$processor-linux-gnu" --prefix="$folder" --disable-shared --disable-dependency-tracking --disable-pie
    run make -C src/libsodium --jobs "$jobs" install
    cp ../libsodium/LICENSE "$folder/licenses/libsodium"
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

# Without its CMake, whose questions to the compiler take longer than the library.
zmq() {
    local source name
    source=$(source_of zeromq-src)/vendor
    cd "$folder/made.of/zmq"
    for name in ZMQ_{USE_CV_IMPL_STL11,IOTHREAD_POLLER_USE_EPOLL,IOTHREAD_POLLER_USE_EPOLL_CLOEXEC,POLL_BASED_ON_POLL,USE_BUILTIN_SHA1} \
        ZMQ_HAVE_{LINUX,UIO,NOEXCEPT,EVENTFD,IFADDRS,SO_PEERCRED,IPC,CURVE} ZMQ_USE_LIBSODIUM \
        HAVE_{FORK,CLOCK_GETTIME,MKDTEMP,ACCEPT4,STRNLEN,IF_NAMETOINDEX}; do echo "#define $name 1"; done >platform.hpp
    echo "#define ZMQ_CACHELINE_SIZE 64" >>platform.hpp
    # One by one: of several files zig leaves the object of one.
    # shellcheck disable=SC2086
    find "$source/src" -name '*.cpp' ! -name 'ws_*' ! -name 'wss_*' -print0 | sort --zero-terminated | xargs --null --max-procs "$jobs" --max-args 1 \
        "$CXX" $CXXFLAGS -std=c++11 -DZMQ_STATIC -DSODIUM_STATIC -I. -I"$source/include" -I"$source/src" -I"$folder/include" -c >>"$folder/log" 2>&1 ||
        { tail -n 20 "$folder/log" >&2; exit 1; }
    run "$AR" crs "$folder/lib/libzmq.a" ./*.o
    cp "$source/COPYING.LESSER" "$folder/licenses/libzmq"
    cp "$source/COPYING" "$folder/licenses/libzmq.gpl"
}

(sodium)
(jpeg)
(zmq)
cp "$recipe" "$folder/made"
