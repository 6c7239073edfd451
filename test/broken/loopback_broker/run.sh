#!/usr/bin/env bash
# A broker runs on the other machine, and only that machine reaches it.
source "$(dirname "$0")/../common.sh"
other_host
start broker nsenter "--net=/proc/$other/ns/net" "$wrapyfi" broker
until_said broker "listeners connect to port"
why camera "$@"
