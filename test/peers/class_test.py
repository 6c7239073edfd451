"""The class of Wrapyfi's own tests, `wrapyfi.tests.tools.class_test`, in its scenario.

    class_test.py --mode publish|listen [--mware zeromq]

Wrapyfi's test of publishing takes the first poll of its listener for a message, and so fails by itself where the
publisher is a moment late; this one goes on until there is one. Lines on stdout: {"event": "message", "value"}, the
object with its set in order.
"""
import argparse
import os
import time

# No broker of its own.
os.environ.setdefault("WRAPYFI_ZEROMQ_START_PROXY_BROKER", "False")
os.environ.setdefault("WRAPYFI_ZEROMQ_PUBSUB_MONITOR_LISTENER_SPAWN", "thread")

parser = argparse.ArgumentParser()
parser.add_argument("--mode", choices=["publish", "listen"], required=True)
parser.add_argument("--mware", default="zeromq")
args = parser.parse_args()

from lines import leave, leaving, say, watch_stdin  # noqa: E402
from wrapyfi.tests.tools.class_test import Test  # noqa: E402

watch_stdin()
test = Test()
test.activate_communication(test.exchange_object, mode=args.mode)
n = 0
while not leaving.is_set():
    (message,) = test.exchange_object(msg=f"signal_idx:{n}", mware=args.mware, should_wait=True)
    if message is not None:
        say("message", value={**message, "set": sorted(message["set"], key=str)})
        n += 1
    time.sleep(0.05 if args.mode == "publish" else 0.005)
leave()
