#!/usr/bin/env python3
"""A relay of a few lines on rospy and rclpy beside `wrapyfi bridge`, from ROS 1 to ROS 2, by turns.

    rospy publisher ─┬─▶ relay: rospy subscriber, rclpy publisher ─┬─▶ rclpy subscriber
                     └─▶ wrapyfi bridge with one route ────────────┘

    make test                                                       # rospy of Debian, rclpy of ROS 2 Kilted in .venv-kilted
    cargo build --release --locked --package wrapyfi_bridge
    scripts/lo-namespace.sh python3 bench/peers/relay.py --rounds 6 # 5 minutes

Another ROS 2 that is sourced: --rclpy /usr/bin/python3, and RMW_IMPLEMENTATION. Latency counts from the time when a
message was due, CPU is that of the thing in between over what arrived. A table on stdout, all figures in --out as JSON.
"""
import argparse
import json
import math
import os
import socket
import statistics
import sys
import tempfile
import threading
import time

from ros2_side_by_side import ROOT, End, say

DEBIAN = "/usr/lib/python3/dist-packages"
IMAGE = ["height", "width", "encoding", "is_bigendian", "step", "data"]
# Topic: package and type, rate in Hz, fields that are alike on both sides, title.
LOADS = {
    "text": ("std_msgs", "String", 50, ["data"], "String of 30 letters, 50 Hz"),
    "joints": ("sensor_msgs", "JointState", 100, ["name", "position", "velocity", "effort"], "JointState of 12 joints, 100 Hz"),
    "vga": ("sensor_msgs", "Image", 30, IMAGE, "640x480 rgb8, 30 Hz"),
    "full_hd": ("sensor_msgs", "Image", 30, IMAGE, "1920x1080 rgb8, 30 Hz"),
}


def message_class(load):
    package, name, *_ = LOADS[load]
    return getattr(__import__(f"{package}.msg").msg, name)


def ros1(loads):
    """rospy and its classes of messages. ROS 2 has packages of the same names, so these are forgotten again."""
    sys.path.insert(0, DEBIAN)
    import rospy
    classes = {load: message_class(load) for load in loads}
    sys.path.remove(DEBIAN)
    for name in [name for name in sys.modules if name.split(".")[0].endswith(("_msgs", "_srvs"))]:
        del sys.modules[name]
    rospy.init_node("relay_bench", anonymous=True, disable_signals=True)
    return rospy, classes


def node():
    import rclpy
    rclpy.init(args=[])
    return rclpy, rclpy.create_node(f"relay_bench_{os.getpid()}")


def filled(load, message):
    if load == "joints":
        message.name = [f"joint_{number}" for number in range(12)]
        message.position, message.velocity, message.effort = [0.5] * 12, [0.1] * 12, [0.0] * 12
    elif load != "text":
        message.width, message.height = (640, 480) if load == "vga" else (1920, 1080)
        message.encoding, message.step = "rgb8", 3 * message.width
        message.data = os.urandom(message.step * message.height)
    return message


def publish():
    """Obeys lines of stdin: load, number of the first message, how many."""
    rospy, classes = ros1(LOADS)
    publishers = {load: rospy.Publisher(load, kind, queue_size=10) for load, kind in classes.items()}
    messages = {load: filled(load, kind()) for load, kind in classes.items()}
    say(ready=True)
    for line in sys.stdin:
        load, first, count = line.split()[0], *map(int, line.split()[1:])
        message, period, start = messages[load], 1e9 / LOADS[load][2], time.monotonic_ns() + 10_000_000
        for index in range(count):
            due = start + round(index * period)
            time.sleep(max(0, due - time.monotonic_ns()) / 1e9)
            if load == "text":
                message.data = f"{first + index:010}{due:020}"
            else:
                message.header.stamp.secs, message.header.stamp.nsecs = divmod(due, 10**9)
                message.header.frame_id = str(first + index)
            publishers[load].publish(message)
        say(done=True)


def read():
    """At each line of stdin: number and latency in nanoseconds of what came since the last."""
    rclpy, reader = node()
    came = []

    def take(message):
        now = time.monotonic_ns()
        if hasattr(message, "header"):
            stamp = message.header.stamp
            came.append((int(message.header.frame_id), now - stamp.sec * 10**9 - stamp.nanosec))
        else:
            came.append((int(message.data[:10]), now - int(message.data[10:])))

    for load in LOADS:
        reader.create_subscription(message_class(load), load, take, 10)
    threading.Thread(target=rclpy.spin, args=(reader,), daemon=True).start()
    say(ready=True)
    for _ in sys.stdin:
        told, came[:] = came[:], []
        say(came=told)
    os._exit(0)


def relay(load):
    """What a user writes. Without `tcp_nodelay` and `buff_size` rospy is slower; this size takes the least time."""
    rospy, classes = ros1([load])
    rclpy, writer = node()
    kind, fields = message_class(load), LOADS[load][3]
    publisher = writer.create_publisher(kind, load, 10)

    def carry(message):
        out = kind()
        if load != "text":
            stamp = message.header.stamp
            out.header.stamp.sec, out.header.stamp.nanosec = stamp.secs, stamp.nsecs
            out.header.frame_id = message.header.frame_id
        for field in fields:
            setattr(out, field, getattr(message, field))
        publisher.publish(out)

    rospy.Subscriber(load, classes[load], carry, queue_size=10, buff_size=1 << 20, tcp_nodelay=True)
    say(ready=True)
    sys.stdin.read()
    rospy.signal_shutdown("the turn is over")
    rclpy.shutdown()
    os._exit(0)


