#!/usr/bin/env bash
# Builds, tests and installs the packages with colcon, as a user's workspace does, and uses what was
# installed. Works on plain Debian and Ubuntu and in a sourced ROS 2.
#
# PROFILE=colcon (as `make nightly` says) compiles as users do, and runs every test. Without it the foreign
# crates of the repository's own development build serve again, and of the tests, all of which `make test` has just
# run, only those of three crates are built, and of these one folder with whole programs and those beside the code are run.
set -euo pipefail
cd "$(dirname "$0")/.."
profile=${PROFILE:-dev}
source_folder=$PWD
workspace=$source_folder/target/colcon
log=$workspace/output.log
step="start"

fail() {
    printf 'colcon: %s\n' "$1" >&2
    exit 1
}
# What colcon said is of interest only when it went wrong.
trap '[ $? -eq 0 ] || { grep -E "^error|No space left" "$log" | head -n 20 >&2; tail -n 40 "$log" >&2; echo "colcon: failed while: $step (everything: $log)" >&2; }' EXIT

# Not by AMENT_PREFIX_PATH alone: a sourced workspace of Debian's colcon sets it too.
ros_is_sourced() {
    local prefix IFS=:
    for prefix in ${AMENT_PREFIX_PATH:-}; do
        if [ -d "$prefix/share/rosidl_default_generators" ]; then return 0; fi
    done
    return 1
}

mkdir -p "$workspace"
# This copy must not turn up beside the original when somebody runs colcon in the repository.
touch target/COLCON_IGNORE
: >"$log"
command -v colcon >/dev/null || fail "colcon is not installed. Run: scripts/setup.sh test"

step="copying the sources"
# A copy, so that nothing which lies about in a working tree can help; with time stamps, so that a
# second run compiles nothing.
rm -rf "$workspace/src"
mkdir -p "$workspace/src/wrapyfi_ros2"
if git rev-parse --is-inside-work-tree >/dev/null 2>&1; then
    # A file deleted but not yet committed is still listed.
    git ls-files -z --cached --others --exclude-standard |
        while IFS= read -r -d '' file; do
            if [ -e "$file" ] || [ -L "$file" ]; then printf '%s\0' "$file"; fi
        done | tar --null -T - -cf -
else
    tar --exclude=./target --exclude=./.venv --exclude=./build --exclude=./install --exclude=./log -cf - .
fi | tar -xf - -C "$workspace/src/wrapyfi_ros2"
cd "$workspace"
tree=$workspace/src/wrapyfi_ros2

step="colcon list"
packages=$'wrapyfi\nwrapyfi_bridge\nwrapyfi_core\nwrapyfi_msgs\nwrapyfi_py'
for place in "$workspace" "$tree"; do
    found=$(cd "$place" && colcon --log-base /dev/null list --names-only 2>>"$log" | sort)
    [ "$found" = "$packages" ] || fail "colcon list in $place names [${found//$'\n'/ }] instead of [${packages//$'\n'/ }]"
done

# colcon-cargo asks the Cargo workspace for its members, wherever they lie, and would build each in a folder of its own.
for member in $(sed -n '/^members = \[/,/^\]/p' "$tree/Cargo.toml" | grep -o '"[^"]*"' | tr -d '"'); do
    [ -e "$tree/$member/package.xml" ] || [ -e "$tree/$member/COLCON_IGNORE" ] ||
        fail "$member has neither package.xml nor COLCON_IGNORE: with colcon-cargo, colcon takes it for a package"
done

step="versions"
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' "$tree/Cargo.toml")
for package in $packages; do
    grep -qF "<version>$version</version>" "$tree/$package/package.xml" ||
        fail "$package/package.xml is not of version $version, the workspace's"
done

step="make build"
commands=$(make -C "$tree" -n build | grep 'cargo.* build ')
[[ $commands == *"--package wrapyfi_bridge"* && $commands != *--bin* ]] ||
    fail "make build does not build every program: $commands"

