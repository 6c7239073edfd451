"""Ours on ROS 2 beside rclpy and rcl, by turns, on one middleware after the other.

    . /opt/ros/jazzy/setup.bash
    cargo build --release --locked --package wrapyfi_bridge --package wrapyfi_bench --features wrapyfi_bridge/rmw
    scripts/lo-namespace.sh /usr/bin/python3 bench/peers/ros2_side_by_side.py topics --rounds 6
    scripts/lo-namespace.sh /usr/bin/python3 bench/peers/ros2_side_by_side.py freeze --rounds 20
    scripts/lo-namespace.sh /usr/bin/python3 bench/peers/ros2_side_by_side.py services relays --rounds 6

    topics    messages that a subscriber of rclpy gets, of a publisher of rclpy and of ours
    freeze    1080p at 30 Hz: how long the subscriber of rclpy stands still, and what it gets
    services  replies of 1 and 32 MB, the first call after a match, later calls: rcl by rcl, ours by ours
    relays    CPU time per message of a relay of serialised messages, on rcl and ours

`--rmw` names middlewares (all that are installed are measured), `--graph cyclone` measures CycloneDDS inside. Every
end is a process of its own in a domain of its own. Tables of medians on stdout, every figure in --out as JSON.
"""
import argparse
import glob
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time

QOS = {"reliable, 10": (10, True), "reliable, 1": (1, True), "best effort": (10, False)}
HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
TRIGGER = "std_srvs/srv/Trigger"


def image(width, height):
    from sensor_msgs.msg import Image
    message = Image(height=height, width=width, encoding="rgb8", step=3 * width)
    message.data = bytes(3 * width * height)
    return message


def cloud():
    from sensor_msgs.msg import PointCloud2, PointField
    fields = [PointField(name=name, offset=4 * at, datatype=PointField.FLOAT32, count=1)
              for at, name in enumerate("xyzi")]
    return PointCloud2(height=1, width=65536, fields=fields, point_step=16, row_step=16 * 65536,
                       data=bytes(16 * 65536), is_dense=True)


def joints():
    from sensor_msgs.msg import JointState
    names = [f"joint_{number}" for number in range(30)]
    return JointState(name=names, position=[0.5] * 30, velocity=[0.1] * 30, effort=[0.0] * 30)


# Name: message, type, rate.
LOADS = {
    "0.9 MB, 30 Hz": (lambda: image(640, 480), "sensor_msgs/msg/Image", 30),
    "6.2 MB, 30 Hz": (lambda: image(1920, 1080), "sensor_msgs/msg/Image", 30),
    "1 MB cloud, 10 Hz": (cloud, "sensor_msgs/msg/PointCloud2", 10),
    "JointState, 500 Hz": (joints, "sensor_msgs/msg/JointState", 500),
}


# Ends on rclpy -----------------------------------------------------------------------------------


def say(**told):
    print(json.dumps(told), flush=True)


def node_of(name):
    import rclpy
    rclpy.init(args=[])
    return rclpy.create_node(f"{name}_{os.getpid()}")


def qos_of(depth, reliable):
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=depth, reliability=reliability)


def publish(load, depth, reliable, count):
    """As ros2_ends does, with typed messages."""
    make, _, rate = LOADS[load]
    message = make()
    node = node_of("rclpy_publisher")
    publisher = node.create_publisher(type(message), "/measured", qos_of(depth, reliable))
    say(ready=True)
    while publisher.get_subscription_count() == 0:
        time.sleep(0.02)
    # As ours waits until a match has settled.
    time.sleep(0.1)
    start = time.monotonic()
    for number in range(count):
        time.sleep(max(0.0, start + number / rate - time.monotonic()))
        publisher.publish(message)
    seconds = time.monotonic() - start
    time.sleep(1)
    say(sent=count, refused=0, seconds=seconds)


def subscribe(load, depth, reliable):
    """Counts until stdin ends, and says for how long nothing came in between."""
    import rclpy
    make, _, _ = LOADS[load]
    node = node_of("rclpy_subscriber")
    times = []
    node.create_subscription(type(make()), "/measured", lambda _: times.append(time.monotonic()),
                             qos_of(depth, reliable))
    say(ready=True)
    os.set_blocking(0, False)
    while sys.stdin.buffer.raw.read(1) != b"":
        rclpy.spin_once(node, timeout_sec=0.1)
    gaps = [after - before for before, after in zip(times, times[1:])]
    say(received=len(times), longest_gap=max(gaps, default=0.0))


# The driver --------------------------------------------------------------------------------------


