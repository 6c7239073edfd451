#!/usr/bin/env bash
# Installs what others shall install into a new Debian 12 without compilers, runs the demo there, removes it, and
# looks for what it left. Needs root, debootstrap and a network; says SKIPPED and why where one is missing.
#
#   packaging/test.sh deb FILE         a Debian package
#   packaging/test.sh wheel FILE FILE  wheels of the program and of the library for Python, by pip into a virtual environment
#   packaging/test.sh container FILE   a Debian package by the last stage of the Dockerfile, step by step
#   packaging/test.sh ros FILE         the packages of ROS 2, beside the ROS 2 of this system: what it changes is laid over it and gone after
#
# SUITE=noble takes Ubuntu 24.04 for it. What is for another processor runs under qemu: apt-get install qemu-user-static.
set -euo pipefail
here=$(cd "$(dirname "$0")/.." && pwd)
usage="usage: packaging/test.sh deb|wheel|container|ros FILE..."
kind=${1:-} file=$(realpath "${2:?$usage}") library=$(realpath "${3:-/}")

fail() {
    printf 'package %s: %s\n' "$kind" "$1" >&2
    exit 1
}
skip() {
    printf 'SKIPPED package %s: %s\n' "$kind" "$1" >&2
    exit 0
}

[ "$(id -u)" = 0 ] || skip "a new system is made by root only"
unshare --mount --pid --fork true 2>/dev/null || skip "no namespaces of mounts and processes here"
case $file in
*aarch64.whl | *_arm64.deb) processor=aarch64 architecture=arm64 ;;
*) processor=x86_64 architecture=amd64 ;;
esac
[ "$processor" = "$(uname -m)" ] || [ -e "/proc/sys/fs/binfmt_misc/qemu-$processor" ] ||
    skip "this machine runs nothing for $processor. Run: apt-get install qemu-user-static"

