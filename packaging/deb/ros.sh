#!/usr/bin/env bash
# Writes target/package/ros-DISTRIBUTION-wrapyfi_VERSION_ARCHITECTURE.deb, the five colcon packages for /opt/ros/DISTRIBUTION with
# programs that speak through its rmw, and prints its name. For the ROS 2 that is sourced, on the system that it runs on.
# PROFILE=dev packs the development build: quick, to try a change of what is packed.
set -euo pipefail
cd "$(dirname "$0")/../.."

fail() {
    printf 'package-ros: %s\n' "$1" >&2
    exit 1
}
prefix=/opt/ros/${ROS_DISTRO:-}
[ -n "${ROS_DISTRO:-}" ] || fail "no ROS 2 is sourced. Run: . /opt/ros/jazzy/setup.bash"
[ -f "$prefix/include/rmw/rmw/rmw.h" ] || fail "$prefix has no rmw. Run: sudo apt install ros-$ROS_DISTRO-ros-base"
# What is built would need what lies in another workspace, and dpkg knows of none.
[ "${AMENT_PREFIX_PATH:-}" = "$prefix" ] || fail "more than $prefix is sourced: ${AMENT_PREFIX_PATH:-}. In a new shell, run: . $prefix/setup.bash"
command -v colcon >/dev/null || fail "there is no colcon. Run: sudo apt install colcon"
# shellcheck source=packaging/environment.sh
. packaging/environment.sh

packages=(wrapyfi wrapyfi_msgs wrapyfi_core wrapyfi_bridge wrapyfi_py)
python=${PYTHON3:-/usr/bin/python3}
name=ros-${ROS_DISTRO}-wrapyfi
architecture=$(dpkg --print-architecture)
version=$(sed -n 's:.*<version>\(.*\)</version>.*:\1:p' wrapyfi/package.xml)
made=$PWD/target/package/made-ros
root=$made/root
rm -rf "$made"
mkdir -p "$root$prefix" "$made/debian" "$root/DEBIAN"

export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target}
colcon --log-base "$made/log" build --base-paths . --packages-select "${packages[@]}" --merge-install \
    --build-base "$made/build" --install-base "$root$prefix" --event-handlers console_direct- --cmake-args --no-warn-unused-cli \
    -DBUILD_TESTING=OFF -DCMAKE_BUILD_TYPE=Release -DPython3_EXECUTABLE="$python" -DWRAPYFI_RMW=ON \
    -DWRAPYFI_CARGO_PROFILE="${PROFILE:-dist}" >"$made/colcon.log" 2>&1 || { tail -n 50 "$made/colcon.log" >&2; fail "colcon build"; }

# What colcon adds for a workspace. ROS's own setup files read what ament writes.
find "$root$prefix" -maxdepth 1 -not -type d -delete
rm -rf "$root$prefix"/share/{colcon-core,wrapyfi*/{hook,package.{bash,dsv,ps1,sh,zsh}}}
# Where it was installed to, to where it will be.
find "$root$prefix" -type f \( -name local_setup.sh -o -path '*/parent_prefix_path/*' \) -exec sed -i "s:$root$prefix:$prefix:g" {} +
find "$root" -name '*.so*' -type f -exec strip --strip-unneeded {} +
# Python writes none of its own then, which would stay where the package goes. By what they are made of, not by date.
find "$root" -name __pycache__ -prune -exec rm -r {} +
"$python" -m compileall -q --invalidation-mode unchecked-hash -s "$root" -p / "$root"

doc=$root/usr/share/doc/$name
mkdir -p "$doc"
cp LICENSE-* CHANGELOG.md THIRD_PARTY.md "$doc"
{ echo "Under LICENSE-APACHE or LICENSE-MIT beside this file, as you choose. Of what is inside: THIRD_PARTY.md." && cat LICENSE-MIT; } >"$doc/copyright"
scripts/licences.py --texts "$doc/licenses-of-crates.txt"
gzip -9n "$doc/licenses-of-crates.txt"

# Packages of ROS by the keys of package.xml and what wrapyfi_rmw links; of the system's libraries dpkg-shlibdeps says which.
depends=
for key in rmw_implementation rmw rcutils fastcdr $(sed -nE 's:.*<(exec_)?depend>(.*)</.*:\2:p' wrapyfi*/package.xml | sort -u); do
    case $key in
    wrapyfi*) ;;
    python3-*) depends+=", $key" ;;
    *) [ ! -d "$prefix/share/$key" ] || depends+=", ros-$ROS_DISTRO-${key//_/-}" ;;
    esac
done
printf 'Source: %s\n\nPackage: %s\nArchitecture: any\n' "$name" "$name" >"$made/debian/control"
mapfile -t programs < <(find "$root$prefix/lib" -type f \( -name '*.so*' -o -name wrapyfi \))
system=$(cd "$made" && dpkg-shlibdeps -O --ignore-missing-info -l"$prefix/lib" -l"$root$prefix/lib" "${programs[@]}" 2>shlibdeps.log) ||
    { cat "$made/shlibdeps.log" >&2; fail "dpkg-shlibdeps"; }
split="ros-$ROS_DISTRO-wrapyfi-msgs, ros-$ROS_DISTRO-wrapyfi-core, ros-$ROS_DISTRO-wrapyfi-bridge, ros-$ROS_DISTRO-wrapyfi-py"
cat >"$root/DEBIAN/control" <<END
Package: $name
Version: $version
Architecture: $architecture
Maintainer: $(sed -nE 's:.*<maintainer email="(.*)">(.*)</.*:\2 <\1>:p' wrapyfi/package.xml)
Installed-Size: $(du -sk --apparent-size "$root" | cut -f1)
Depends: ${system#shlibs:Depends=}$depends
Provides: $split
Conflicts: $split
Replaces: $split
Section: science
Priority: optional
Description: Wrapyfi for ROS 2, as packages of ROS 2 $ROS_DISTRO
 The bridge between Wrapyfi's scripts on ZeroMQ, YARP, ROS 1 and ROS 2, its messages, its launch files,
 its library for Rust and its messages for Python. Programs speak through the rmw that RMW_IMPLEMENTATION names.
END
(cd "$root" && find opt usr -type f -print0 | LC_ALL=C sort -z | xargs -0 md5sum >DEBIAN/md5sums)

chmod -R u=rwX,go=rX "$root"
[ "${PROFILE:-dist}" != dist ] || ! grep -rlF -e "$PWD/" -e "${CARGO_HOME:-$HOME/.cargo}/" "$root" >&2 || fail "paths of this machine are in the files above"
find "$root" -exec touch --no-dereference --date "@$SOURCE_DATE_EPOCH" {} +
rm -f target/package/ros-*-wrapyfi_*.deb
dpkg-deb --root-owner-group --build "$root" "target/package/${name}_${version}_$architecture.deb" >/dev/null
ls "target/package/${name}_${version}_$architecture.deb"