class End:
    """A process that says lines of JSON."""

    def __init__(self, *command):
        self.process = subprocess.Popen([str(word) for word in command], stdin=subprocess.PIPE, text=True,
                                        stdout=subprocess.PIPE, stderr=ERRORS)

    def line(self):
        """The next line, or none where it has ended."""
        line = self.process.stdout.readline()
        return json.loads(line) if line else {}

    def cpu(self):
        """Seconds of CPU time of the threads that there are."""
        files = glob.glob(f"/proc/{self.process.pid}/task/*/schedstat")
        return sum(int(open(file).read().split()[0]) for file in files) / 1e9

    def end(self, patience=20):
        """Closes stdin; its last words, or none where it does not end."""
        self.process.stdin.close()
        try:
            self.process.wait(patience)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        lines = self.process.stdout.read().splitlines()
        return json.loads(lines[-1]) if lines else {}


def script(*words):
    return End(sys.executable, os.path.abspath(__file__), "--role", *words)


def ours(*words):
    return End(ours.program, *words)


ours.program = os.path.join(ROOT, "target/release/ros2_ends")


def domain():
    domain.last = domain.last % 100 + 1
    os.environ["ROS_DOMAIN_ID"] = str(domain.last)


domain.last = os.getpid() % 100


def serialised(folder, name, message):
    from rclpy.serialization import serialize_message
    path = os.path.join(folder, name.replace(" ", "_").replace(",", "").replace("/", "_"))
    if not os.path.exists(path):
        with open(path, "wb") as file:
            file.write(serialize_message(message))
    return path


def publisher(who, load, depth, reliable, count, folder):
    make, kind, rate = LOADS[load]
    if who == "rclpy":
        return script("publish", load, depth, int(reliable), count)
    words = ["publish", "--name", "/measured", "--type", kind, "--file", serialised(folder, load, make()),
             "--depth", depth, "--rate", rate, "--count", count]
    return ours(*words, *([] if reliable else ["--best-effort"]))


def received(who, load, depth, reliable, seconds, folder):
    """What a subscriber of rclpy got of one publisher."""
    domain()
    count = round(LOADS[load][2] * seconds)
    hears = script("subscribe", load, depth, int(reliable))
    hears.line()
    sends = publisher(who, load, depth, reliable, count, folder)
    sends.line()
    told = sends.line()
    sends.end()
    heard = hears.end()
    return {"of": count, **told, "received": heard.get("received", 0), "longest_gap": heard.get("longest_gap"),
            "ended": bool(heard)}


def topics(args, folder, cells):
    for load in args.load or LOADS:
        for qos, (depth, reliable) in QOS.items():
            for _ in range(args.rounds):
                for who in ("rclpy", "ours"):
                    cells.append({"load": load, "qos": qos, "who": who,
                                  **received(who, load, depth, reliable, args.seconds, folder)})
            of = [cell for cell in cells if (cell["load"], cell["qos"]) == (load, qos)]
            got = {who: statistics.median(cell["received"] for cell in of if cell["who"] == who)
                   for who in ("rclpy", "ours")}
            ratio = got["ours"] / got["rclpy"] if got["rclpy"] else float("inf")
            print(f"| {load} | {qos} | {of[0]['of']} | {got['rclpy']:g} | {got['ours']:g} | {ratio:.2f} |", flush=True)


def freeze(args, folder, cells):
    for who in ("rclpy", "ours"):
        for _ in range(args.rounds):
            cells.append({"who": who, **received(who, "6.2 MB, 30 Hz", 10, True, args.seconds, folder)})
        of = [cell for cell in cells if cell["who"] == who]
        gap = max(cell["longest_gap"] or args.seconds for cell in of)
        print(f"| 1080p, {len(of)} rounds | {who} | least {min(cell['received'] for cell in of)} of {of[0]['of']} | "
              f"longest gap {gap:.2f} s | stood still for good {sum(not cell['ended'] for cell in of)} |", flush=True)


def services(args, folder, cells):
    from std_srvs.srv import Trigger
    request = serialised(folder, "request", Trigger.Request())
    for size in (100, 1 << 20, 32 << 20):
        reply = serialised(folder, f"reply{size}", Trigger.Response(success=True, message="x" * size))
        count = 100 if size < 1 << 24 else 10
        for _ in range(args.rounds):
            for who in ("rcl", "ours"):
                domain()
                if who == "ours":
                    server = ours("serve", "--name", "/asked", "--type", TRIGGER, "--file", reply)
                else:
                    server = End(args.rcl, "serve", "/asked", size)
                server.line()
                if who == "ours":
                    client = ours("call", "--name", "/asked", "--type", TRIGGER, "--file", request, "--count", count)
                else:
                    client = End(args.rcl, "call", "/asked", count)
                times = client.line().get("times", [])
                client.end()
                server.end()
                cells.append({"bytes": size, "who": who, "times": times})
        of = {who: [cell["times"] for cell in cells if (cell["bytes"], cell["who"]) == (size, who) and cell["times"]]
              for who in ("rcl", "ours")}
        first = {who: max((times[0] for times in of[who]), default=float("nan")) for who in of}
        later = {who: statistics.median([time for times in of[who] for time in times[1:]] or [float("nan")])
                 for who in of}
        print(f"| reply of {size} bytes | longest first call {first['rcl']:.3f} s, {first['ours']:.3f} s | later "
              f"{later['rcl'] * 1e3:.2f} ms, {later['ours'] * 1e3:.2f} ms | {later['ours'] / later['rcl']:.2f} | "
              f"answered {sum(map(bool, of['ours']))} of {args.rounds} |", flush=True)


