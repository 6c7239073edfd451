#!/usr/bin/env python3
"""Actions through the bridge beside the direct way: rclpy of ROS 2 Kilted and rospy's actionlib.

    scripts/lo-namespace.sh python3 bench/peers/actions.py [--program target/release/wrapyfi] latency feedback many soak kills

latency   time from sending a goal to its acceptance, of goals one after the other: direct, and through the bridge, by turns
feedback  feedback at 100 Hz for ten seconds: how much of it arrives
many      50 goals at once
soak      200 goals a minute, half of them each way, for --minutes: memory of the bridge
kills     kill -9 of server, client and bridge, --kills times each and each way, while a goal is under way: how it ends on both sides
"""
import argparse
import collections
import json
import os
import pathlib
import queue
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time

parser = argparse.ArgumentParser()
parser.add_argument("what", nargs="+", choices=["latency", "feedback", "many", "soak", "kills"])
parser.add_argument("--program", default="target/release/wrapyfi")
parser.add_argument("--kilted", default=".venv-kilted/bin/python")
parser.add_argument("--rounds", type=int, default=4)
parser.add_argument("--goals", type=int, default=100)
parser.add_argument("--minutes", type=float, default=10)
parser.add_argument("--kills", type=int, default=50)
args = parser.parse_args()

ROOT = pathlib.Path(__file__).resolve().parents[2]
PEERS = ROOT / "test" / "peers"
PORT = 11411
ENVIRONMENT = {**os.environ, "ROS_DOMAIN_ID": "88", "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
               "ROS_MASTER_URI": f"http://127.0.0.1:{PORT}", "ROS_IP": "127.0.0.1"}
DEFINITION = "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n"


class Peer:
    """A process whose lines of JSON are kept."""

    def __init__(self, *command):
        self.process = subprocess.Popen([str(word) for word in command], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.DEVNULL, env=ENVIRONMENT, text=True, cwd=ROOT)
        self.lines, self.seen = queue.Queue(), []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            if line.startswith("{"):
                self.lines.put(json.loads(line))

    def drain(self):
        while not self.lines.empty():
            self.seen.append(self.lines.get())

    def until(self, wanted, timeout=60):
        """First line that is wanted, among those so far and those to come; None when the time is over."""
        deadline = time.monotonic() + timeout
        for line in self.seen:
            if wanted(line):
                return line
        while time.monotonic() < deadline:
            try:
                line = self.lines.get(timeout=0.05)
            except queue.Empty:
                continue
            self.seen.append(line)
            if wanted(line):
                return line
        return None

    def event(self, name, timeout=60):
        found = self.until(lambda line: line.get("event") == name, timeout)
        if found is None:
            sys.exit(f"{name} did not come; last: {self.seen[-3:]}")
        return found

    def events(self, name):
        self.drain()
        return [line for line in self.seen if line.get("event") == name]

    def kill(self):
        self.process.kill()
        self.process.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(3)
            except subprocess.TimeoutExpired:
                self.kill()

    def rss_mib(self):
        text = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return int(next(line.split()[1] for line in text.splitlines() if line.startswith("VmRSS"))) / 1024


def rclpy(*words):
    return Peer(args.kilted, PEERS / "rclpy_actions.py", *words)


def rospy(*words):
    return Peer("/usr/bin/python3", PEERS / "rospy_actions.py", *words)


def bridge(*routes):
    folder = pathlib.Path(tempfile.mkdtemp())
    (folder / "types/test_msgs/action").mkdir(parents=True)
    (folder / "types/test_msgs/action/Fibonacci.action").write_text(DEFINITION)
    lines = "".join(f"  - {{ action: '{there}', as: '{here}' }}\n" for there, here in routes)
    (folder / "bridge.yaml").write_text(f"definitions: [types]\nroutes:\n{lines}")
    return Peer(args.program, "bridge", "--json", "--config", folder / "bridge.yaml")


# Name, server, client, and route of the two ways.
WAYS = [("server on rospy", rospy, rclpy, ("ros:/one", "ros2:/one")), ("server on rclpy", rclpy, rospy, ("ros2:/one", "ros:/one"))]


def quantiles(values):
    values = sorted(values)
    return statistics.median(values), values[min(len(values) - 1, int(len(values) * 0.99))]


def accepted(client):
    client.event("done", 300)
    return [line["ms"] for line in client.events("accepted")]