root=$(mktemp -d "${TMPDIR:-/var/tmp}/wrapyfi-root.XXXXXX")
chmod 755 "$root"
# What is mounted below it is so in namespaces that have ended.
trap 'rm -rf --one-file-system "$root"' EXIT
if [ "$kind" != ros ]; then
    command -v debootstrap >/dev/null || skip "there is no debootstrap. Run: apt-get install debootstrap"
    # All Ubuntus are made by one script, and Debian 12 knows few of them by name.
    system=("${SUITE:=bookworm}" "$root")
    case $SUITE-$architecture in
    noble-amd64) system=(--components "main,universe" "${system[@]}" http://archive.ubuntu.com/ubuntu gutsy) ;;
    noble-*) system=(--components "main,universe" "${system[@]}" http://ports.ubuntu.com/ubuntu-ports gutsy) ;;
    esac
    debootstrap --variant=minbase --arch "$architecture" "${system[@]}" >"$root.log" 2>&1 || { tail -n 20 "$root.log" >&2; fail "debootstrap failed"; }
    rm "$root.log"
    # As every installed system has it, and every container.
    echo "127.0.0.1 localhost" >"$root/etc/hosts"
fi

# qemu knows no IP_MULTICAST_IF, without which CycloneDDS does not start.
variables=()
[ "$processor" = "$(uname -m)" ] || variables=("CYCLONEDDS_URI=<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast></General><Discovery>\
<ParticipantIndex>auto</ParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>")
# Runs a command in the new system; whatever it started ends with it.
inside() {
    # shellcheck disable=SC2016
    unshare --mount --pid --fork --kill-child sh -c '
        mount -t proc proc "$0/proc" && exec chroot "$0" /usr/bin/env -i HOME=/root LC_ALL=C.UTF-8 \
            PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive "$@"' "$root" "${variables[@]}" "$@"
}
apt() {
    inside apt-get -qq -o Dpkg::Use-Pty=0 -y "$@" >"$root/tmp/apt.log" 2>&1 || { cat "$root/tmp/apt.log" >&2; fail "apt-get $*"; }
}
# Files of the new system, less what packages of any kind change.
files() {
    (cd "$root" && find . -xdev \( -path ./proc -o -path ./tmp -o -path ./var/cache -o -path ./var/lib/apt -o -path ./var/lib/dpkg \
        -o -path ./var/log \) -prune -o -print | sort)
}
# Runs a command in the new system, in a network of its own.
alone() {
    WRAPYFI_LO_NAMESPACE='' "$here/scripts/lo-namespace.sh" bash -c "$(declare -f inside); $(declare -p root variables); inside "'"$@"' _ "$@"
}
# A bridge of one route that waits is small, once what its start took has gone back.
rests() {
    echo 'routes: [{ from: "zeromq:/camera", to: "ros2:/camera", type: Image }]' >"$root/tmp/one.yaml"
    # qemu is a part of what it starts.
    [ "$processor" = "$(uname -m)" ] || return 0
    # shellcheck disable=SC2016
    alone sh -c '
        "$@" bridge --config /tmp/one.yaml 2>/tmp/rests.log & bridge=$!
        size=none
        for _ in $(seq 300); do
            sleep 0.1
            grep -q waiting /tmp/rests.log || continue
            size=$(sed -n "s/^VmRSS:[^0-9]*\([0-9]*\) kB/\1/p" /proc/$bridge/status)
            [ "$size" -gt $((25 * 1024)) ] || exit 0
        done
        echo "a bridge at rest has $size KiB"; exit 1' _ "$@" >"$root/tmp/rests" || fail "$(cat "$root/tmp/rests" "$root/tmp/rests.log")"
}
# As a reader does it: the program is small, answers, and everything in the demo arrives.
use() {
    ! inside sh -c 'command -v cc || command -v cargo' || fail "there are compilers, which a reader may lack"
    local program
    program=$root/$(inside sh -c "command -v ${*: -1}")
    ! grep -qF -e "$here/" -e "${CARGO_HOME:-$HOME/.cargo}/" -e "$(rustc --print sysroot)/" "$program" || fail "the program has paths of the machine that built it"
    # The one with libjpeg-turbo inside is to be small as a file that is loaded down.
    [ "$kind" != wheel ] || program=$file
    [ "$(stat -Lc %s "$program")" -le $((20 * 1024 * 1024)) ] || fail "$program is of $(stat -Lc %s "$program") bytes"
    local version
    version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' "$here/Cargo.toml")
    [ "$(inside "$@" --version)" = "wrapyfi $version" ] || fail "$* --version does not say wrapyfi $version"
    alone "$@" demo --seconds 10 >"$root/tmp/demo.log" 2>&1 || { tail -n 30 "$root/tmp/demo.log" >&2; fail "$* demo --seconds 10"; }
}

# What the package's scripts call of a systemd under which the bridges `robot` and `old` run.
stand_in_for_systemd() {
    local to=$root/usr/bin # of the search path of apt
    mkdir -p "$root/run/systemd/system"
    cat >"$to/systemctl" <<'END'
#!/bin/sh
echo "$@" >>/tmp/systemctl.log
[ "$1" != list-units ] || printf 'wrapyfi-bridge@%s.service loaded active running x\n' robot old
END
    cat >"$to/systemd-run" <<'END'
#!/bin/sh
while [ "${1#--}" != "$1" ]; do shift; done
exec "$@"
END
    cat >"$to/systemd-escape" <<'END'
#!/bin/sh
echo "${3#*@}" | sed 's/\.service$//'
END
    chmod +x "$to"/system*
}

deb() {
    apt update
    files >"$root/tmp/before"
    cp "$file" "$root/tmp/wrapyfi.deb"
    apt install --no-install-recommends /tmp/wrapyfi.deb
    use wrapyfi
    rests wrapyfi
    local name
    for name in ros1_bridge yarp_bridge zeromq_bridge /usr/lib/wrapyfi_bridge/bridge; do
        inside "$name" --help | grep -q -- '--ros-args' || fail "$name --help is not that of a node"
    done
    inside wrapyfi check /usr/share/wrapyfi/config/example.yaml >/dev/null || fail "the installed example has faults"
    inside gzip --test /usr/share/man/man1/wrapyfi-demo.1.gz || fail "a manual page is broken"
    inside gzip --test /usr/share/doc/wrapyfi/licenses-of-crates.txt.gz || fail "the licences of the crates are missing"
    inside bash -c '. /usr/share/bash-completion/completions/wrapyfi && complete -p wrapyfi' >/dev/null || fail "bash completes nothing"
    if command -v systemd-analyze >/dev/null; then
        # With a program that this system has.
        sed -i s:/usr/bin/wrapyfi:/bin/true: "$root"/usr/lib/systemd/system/wrapyfi-*.service
        systemd-analyze verify --man=no "$root"/usr/lib/systemd/system/wrapyfi-*.service || fail "a unit has faults"
    fi

    # Over an older one: what runs goes on with the new program, unless that refuses its configuration.
    mkdir "$root/etc/wrapyfi"
    echo 'routes: [{ from: "zeromq:/camera", to: "ros2:/camera", type: Image }]' | tee "$root/etc/wrapyfi/robot.yaml" >"$root/tmp/robot.yaml"
    sed s/from:/source:/ "$root/tmp/robot.yaml" >"$root/etc/wrapyfi/old.yaml"
    stand_in_for_systemd
    apt install --reinstall /tmp/wrapyfi.deb
    grep -qx 'try-restart wrapyfi-bridge@robot.service' "$root/tmp/systemctl.log" || fail "a bridge that runs is not restarted"
    ! grep -q 'restart.*old' "$root/tmp/systemctl.log" || fail "a bridge is restarted with a configuration that the new program refuses"
    grep -q 'wrapyfi-bridge@old.service is not restarted.*mend /etc/wrapyfi/old.yaml' "$root/tmp/apt.log" || fail "no line says which bridge was not restarted"
    grep -q 'old.yaml:1:.*unknown key `source`' "$root/tmp/apt.log" || fail "no line says what is wrong in the older configuration"
    rm -r "$root/run/systemd" "$root"/usr/bin/system*

    # And away again: what its owner wrote stays, everything else goes.
    mkdir -p "$root/etc/systemd/system/multi-user.target.wants"
    ln -s /usr/lib/systemd/system/wrapyfi-bridge@.service "$root/etc/systemd/system/multi-user.target.wants/wrapyfi-bridge@robot.service"
    apt purge --autoremove wrapyfi
    cmp "$root/etc/wrapyfi/robot.yaml" "$root/tmp/robot.yaml" || fail "a configuration of its owner is gone"
    rm -r "$root/etc/wrapyfi"
    files | diff "$root/tmp/before" - >"$root/tmp/left" || { cat "$root/tmp/left" >&2; fail "removal left something, above"; }
}

wheel() {
    apt update
    apt install --no-install-recommends pipx python3-venv python3-numpy python3-yaml
    files >"$root/tmp/before"
    cp "$file" "$library" "$here/packaging/wheel/camera.py" "$root/tmp/"
    local wheel
    wheel=/tmp/$(basename "$file")
    inside python3 -m venv --system-site-packages /opt/wrapyfi
    (cd "$root/opt/wrapyfi" && find . | sort) >"$root/tmp/venv"
    # Without a network.
    alone /opt/wrapyfi/bin/pip install --quiet --no-index "$wheel" "/tmp/$(basename "$library")" || fail "pip install"
    use /opt/wrapyfi/bin/wrapyfi
    rests /opt/wrapyfi/bin/wrapyfi
    camera
    # Over an installation that runs: a bridge goes on as it is, and answers what comes after it.
    # shellcheck disable=SC2016
    alone sh -ec '
        PATH=/opt/wrapyfi/bin:$PATH
        wrapyfi bridge --config /tmp/one.yaml 2>/tmp/over.log & bridge=$!
        pip install --quiet --no-index --no-deps --force-reinstall "$0"
        timeout 60 sh -c "until wrapyfi top --once | grep zeromq:/camera; do sleep 0.1; done"
        kill $bridge && wait $bridge' "$wheel" >"$root/tmp/over" 2>&1 || { cat "$root/tmp/over" "$root/tmp/over.log" >&2; fail "an installation over a bridge that runs"; }
    inside pipx run --spec "$wheel" wrapyfi-ros2 --version >"$root/tmp/pipx.log" 2>&1 || { cat "$root/tmp/pipx.log" >&2; fail "pipx run"; }
    rm -rf "$root"/root/.{cache,local}
    local platform
    for platform in manylinux_2_17_x86_64 manylinux_2_17_aarch64 musllinux_1_2_x86_64 manylinux_2_36_armv7l; do
        ! inside /opt/wrapyfi/bin/pip download --quiet --no-index --no-deps --only-binary=:all: --platform "$platform" --dest /tmp/none \
            "$wheel" 2>"$root/tmp/pip.log" || fail "pip installs it on $platform"
        grep -q 'is not a supported wheel on this platform' "$root/tmp/pip.log" || fail "pip does not say why it refuses $platform"
    done
    inside /opt/wrapyfi/bin/pip uninstall --quiet --yes wrapyfi-ros2 wrapyfi-rs
    (cd "$root/opt/wrapyfi" && find . | sort) | diff "$root/tmp/venv" - || fail "removal left something, above"
    rm -r "$root/opt/wrapyfi"
    files | diff "$root/tmp/before" - >"$root/tmp/left" || { cat "$root/tmp/left" >&2; fail "removal left something, above"; }
}
# A script of Wrapyfi's, on the library in its place: it is heard by another one and by the program, on ZeroMQ and on ROS 2.
camera() {
    find "$root/opt/wrapyfi" -path '*/wrapyfi_rs/_messages/reading.py' -type f | grep -q . || fail "the library lacks its package of messages"
    local middleware
    for middleware in zeromq ros2; do
        # shellcheck disable=SC2016
        alone sh -ec '
            PATH=/opt/wrapyfi/bin:$PATH
            python -m wrapyfi_rs /tmp/camera.py publish "$0" &
            timeout 60 python -m wrapyfi_rs /tmp/camera.py listen "$0"
            wrapyfi echo "$0:/camera" --type Image --count 1 --timeout 30' "$middleware" >"$root/tmp/camera.log" 2>&1 ||
            { tail -n 30 "$root/tmp/camera.log" >&2; fail "a camera on $middleware"; }
    done
}

container() {
    local line user=root
    while IFS= read -r line; do
        case $line in
        "COPY --from=build /source/target/package/wrapyfi_*.deb /tmp/") cp "$file" "$root/tmp/" ;;
        "RUN "*) inside sh -ec "${line#RUN }" >"$root/tmp/step.log" 2>&1 || { tail -n 20 "$root/tmp/step.log" >&2; fail "$line"; } ;;
        "USER "*) user=${line#USER } ;;
        'ENTRYPOINT ["wrapyfi"]' | "FROM "* | "CMD "* | "") ;;
        *) fail "the Dockerfile has a step that this test does not take: $line" ;;
        esac
    done < <(sed -n '/^FROM debian/,$p' "$here/packaging/container/Dockerfile")
    local as=(setpriv --reuid "$user" --regid nogroup --clear-groups)
    use "${as[@]}" wrapyfi
    # And what the compose file starts in it, both at once.
    mkdir "$root/etc/wrapyfi"
    echo 'routes: [{ from: "zeromq:/camera", to: "ros2:/camera", type: Image }]' >"$root/etc/wrapyfi/bridge.yaml"
    local commands
    commands=$(sed -n 's/^ *command: \[\(.*\)\]$/\1/p' "$here/packaging/container/compose.yaml" | tr -d ,)
    [ "$(wc -l <<<"$commands")" = 2 ] || fail "compose.yaml has other commands than those of a bridge and a broker"
    # shellcheck disable=SC2016
    alone "${as[@]}" sh -ec '
        echo "$0" | while read -r line; do wrapyfi $line & done
        timeout 60 sh -c "until wrapyfi top --once | grep zeromq:/camera; do sleep 0.1; done"' "$commands" >"$root/tmp/compose.log" 2>&1 ||
        { tail -n 30 "$root/tmp/compose.log" >&2; fail "the services of compose.yaml"; }
}