def relays(args, folder, cells):
    for load in args.load or ("0.9 MB, 30 Hz", "1 MB cloud, 10 Hz", "JointState, 500 Hz"):
        make, kind, rate = LOADS[load]
        count = round(rate * args.seconds)
        for _ in range(args.rounds):
            for who in ("rcl", "ours"):
                domain()
                if who == "ours":
                    relay = ours("relay", "--name", "/measured", "--to", "/relayed", "--type", kind)
                else:
                    relay = End(args.rcl, "relay", "/measured", "/relayed", kind, 10, 1)
                relay.line()
                # Discovery is not counted.
                time.sleep(1)
                before = relay.cpu()
                sends = publisher("ours", load, 10, True, count, folder)
                sends.line()
                sent = sends.line().get("sent", 0)
                cells.append({"load": load, "who": who, "cpu_us": 1e6 * (relay.cpu() - before) / max(sent, 1)})
                sends.end()
                relay.end()
        cpu = {who: statistics.median(cell["cpu_us"] for cell in cells
                                      if (cell["load"], cell["who"]) == (load, who)) for who in ("rcl", "ours")}
        print(f"| relay of {load} | CPU per message {cpu['rcl']:.0f} us, {cpu['ours']:.0f} us | "
              f"{cpu['ours'] / cpu['rcl']:.2f} |", flush=True)


def compiled(folder):
    """The program on rcl."""
    prefixes = os.environ["AMENT_PREFIX_PATH"].split(":")
    includes = [f"-I{path}" for prefix in prefixes for path in glob.glob(f"{prefix}/include/*")
                if os.path.isdir(os.path.join(path, os.path.basename(path)))]
    libraries = [f"-L{prefix}/lib" for prefix in prefixes]
    program = os.path.join(folder, "rcl_ends")
    names = ["rcl", "rmw", "rmw_implementation", "rcutils", "rosidl_runtime_c",
             *(f"{package}__rosidl_{part}" for package in ("std_srvs", "sensor_msgs")
               for part in ("typesupport_c", "generator_c"))]
    subprocess.run(["c++", "-std=c++17", "-O2", os.path.join(HERE, "rcl_ends.cpp"), *includes, *libraries,
                    *(f"-l{name}" for name in names if any(glob.glob(f"{prefix}/lib/lib{name}.so") for prefix in prefixes)),
                    # The libraries' own are found when the program starts.
                    "-Wl,--allow-shlib-undefined", "-o", program], check=True)
    return program


def main():
    if sys.argv[1:2] == ["--role"]:
        role, load, *rest = sys.argv[2:]
        rest = [int(word) for word in rest]
        return {"publish": publish, "subscribe": subscribe}[role](load, *rest)
    whats = {"topics": topics, "freeze": freeze, "services": services, "relays": relays}
    parser = argparse.ArgumentParser()
    parser.add_argument("what", nargs="+", choices=whats)
    parser.add_argument("--rmw", nargs="+")
    parser.add_argument("--graph", choices=("rmw", "cyclone"), default="rmw")
    parser.add_argument("--load", nargs="+", choices=LOADS)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--ours", help="the program ros2_ends of another build")
    parser.add_argument("--out")
    args = parser.parse_args()
    os.environ.update(ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST", WRAPYFI_ROS2_GRAPH=args.graph)
    index = "share/ament_index/resource_index/rmw_typesupport/rmw_*_cpp"
    installed = [os.path.basename(path) for prefix in os.environ["AMENT_PREFIX_PATH"].split(":")
                 for path in sorted(glob.glob(os.path.join(prefix, index)))]
    ours.program = args.ours or ours.program
    figures = []
    with tempfile.TemporaryDirectory() as folder:
        args.rcl = compiled(folder) if {"services", "relays"} & set(args.what) else None
        for rmw in args.rmw or [name for name in installed if "dynamic" not in name]:
            os.environ["RMW_IMPLEMENTATION"] = rmw
            for what in args.what:
                print(f"\n{what}, {rmw}, ours on {args.graph}, {args.rounds} rounds", flush=True)
                cells = []
                whats[what](args, folder, cells)
                figures += [{"what": what, "rmw": rmw, "graph": args.graph, **cell} for cell in cells]
                if args.out:
                    with open(args.out, "w") as file:
                        json.dump(figures, file, indent=1)


ERRORS = open(os.environ.get("ROS2_SIDE_BY_SIDE_ERRORS", os.devnull), "a")
if __name__ == "__main__":
    main()