step="colcon build"
paths=(src)
if ! ros_is_sourced; then
    if [ ! -e /usr/share/ament_cmake/cmake/ament_cmakeConfig.cmake ]; then
        echo "colcon: NOT BUILT, only listed: this system has no ament_cmake." \
            "Source ROS 2 first: . /opt/ros/jazzy/setup.bash" >&2
        exit 0
    fi
    # Stand-ins for the message packages of ROS 2 that ours use. They are hidden from a normal build,
    # and a build on a real ROS 2 never sees them.
    stand_ins=("$tree"/test/debian_interfaces/*/)
    paths+=("${stand_ins[@]%/}")
fi
# As a user's machine without a network does it, once the crates are there.
(cd "$tree" && cargo fetch --quiet --locked) >>"$log" 2>&1
# What is built here would otherwise land in the folder of a developer's build.
built_before=${CARGO_TARGET_DIR:-$source_folder/target}/debug
unset CARGO_TARGET_DIR
if [ "$profile" = dev ] && [ -d "$built_before" ] && [ ! -e build/wrapyfi_cargo/debug ]; then
    mkdir -p build/wrapyfi_cargo
    cp -a --reflink=auto "$built_before" build/wrapyfi_cargo/debug
    # Ours are compiled from the copy: Cargo takes crates at the same place in another workspace for the same.
    rm -rf build/wrapyfi_cargo/debug/.fingerprint/wrapyfi_*
fi
if [ "$profile" = dev ]; then
    # What is tested here is the build, and unoptimised crates are compiled in a third of the time.
    mkdir -p .cargo
    sed -n 's/^name = "\(wrapyfi_.*\)"/[profile.dev.package.\1]\nopt-level = 0/p' "$tree/Cargo.lock" >.cargo/config.toml
    tested="wrapyfi_interfaces;wrapyfi_bridge;wrapyfi_e2e"
    export WRAPYFI_TESTS="kind(lib) or kind(bin) or test(/^bridge::/)"
fi
# A peer that is missing is a counted skip here; `make test` has run them all already.
unset WRAPYFI_REQUIRE_PEERS
# Python tells about it on standard error.
unset PYTHONDONTWRITEBYTECODE
"$tree/scripts/lo-namespace.sh" colcon build --base-paths "${paths[@]}" --event-handlers console_direct+ \
    --cmake-args --no-warn-unused-cli -DPython3_EXECUTABLE="${PYTHON3:-/usr/bin/python3}" -DWRAPYFI_CARGO_PROFILE="$profile" \
    -DWRAPYFI_TESTED_CRATES="${tested:-}" >>"$log" 2>&1
# colcon reports every such package, and users look for a fault.
for package in $packages; do
    [ ! -s "log/latest_build/$package/stderr.log" ] ||
        fail "building $package wrote to standard error: $(head -n 5 "log/latest_build/$package/stderr.log")"
done
grep -q '^CMAKE_BUILD_TYPE:.*=Release$' build/wrapyfi_msgs/CMakeCache.txt ||
    fail "wrapyfi_msgs is not optimised where colcon is started outside of the repository"

step="what is compiled without the tests"
for package in wrapyfi_core wrapyfi_bridge; do
    (
        set +u
        . install/local_setup.sh
        cmake -S "$tree/$package" -B "$workspace/untested/$package" -DBUILD_TESTING=OFF \
            -DPython3_EXECUTABLE="${PYTHON3:-/usr/bin/python3}"
    ) >>"$log" 2>&1 || fail "$package does not configure without tests"
    commands=$(grep -h 'cargo.* build ' -r "$workspace/untested/$package/CMakeFiles")
    [[ $commands == *--package=wrapyfi_bridge* && $commands != *--workspace* ]] ||
        fail "$package compiles more than it installs: $commands"
    [[ $commands != *wrapyfi_bridge/rmw* || -n ${ROS_DISTRO:-} ]] ||
        fail "$package is built with rmw where no ROS 2 is sourced: $commands"
done

step="the cargo of Ubuntu's package cargo-1.89, where the other is too old"
versioned=$workspace/versioned
mkdir -p "$versioned"
printf "#!/bin/sh\necho cargo 1.75.0\n" >"$versioned/cargo"
chmod +x "$versioned/cargo"
for tool in cargo rustc; do ln -sf "$(rustc --print sysroot)/bin/$tool" "$versioned/$tool-1.89"; done
(
    set +u
    . install/local_setup.sh
    env -u CARGO_HOME HOME=/nonexistent PATH="$versioned:/usr/bin:/bin" cmake -S "$tree/wrapyfi_bridge" \
        -B "$workspace/untested/versioned" -DBUILD_TESTING=OFF -DPython3_EXECUTABLE="${PYTHON3:-/usr/bin/python3}"
) >>"$log" 2>&1 || fail "wrapyfi_bridge does not configure with cargo-1.89"
commands=$(grep -h 'cargo.* build ' -r "$workspace/untested/versioned/CMakeFiles")
[[ $commands == *RUSTC=rustc-1.89*cargo-1.89\ build* ]] || fail "cargo-1.89 and rustc-1.89 are there and not used: $commands"

step="what is compiled where an rmw is sourced"
sourced=$workspace/sourced
rm -rf "$sourced" "$workspace"/untested/rmw-* # of the last run, with every library
mkdir -p "$sourced"/{include/rmw/rmw,lib}
touch "$sourced"/include/rmw/rmw/rmw.h "$sourced"/lib/libfastcdr.so
for choice in none one loader off; do
    option=
    case $choice in
    one) touch "$sourced/lib/librmw_fastrtps_cpp.so" ;; # as the wheels of Kilted have it
    loader) mv "$sourced"/lib/librmw_{fastrtps_cpp,implementation}.so ;;
    off) option=-DWRAPYFI_RMW=OFF ;;
    esac
    (
        set +u
        . install/local_setup.sh
        AMENT_PREFIX_PATH=$AMENT_PREFIX_PATH:$sourced cmake -S "$tree/wrapyfi_bridge" -B "$workspace/untested/rmw-$choice" \
            -DBUILD_TESTING=OFF -DPython3_EXECUTABLE="${PYTHON3:-/usr/bin/python3}" $option
    ) >>"$log" 2>&1 || fail "wrapyfi_bridge does not configure where an rmw is sourced ($choice)"
    commands=$(grep -h 'cargo.* build ' -r "$workspace/untested/rmw-$choice/CMakeFiles")
    case $choice:$commands in
    one:*WRAPYFI_RMW_PREFIX_PATH=*"$sourced"*--no-default-features*wrapyfi_bridge/rmw*) ;;
    loader:*WRAPYFI_RMW_PREFIX_PATH=*"$sourced"*--no-default-features*wrapyfi_bridge/rmw*) ;;
    off:*wrapyfi_bridge/rmw*) fail "-DWRAPYFI_RMW=OFF is built with rmw: $commands" ;;
    one:* | loader:*) fail "an rmw is sourced and not used ($choice): $commands" ;;
    none:*wrapyfi_bridge/rmw*) [ -n "${ROS_DISTRO:-}" ] || fail "there is no middleware, and rmw is built: $commands" ;;
    esac
done
[ -n "${ROS_DISTRO:-}" ] || grep -q 'CycloneDDS inside alone, because .*lib/librmw_implementation.so or lib/librmw_fastrtps_cpp.so' "$log" ||
    fail "no line says which library a build with rmw would need"

step="installed files"
core=$workspace/install/wrapyfi_core/share
bridge=$workspace/install/wrapyfi_bridge
for file in \
    install/wrapyfi_msgs/share/ament_index/resource_index/rosidl_interfaces/wrapyfi_msgs \
    install/wrapyfi_bridge/lib/wrapyfi_bridge/{bridge,ros1_bridge,yarp_bridge,zeromq_bridge,wrapyfi} \
    install/wrapyfi_bridge/bin/wrapyfi \
    install/wrapyfi_core/share/ament_index/resource_index/rust_packages/wrapyfi_{core,data,endpoint,engine,interfaces,macros,node,retry,rmw,ros1,ros2,yarp,yarp_endpoint,zeromq} \
    install/wrapyfi_core/share/wrapyfi_{core,data,endpoint,engine,interfaces,macros,node,retry,rmw,ros1,ros2,yarp,yarp_endpoint,zeromq}/rust/Cargo.toml \
    install/wrapyfi/share/wrapyfi/launch/{bridge,all_of}.launch.py \
    install/wrapyfi/share/wrapyfi/config/example.yaml; do
    [ -e "$file" ] || fail "$file was not installed"
done
for package in $packages; do
    [ -e "install/$package/share/ament_index/resource_index/packages/$package" ] ||
        fail "$package is not in the ament index: \`ros2 pkg\` would not find it"
done
for definition in "$tree"/wrapyfi_msgs/{msg/*.msg,srv/*.srv}; do
    cmp "$definition" "install/wrapyfi_msgs/share/${definition#"$tree"/}" >>"$log" 2>&1 ||
        fail "${definition##*/} was not installed as it is"