# A topic of ZeroMQ goes through the installed node to `ros2 topic echo`, on Fast DDS.
ros() {
    local package distribution
    package=$(dpkg-deb --field "$file" Package)
    distribution=${package#ros-} distribution=${distribution%-wrapyfi}
    [ -f "/opt/ros/$distribution/setup.bash" ] || skip "there is no ROS 2 in /opt/ros/$distribution"
    ! dpkg --status "$package" >/dev/null 2>&1 || skip "$package is installed here. Run: apt-get remove $package"
    WRAPYFI_LO_NAMESPACE='' unshare --mount --pid --fork --mount-proc --kill-child "$here/scripts/lo-namespace.sh" bash -euo pipefail -c \
        "$(declare -f fail beside); kind=ros file=$file root=$root; beside $package $distribution"
}
beside() {
    local package=$1 prefix=/opt/ros/$2 folder layer force=()
    mkdir "$root/layers"
    mount -t tmpfs tmpfs "$root/layers"
    for folder in "$prefix" /usr /var/lib/dpkg; do
        layer=$root/layers/${folder//\//-}
        mkdir -p "$layer"/{upper,work}
        mount -t overlay overlay -o "lowerdir=$folder,upperdir=$layer/upper,workdir=$layer/work" "$folder"
    done
    # Other packages' bytecode is no business of ours.
    files() { find "$prefix" /usr \( -path '*wrapyfi*' -o -not -path '*/__pycache__*' \) | sort; }
    files >"$root/before"
    # A ROS 2 that was compiled here is none of dpkg's.
    dpkg --status "ros-$2-rmw-implementation" >/dev/null 2>&1 || force=(--force-depends)
    dpkg --log=/dev/null "${force[@]}" --install "$file" >"$root/dpkg.log" 2>&1 || { cat "$root/dpkg.log" >&2; fail "dpkg --install"; }

    export ROS_HOME=$root/home ROS_DOMAIN_ID=87 RMW_IMPLEMENTATION=rmw_fastrtps_cpp
    set +u
    # shellcheck disable=SC1091
    . "$prefix/setup.bash"
    set -u
    [ "$(command -v wrapyfi)" = "$prefix/bin/wrapyfi" ] || fail "wrapyfi is not on PATH where ROS 2 is sourced"
    local node
    for node in bridge ros1_bridge yarp_bridge zeromq_bridge; do
        ros2 run wrapyfi_bridge "$node" --help | grep -- --ros-args >/dev/null || fail "ros2 run wrapyfi_bridge $node --help"
    done
    ros2 interface show wrapyfi_msgs/msg/Tensor | grep -x 'uint8\[\] data' >/dev/null || fail "ros2 interface show wrapyfi_msgs/msg/Tensor"
    ros2 launch wrapyfi bridge.launch.py --show-args >/dev/null || fail "ros2 launch wrapyfi bridge.launch.py"
    ros2 wrapyfi --help >/dev/null || fail "ros2 wrapyfi --help"
    echo 'routes: [{ from: "zeromq:/text", to: "ros2:/text", type: NativeObject }]' >"$root/text.yaml"
    ros2 run wrapyfi_bridge bridge --config "$root/text.yaml" >"$root/bridge.log" 2>&1 &
    wrapyfi pub zeromq:/text --type NativeObject --value '"through it"' --rate 10 >"$root/pub.log" 2>&1 &
    timeout 60 ros2 topic echo --no-daemon --once /text wrapyfi_msgs/msg/NativeObject >"$root/echo.log" 2>&1 || true
    grep -q 'through it' "$root/echo.log" || { tail -n 20 "$root"/{echo,pub,bridge}.log >&2; fail "nothing comes from ZeroMQ"; }
    kill %1 %2

    dpkg --log=/dev/null --purge "$package" >"$root/dpkg.log" 2>&1 || { cat "$root/dpkg.log" >&2; fail "dpkg --purge"; }
    files | diff "$root/before" - >&2 || fail "removal left something, above"
}

case $kind in
deb | wheel | container | ros) "$kind" ;;
*) fail "$usage" ;;
esac
for each in "${@:2}"; do echo "package $kind: installed, used and removed: $(basename "$each"), $(du -m "$each" | cut -f1) MB"; done
