#!/usr/bin/env bash
# A port of the other machine tells everybody 127.0.0.1.
source "$(dirname "$0")/../common.sh"
other_host
echo "10.77.0.2 10000 yarp" >"$scratch/yarp.conf"
start server nsenter "--net=/proc/$other/ns/net" "$wrapyfi" yarpserver --ip 10.77.0.2 --insecure --no-discovery
until_said server "name server /root on"
start cam nsenter "--net=/proc/$other/ns/net" "$wrapyfi" --log-level debug pub yarp:/cam --ip 127.0.0.1 \
    --type NativeObject --value '{"n": 1}'
for _ in $(seq 200); do
    on_other "$wrapyfi" list yarp 2>/dev/null | grep -q " /cam " && break
    sleep 0.1
done
why camera "$@"