# The driver --------------------------------------------------------------------------------------


def script(python, *words):
    return End(python, os.path.abspath(__file__), *words)


def bridge(program, load, folder):
    path = os.path.join(folder, "bridge.yaml")
    with open(path, "w") as file:
        file.write(f'routes:\n  - {{ from: "ros:/{load}", to: "ros2:/{load}" }}\n')
    return End(program, "bridge", "--config", path)


def ask(end, line):
    end.process.stdin.write(f"{line}\n")
    end.process.stdin.flush()
    return end.line()


def turn(between, source, sink, load, seconds):
    """Latencies in microseconds, how many messages were sent, CPU time of what is in between over each that came."""
    deadline = time.monotonic() + 30
    while not arrived(sink, between, 1, 0.2)[0]:
        if time.monotonic() > deadline:
            sys.exit(f"no message of {load} came within 30 s")
        ask(source, f"{load} -9 1")
    ask(source, f"{load} -8 8")
    # Until all is quiet: neither what warms up nor discovery is counted.
    arrived(sink, between, 1 << 30, 1)
    count, before = round(LOADS[load][2] * seconds), between.cpu()
    ask(source, f"{load} 0 {count}")
    came, after = arrived(sink, between, count, 1)
    return {"sent": count, "latencies": list(came.values()), "cpu_us": 1e6 * (after - before) / max(1, len(came))}


def arrived(sink, between, count, patience):
    """Latency by number of what comes, until `count` have or nothing does any more, and the CPU time until then."""
    came, cpu, quiet_since = {}, between.cpu(), time.monotonic()
    while len(came) < count and time.monotonic() < quiet_since + patience:
        time.sleep(0.02)
        if new := ask(sink, "")["came"]:
            came |= {number: late / 1e3 for number, late in new}
            cpu, quiet_since = between.cpu(), time.monotonic()
    return came, cpu


def interval(rounds):
    """Bounds of the median that hold it with 95 %, as bench/src/report.rs finds them."""
    n = len(rounds)
    k = sum(sum(math.comb(n, heads) for heads in range(low + 1)) / 2**n <= 0.025 for low in range(n))
    return (sorted(rounds)[k - 1], sorted(rounds)[n - k]) if k else (math.nan, math.nan)


def row(load, turns):
    """A line of the table: what is compared is the relay's and ours."""
    of = [[it for it in turns if it["who"] == who] for who in ("relay", "ours")]

    def compared(figure):
        both = [[figure(it) for it in side] for side in of]
        ratios = [ours / relayed for relayed, ours in zip(*both)]
        return [", ".join(f"{statistics.median(side):.0f}" for side in both),
                "{:.2f} ({:.2f} to {:.2f})".format(statistics.median(ratios), *interval(ratios))]

    late = [sorted(it for one in side for it in one["latencies"]) or [math.nan] for side in of]
    p99 = ", ".join(f"{side[math.ceil(0.99 * len(side)) - 1]:.0f}" for side in late)
    came = ", ".join(f"{sum(len(one['latencies']) for one in side)} of {sum(one['sent'] for one in side)}" for side in of)
    cells = [*compared(lambda it: statistics.median(it["latencies"] or [math.nan])), p99, came, *compared(lambda it: it["cpu_us"])]
    return f"| {LOADS[load][4]} | {' | '.join(cells)} |"


def main():
    roles = {"publish": publish, "read": read, "relay": relay}
    if sys.argv[1:] and sys.argv[1] in roles:
        return roles[sys.argv[1]](*sys.argv[2:])
    parser = argparse.ArgumentParser()
    parser.add_argument("--program", default=os.path.join(ROOT, "target/release/wrapyfi"))
    parser.add_argument("--rclpy", default=os.path.join(ROOT, ".venv-kilted/bin/python"), help="a Python that has rclpy")
    parser.add_argument("--load", nargs="+", choices=LOADS, default=list(LOADS))
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--out")
    args = parser.parse_args()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    os.environ |= {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1", "ROS_DOMAIN_ID": str(1 + os.getpid() % 100)}
    os.environ.setdefault("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
    master = End("/usr/bin/python3", os.path.join(os.path.dirname(os.path.abspath(__file__)), "ros1_topics.py"), "master", "--port", port)
    master.line()
    source, sink, turns = script("/usr/bin/python3", "publish"), script(args.rclpy, "read"), []
    source.line(), sink.line()
    with tempfile.TemporaryDirectory() as folder:
        for index in range(args.rounds):
            order = [(load, who) for load in args.load for who in ("relay", "ours")]
            for load, who in reversed(order) if index % 2 else order:
                between = script(args.rclpy, "relay", load) if who == "relay" else bridge(args.program, load, folder)
                turns.append({"load": load, "who": who, **turn(between, source, sink, load, args.seconds)})
                between.process.stdin.close() if who == "relay" else between.process.terminate()
                between.process.wait(20)
    print(f"\n{os.environ['RMW_IMPLEMENTATION']}; {args.rounds} rounds of {args.seconds:g} s; relay, then ours; us\n\n"
          "| message | p50 | ours / relay | p99 | came | CPU a message | ours / relay |\n| --- | --- | --- | --- | --- | --- | --- |")
    for load in args.load:
        print(row(load, [it for it in turns if it["load"] == load]))
    if args.out:
        with open(args.out, "w") as file:
            json.dump(turns, file)
    for end in (source, sink, master):
        end.end()


if __name__ == "__main__":
    main()
