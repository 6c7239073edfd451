#!/usr/bin/env bash
# Writes what a release has into target/package/release: the packages for this processor, the sources, the crates, the bill of
# materials, and SHA256SUMS.
#
#   packaging/release.sh                  of the commit that is checked out, with nothing changed
#   packaging/release.sh join FOLDER...   of what several machines have built: what is of no processor must be the same on all
set -euo pipefail
cd "$(dirname "$0")/.."
release=target/package/release

fail() {
    printf 'release: %s\n' "$1" >&2
    exit 1
}
sums() {
    (cd "$release" && sha256sum -- * >../SHA256SUMS && mv ../SHA256SUMS .)
}

build() {
    local changes version tag
    changes=$(git status --porcelain) || fail "git does not read this repository, above"
    [ -z "$changes" ] || fail "there are changes that are not committed: git status"
    version=$(cargo metadata --no-deps --locked --format-version 1 | "${PYTHON3:-/usr/bin/python3}" -c '
import json, sys
print(next(p for p in json.load(sys.stdin)["packages"] if p["name"] == "wrapyfi_bridge")["version"])')
    for tag in $(git tag --points-at HEAD); do
        [ "$tag" = "v$version" ] || fail "this commit has the tag $tag, and Cargo.toml the version $version"
    done
    # shellcheck source=packaging/environment.sh
    . packaging/environment.sh
    # Of an earlier commit.
    rm -f target/package/wrapyfi_{ros2,rs}-*.whl
    packaging/deb/build.sh
    # shellcheck disable=SC2086
    packaging/wheel/build.sh ${PROCESSORS:-}
    packaging/crates/build.sh
    rm -f target/package/ros-*-wrapyfi_*.deb
    if [ -n "${ROS_DISTRO:-}" ]; then packaging/deb/ros.sh; else echo "SKIPPED release of ros-DISTRIBUTION-wrapyfi: no ROS 2 is sourced" >&2; fi

    rm -rf "$release"
    mkdir -p "$release"
    cp target/package/*.deb target/package/wrapyfi_{ros2,rs}-*.whl "$release"
    git archive --format tar --prefix "wrapyfi-$version/" HEAD | gzip -9n >"$release/wrapyfi-$version.tar.gz"
    tar --create --sort name --mtime "@$SOURCE_DATE_EPOCH" --owner 0 --group 0 --numeric-owner --mode go=rX,u=rwX \
        --directory target/package/crates --transform "s:^:wrapyfi-$version-crates/:" \
        $(cd target/package/crates && ls -- *.crate) >"$release/wrapyfi-$version-crates.tar"
    scripts/licences.py --spdx "$release/wrapyfi-$version.spdx.json"
    sums
    cat "$release/SHA256SUMS"

    # Built all the same, so that whoever prepares a release sees it.
    git tag --points-at HEAD | grep -q . || echo "release: not to be published: this commit has no tag v$version" >&2
    if grep -qiE 'to.be.filled.in.at.release' Cargo.toml wrapyfi*/package.xml wrapyfi_bridge/Cargo.toml; then
        echo "release: not to be published: repository and maintainer are to be filled in (docs/releasing.md)" >&2
    fi
}

join() {
    local folder file
    rm -rf "$release"
    mkdir -p "$release"
    for folder in "$@"; do (cd "$folder" && sha256sum --quiet --check SHA256SUMS) || fail "$folder is damaged"; done
    # shellcheck disable=SC2044 # no name of ours has a space
    for file in $(find "$@" -type f ! -name SHA256SUMS); do
        [ ! -e "$release/${file##*/}" ] || cmp "$file" "$release/${file##*/}" || fail "${file##*/} differs between the machines that built it"
        cp "$file" "$release"
    done
    sums
}

case ${1:-build} in
build) build ;;
join) shift && join "$@" ;;
*) fail "usage: packaging/release.sh [join FOLDER...]" ;;
esac
