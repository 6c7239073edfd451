# Sourced by each run.sh: a network of its own that has loopback only, programs that end with the script.
#
#   test/broken/wrong_topic/run.sh [--json]     makes the situation, and asks `wrapyfi why` about it
#
# WRAPYFI_BIN, WRAPYFI_PYTHON and WRAPYFI_FAST_PEER say where the programs are; by default the release build,
# .venv and none. The exit code is that of `wrapyfi why`.
set -euo pipefail

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../../.." && pwd)
if [ "${WRAPYFI_BROKEN:-}" != 1 ]; then
    exec env -u WRAPYFI_LO_NAMESPACE WRAPYFI_BROKEN=1 "$root/scripts/lo-namespace.sh" "$0" "$@"
fi

wrapyfi=${WRAPYFI_BIN:-$root/target/release/wrapyfi}
python=${WRAPYFI_PYTHON:-$root/.venv/bin/python}
config=$here/bridge.yaml
peers=$root/test/peers
scratch=$(mktemp -d)
started=()

# The environment of a user who has set nothing, and loopback as the only network.
for variable in $(compgen -e | grep -E '^(ROS_|RMW_|YARP_|WRAPYFI_ZEROMQ_|WRAPYFI_YARP_|WRAPYFI_ROS_|AMENT_)' || true); do
    unset "$variable"
done
export ROS_DOMAIN_ID=10 ROS_HOME=$scratch ROS_LOG_DIR=$scratch YARP_CONFIG_HOME=$scratch NO_COLOR=1
export PYTHONDONTWRITEBYTECODE=1 PYTHONUTF8=1
export CYCLONEDDS_URI='<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface name="lo"/></Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>'

# Peers leave when their standard input ends.
mkfifo "$scratch/stdin"
exec 9<>"$scratch/stdin"

end() {
    for pid in "${started[@]}"; do
        kill -KILL "$pid" 2>/dev/null || true
    done
    rm -rf "$scratch"
}
trap end EXIT

# start LOG PROGRAM...: runs a program beside the script, its output in a file.
start() {
    local log=$scratch/$1
    shift
    "$@" <&9 >"$log" 2>&1 &
    started+=("$!")
    # The shell is silent about its end.
    disown
}

# until_said LOG WORDS: waits until a program has said something.
until_said() {
    for _ in $(seq 600); do
        grep -q -- "$2" "$scratch/$1" 2>/dev/null && return
        sleep 0.1
    done
    echo "$1 did not say \"$2\":" >&2
    cat "$scratch/$1" >&2
    exit 70
}

# publisher LOG ARGUMENTS...: a DDS program on CycloneDDS, with the names and types of ROS 2.
publisher() {
    local log=$1
    shift
    start "$log" "$python" "$peers/cyclone_peer.py" publish "$@"
    until_said "$log" ready
}

# other_host: a second machine at 10.77.0.2, joined to this one at 10.77.0.1; on_other runs programs there.
other_host() {
    start other unshare --net sleep infinity
    other=${started[-1]}
    # It has its own network once its namespace is another.
    for _ in $(seq 100); do
        [ "$(readlink "/proc/$other/ns/net")" != "$(readlink /proc/self/ns/net)" ] && break
        sleep 0.05
    done
    ip link add v0 type veth peer name v1 netns "$other"
    ip addr add 10.77.0.1/24 dev v0
    ip link set v0 up
    on_other ip addr add 10.77.0.2/24 dev v1
    on_other ip link set v1 up
    on_other ip link set lo up
}

on_other() {
    nsenter "--net=/proc/$other/ns/net" "$@"
}

# why NAME [--json]: asks, with the configuration beside the script.
why() {
    local code=0
    "$wrapyfi" why "$@" --config "$config" || code=$?
    exit "$code"
}
