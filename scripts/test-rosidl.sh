#!/usr/bin/env bash
# Typed Rust by message crates: builds wrapyfi_msgs with rosidl_generator_rs, examples/rosidl, which uses its crate beside
# wrapyfi_core, and test/rclrs, and runs them under each rmw of the ROS 2 that is sourced.
#
#   scripts/test-rosidl.sh [rmw_fastrtps_cpp ...]
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD

fail() {
    printf 'test-rosidl: %s\n' "$1" >&2
    exit 1
}

# The first prefix that has this below share/.
prefix_of() {
    local prefix IFS=:
    for prefix in ${AMENT_PREFIX_PATH:-}; do
        if [ -e "$prefix/share/$1" ]; then
            echo "$prefix"
            return
        fi
    done
}

for needed in rosidl_generator_rs/package.xml std_msgs/rust/Cargo.toml sensor_msgs/rust/Cargo.toml; do
    if [ -z "$(prefix_of "$needed")" ]; then
        echo "SKIPPED test-rosidl: no sourced ROS 2 has share/$needed: source a workspace with rosidl_rust and the common interfaces" >&2
        exit 0
    fi
done
if ! prefix=$(prefix_of rmw_implementation/package.xml) || [ -z "$prefix" ]; then fail "the sourced ROS 2 has no rmw_implementation"; fi

workspace=$root/target/rosidl
mkdir -p "$workspace/src"
touch "$root/target/COLCON_IGNORE"
rm -rf "$workspace/src" "$workspace/packages"
mkdir -p "$workspace/src" "$workspace/packages"
# With time stamps, so that a second run compiles nothing.
cp -a wrapyfi_msgs "$workspace/src/"
cd "$workspace"
colcon --log-base log build --base-paths src --event-handlers console_direct+ \
    --cmake-args -DBUILD_TESTING=OFF -DPython3_EXECUTABLE="${PYTHON3:-/usr/bin/python3}" >output.log 2>&1 ||
    { tail -n 40 output.log >&2; fail "wrapyfi_msgs does not build ($workspace/output.log)"; }
[ -f install/wrapyfi_msgs/share/wrapyfi_msgs/rust/Cargo.toml ] || fail "wrapyfi_msgs has no Rust crate"
set +u
# shellcheck disable=SC1091
. install/local_setup.sh
set -u

# As colcon-ros-cargo writes it: each crate that a prefix has, the overlay's first, and our own.
mkdir -p .cargo
{
    echo '[patch.crates-io]'
    {
        sed -n 's#^\(wrapyfi_[a-z0-9_]*\) = { path = "\([^"]*\)".*#\1 '"$root"'/\2#p' "$root/Cargo.toml"
        IFS=: read -ra prefixes <<<"$AMENT_PREFIX_PATH"
        for one in "${prefixes[@]}"; do
            for marker in "$one"/share/ament_index/resource_index/rust_packages/*; do
                name=${marker##*/}
                if [ -f "$one/share/$name/rust/Cargo.toml" ]; then echo "$name $one/share/$name/rust"; fi
            done
        done
    } | awk '!seen[$1]++ { printf "%s = { path = \"%s\" }\n", $1, $2 }'
} >.cargo/config.toml
for package in examples/rosidl test/rclrs; do
    cp -r "$root/$package" packages/
done
# The repository's profiles, so that what is compiled there serves here; its lock file, to which crates.io adds rclrs.
{
    printf '[workspace]\nresolver = "3"\nmembers = ["rosidl", "rclrs"]\n'
    sed -n '/^\[profile\./,$p' "$root/Cargo.toml"
} >packages/Cargo.toml
cp "$root/Cargo.lock" packages/
cargo build --quiet --manifest-path packages/Cargo.toml --target-dir "${CARGO_TARGET_DIR:-$root/target}" 2>>output.log ||
    { tail -n 40 output.log >&2; fail "the packages do not build"; }
programs=${CARGO_TARGET_DIR:-$root/target}/debug

# What the first one prints has this in it; both end.
pair() {
    local expected=$1 first=$2 second=$3 other found
    "$programs/tensors" "$second" >>output.log 2>&1 &
    other=$!
    found=$(timeout 60 "$programs/tensors" "$first" 2>>output.log | head -n 1) || true
    kill "$other" 2>/dev/null || true
    wait "$other" 2>/dev/null || true
    [[ $found == *"$expected"* ]] || fail "tensors $first printed '$found' instead of '$expected' ($RMW_IMPLEMENTATION)"
}

run() {
    export RMW_IMPLEMENTATION=$1 ROS_DOMAIN_ID=$((RANDOM % 100 + 1))
    pair "float64 [3], 24 bytes" listen publish
    pair "left_arm has three joints" call serve
    timeout 300 "$programs/wrapyfi_rclrs_peer" >peer.log 2>&1 || { tail -n 20 peer.log >&2; fail "rclrs and wrapyfi_core ($1)"; }
    echo "test-rosidl: $1: $(tail -n 1 peer.log)"
}

installed=("$@")
[ $# -gt 0 ] || for entry in "$prefix"/share/ament_index/resource_index/rmw_typesupport/rmw_*_cpp; do
    # Fast DDS twice, and Zenoh, whose nodes need a router.
    case ${entry##*/} in rmw_fastrtps_dynamic_cpp | rmw_zenoh_cpp) ;; *) installed+=("${entry##*/}") ;; esac
done
export programs
for rmw in "${installed[@]}"; do
    "$root/scripts/lo-namespace.sh" bash -euo pipefail -c "$(declare -f fail pair run); run $rmw"
done