done
"$bridge/lib/wrapyfi_bridge/wrapyfi" --help >>"$log" 2>&1 || fail "the installed wrapyfi does not start"

step="wrapyfi_py of the sourced workspace"
# Outside of the folder in which the sources are.
found=$(bash -c 'set +u; . install/local_setup.sh && cd / && "$0" -c "import wrapyfi_py; print(wrapyfi_py.__file__)"' \
    "${PYTHON3:-/usr/bin/python3}" 2>>"$log") || true
[[ $found == "$workspace"/install/wrapyfi_py/* ]] || fail "wrapyfi_py is not on the path of Python (found: $found)"

step="sourcing the workspace"
found=$(bash -c 'set +u; . install/local_setup.sh && command -v wrapyfi' 2>>"$log") || true
[ "$found" = "$bridge/bin/wrapyfi" ] || fail "wrapyfi is not on PATH in a sourced workspace (found: $found)"

step="a foreign crate that depends on the installed one"
foreign=$workspace/foreign
rm -rf "$foreign"
mkdir -p "$foreign/src"
cat >"$foreign/Cargo.toml" <<TOML
[package]
name = "foreign"
version = "0.0.0"
edition = "2024"

[dependencies]
wrapyfi_core = { path = "$core/wrapyfi_core/rust", features = ["zeromq"] }
wrapyfi_interfaces = { path = "$core/wrapyfi_interfaces/rust" }

[workspace]
TOML
# The workspace's profiles, so that the crates compiled there serve here.
sed -n '/^\[profile\./,$p' "$tree/Cargo.toml" >>"$foreign/Cargo.toml"
cat >"$foreign/src/main.rs" <<'RUST'
use wrapyfi_core::communicator::communicator;

struct Probe;

// The macros must find the installed crate as well.
#[communicator]
impl Probe {
    #[register(NativeObject, "zeromq", "/probe")]
    fn limit(&self) -> usize {
        wrapyfi_core::Limits::default().message_bytes
    }
}

fn main() {
    println!("{}", Probe.communicator().limit().unwrap().unwrap());
}
RUST
cp "$tree/Cargo.lock" "$foreign/"
# The sources must not be able to help.
mv "$workspace/src" "$workspace/src.away"
(
    cd "$foreign"
    CARGO_TARGET_DIR=$workspace/build/wrapyfi_cargo \
        cargo run --quiet --profile "$profile"
) >"$workspace/foreign.out" 2>>"$log" || { mv "$workspace/src.away" "$workspace/src"; fail "the foreign crate does not build"; }
mv "$workspace/src.away" "$workspace/src"
[ "$(cat "$workspace/foreign.out")" = 67108864 ] || fail "the foreign crate says $(cat "$workspace/foreign.out")"

step="colcon test"
# Results of earlier runs would count.
rm -rf build/*/test_results build/*/Testing
# Sourced as `colcon test` wants it; without failing here, because the results say more.
"$tree/scripts/lo-namespace.sh" colcon test --base-paths "${paths[@]}" \
    --event-handlers console_direct+ >>"$log" 2>&1 || true
step="colcon test-result"
results=$(colcon --log-base /dev/null test-result --all --verbose 2>&1) || fail "tests failed:
$results"
printf '%s\n' "$results" >>"$log"
for result in wrapyfi_core/wrapyfi_interfaces wrapyfi_bridge/wrapyfi_bridge wrapyfi/wrapyfi_e2e; do
    file=build/${result%/*}/test_results/$result.xunit.xml
    [ -e "$file" ] || fail "colcon test wrote no $file"
done
grep -q 'name="test_objects_return_as_they_were"' build/wrapyfi_py/pytest.xml || fail "colcon test did not run wrapyfi_py's tests"
printf 'colcon: five packages built, installed and tested. %s\n' "$(tail -n 1 <<<"$results")"
