#!/usr/bin/env bash
# Runs a command in a network of its own that has only loopback, with multicast on it.
#
# DDS announces itself by multicast on every interface: without this, tests meet each other's
# participants, and those of other people on the network.
set -euo pipefail

if [ $# -eq 0 ]; then
    echo "usage: scripts/lo-namespace.sh COMMAND [ARGUMENT...]" >&2
    exit 2
fi

# Inside already: nothing to make.
if [ "${WRAPYFI_LO_NAMESPACE:-}" = 1 ]; then
    exec "$@"
fi

inside='ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo'
# Ports of the tests' DDS domains, up to 138, are not given to sockets that take any.
inside+=' && { echo 43000 60999 >/proc/sys/net/ipv4/ip_local_port_range || true; }'
# As root without a user namespace, so that files keep their owners; else as a mapped root.
for options in --net "--map-root-user --net"; do
    # shellcheck disable=SC2086
    if unshare $options sh -c "$inside" 2>/dev/null; then
        # shellcheck disable=SC2086
        exec unshare $options env WRAPYFI_LO_NAMESPACE=1 sh -c "$inside"' && exec "$@"' sh "$@"
    fi
done

echo "lo-namespace: no network namespace here (needs root or user namespaces, and iproute2): running on the host's network" >&2
exec "$@"