def latency():
    found = collections.defaultdict(list)
    send = ("send", "--order", "0", "--count", str(args.goals))
    with bridge(("ros:/one", "ros2:/one"), ("ros2:/two", "ros:/two")), \
            rospy("serve", "--action", "/one"), rclpy("serve", "--action", "/two"):
        for _ in range(args.rounds):
            for name, start, action in [("rclpy to rclpy", rclpy, "/two"), ("rclpy to rospy by the bridge", rclpy, "/one"),
                                        ("rospy to rospy", rospy, "/one"), ("rospy to rclpy by the bridge", rospy, "/two")]:
                with start(*send, "--action", action) as client:
                    found[name] += accepted(client)
    for name, values in found.items():
        median, p99 = quantiles(values)
        print(f"{name}: median {median:.2f} ms, p99 {p99:.2f} ms of {len(values)} goals")


def feedback():
    for name, serve, send, route in WAYS:
        with bridge(route), serve("serve", "--action", "/one", "--step", "0.01") as server, \
                send("send", "--action", "/one", "--order", "1000") as client:
            server.event("ready")
            client.event("end", 120)
            time.sleep(0.5)
            print(f"{name}: {len(client.events('feedback'))} of 1000 messages of feedback")


def many():
    send = ("send", "--action", "/one", "--order", "20", "--goals", "50")
    for name, serve, client, route in [("rclpy to rclpy", rclpy, rclpy, None), ("rclpy to rospy by the bridge", rospy, rclpy, ("ros:/one", "ros2:/one")),
                                       ("rospy to rclpy by the bridge", rclpy, rospy, ("ros2:/one", "ros:/one"))]:
        with serve("serve", "--action", "/one", "--goals", "50"), (bridge(route) if route else serve("serve", "--action", "/other")), \
                client(*send) as sent:
            sent.until(lambda line: line.get("event") == "done", 40)
            ends = collections.Counter(line["state"] for line in sent.events("end"))
            accepted = sum(line["accepted"] for line in sent.events("accepted"))
            print(f"50 goals at once, {name}: {accepted} accepted, results that came: {dict(ends)}")


def soak():
    with bridge(("ros:/one", "ros2:/one"), ("ros2:/two", "ros:/two")) as ours, \
            rospy("serve", "--action", "/one", "--step", "0.01"), rclpy("serve", "--action", "/two", "--step", "0.01"):
        sizes, begun, sent, ended = [], time.monotonic(), 0, 0
        while time.monotonic() - begun < args.minutes * 60:
            for start, action in [(rclpy, "/one"), (rospy, "/two")]:
                with start("send", "--action", action, "--order", "1", "--count", "50") as client:
                    client.event("done", 120)
                    ended += sum(line["state"] == "succeeded" for line in client.events("end"))
                    sent += 50
            time.sleep(max(0, begun + sent * 0.3 - time.monotonic()))
            sizes.append(round(ours.rss_mib(), 1))
        minutes = (time.monotonic() - begun) / 60
        print(f"{ended} of {sent} goals succeeded in {minutes:.1f} minutes, both ways; memory of the bridge in MiB: {sizes}")


def kills():
    for name, serve, send, route in WAYS:
        ends = collections.Counter()
        for victim in ["server", "client", "bridge"]:
            serve_one = lambda: serve("serve", "--action", "/one", "--step", "0.02")  # noqa: E731
            living = {"bridge": bridge(route), "server": serve_one()}
            try:
                for _ in range(args.kills):
                    with send("send", "--action", "/one", "--order", "40") as client:
                        client.event("feedback")
                        ({"client": client} | living)[victim].kill()
                        if victim != "client":
                            living[victim] = serve_one() if victim == "server" else bridge(route)
                        for side in {"server", "client"} - {victim}:
                            # A client of ROS 2 is told nothing of a bridge that has gone.
                            wait_s = 2 if (victim, side, send) == ("bridge", "client", rclpy) else 60
                            peer = client if side == "client" else living["server"]
                            peer.until(lambda line: line.get("event") == "end", wait_s)
                            time.sleep(0.2)
                            states = [line["state"] for line in peer.events("end")]
                            ends[victim, side, " and ".join(states) or "no end"] += 1
                        living["server"].drain()
                        living["server"].seen.clear()
            finally:
                for process in living.values():
                    process.kill()
        for (victim, side, state), count in sorted(ends.items()):
            print(f"{name}, {victim} killed: {side} has {state}: {count} times", flush=True)


with Peer("/usr/bin/python3", PEERS / "rospy_peer.py", "master", "--port", PORT) as master:
    master.event("ready")
    for what in args.what:
        globals()[what]()
