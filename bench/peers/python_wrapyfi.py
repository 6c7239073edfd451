#!/usr/bin/env python3
"""Python Wrapyfi as source, forwarder or sink of a measured way. Started once, obeys for many turns.

The same on `wrapyfi_rs`, by `python -m wrapyfi_rs python_wrapyfi.py ...`.

    python_wrapyfi.py source  --pub-port P --sub-port S     runs Wrapyfi's broker too
    python_wrapyfi.py forward --pub-port P --sub-port S     listens to /in/X, publishes /out/X
    python_wrapyfi.py sink    --pub-port P --sub-port S --acks PORT
    python_wrapyfi.py serve   --rep-port P --req-port Q     answers requests with pictures; runs their broker
    python_wrapyfi.py code                                  coding alone, no transport

Orders on stdin and results on stdout are one JSON object a line, as bench/src/worker.rs has them:
the source is told {"do": "warm" | "paced" | "window" | "ask", "way": "hop" | "forward", "payload": X, ...},
sink and forwarder {"way": ..., "payload": X}, or null to rest. The sink tells the source of every
arrival as two 64-bit numbers over TCP: the message's number and CLOCK_MONOTONIC in nanoseconds.

Every listener of Wrapyfi looks for messages without sleeping, as Wrapyfi's own benchmark does; the forwarder
sleeps 0.1 ms where nothing waits, because three processes that never sleep hinder each other. Those of
`wrapyfi_rs` wait, and look what they were told every 0.2 s.
"""
import argparse
import json
import logging
import os
import signal
import socket
import struct
import sys
import threading
import time

logging.disable(logging.WARNING)
import numpy as np  # noqa: E402
from wrapyfi.connect.wrapper import MiddlewareCommunicator  # noqa: E402

BASE = 1_700_000_000
BITS = np.arange(24)
WARM, AWAKE_NS, SILENCE_S = 5, 250_000, 2.0
ASK = "/ask"

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["source", "forward", "sink", "serve", "code"])
parser.add_argument("--pub-port", type=int, default=0)
parser.add_argument("--sub-port", type=int, default=0)
parser.add_argument("--rep-port", type=int, default=0)
parser.add_argument("--req-port", type=int, default=0)
parser.add_argument("--acks", type=int, default=0)
args = parser.parse_args()


def picture(width, height):
    y, x, c = np.ogrid[:height, :width, :3]
    noise = np.random.default_rng(1).integers(0, 40, (height, width, 3))
    return ((x * (c + 1) // 5 + y // 3 + noise) % 256).astype(np.uint8)


PAYLOADS = {
    "small": {"seq": 0, "name": "left_arm", "speed": 0.25, "joints": [0.1, -1.5, 3.0]},
    "u8-rgb200": {"seq": 0, "data": picture(200, 200)},
    "f32-mib": {"seq": 0, "data": np.sin(np.arange(512 * 512, dtype=np.float32) / 1e4).reshape(512, 512)},
    "audio": np.sin(np.arange(8820, dtype=np.float32) / 1e4).reshape(8820, 1),
    "vga-jpeg": picture(640, 480),
    "vga-rgb": picture(640, 480),
    "full-hd-rgb": picture(1920, 1080),
}


def number(payload, seq):
    """Message number `seq` of a kind; the bulk of it is shared with the others."""
    value = PAYLOADS[payload]
    if isinstance(value, dict):
        value["seq"] = BASE + seq
        return value
    if payload == "audio":
        value[0, 0] = seq  # exact in float32 up to 2**24
        return value, 44100
    if payload == "vga-jpeg":
        # One block of the compressor for each bit, black or white: survives compression.
        value[:16, :384] = ((seq >> BITS & 1) * 255).astype(np.uint8).repeat(16)[None, :, None]
        return value
    value[0, 0] = seq % 256, seq // 256 % 256, seq // 65536
    return value


def number_of(payload, value):
    if payload == "vga-jpeg":
        return int(((value[8, 8:384:16, 0] > 127).astype(np.int64) << BITS).sum())
    if isinstance(value, dict):
        return value["seq"] - BASE
    if isinstance(value, tuple):
        return int(value[0].reshape(-1)[0])
    low, middle, high = (int(x) for x in value[0, 0])
    return low + 256 * middle + 65536 * high


def arrived(value):
    return value is not None and not (isinstance(value, tuple) and value[0] is None)


def register(kind, topic, broker, wait_ms):
    """A class with one method on one topic, as a script of a user has it."""
    extra = {"chunk": 8820, "rate": 44100, "channels": 1} if kind == "audio" else {}
    if kind == "vga-jpeg":
        extra = {"jpg": True}
    pictures = dict.fromkeys(("vga-jpeg", "vga-rgb", "full-hd-rgb"), "Image")
    data_type = {"audio": "AudioChunk", **pictures}.get(kind, "NativeObject")
    # Without the monitor a publisher waits for nobody: the source sends until something arrives.
    options = dict(should_wait=True, socket_pub_port=args.pub_port, start_pubsub_monitor_broker=False, **extra)
    # Only `wrapyfi_rs` knows the time: Wrapyfi's listeners do not wait, and its requests wait for ever.
    options.update(socket_rep_port=args.rep_port, socket_req_port=args.req_port, timeout_ms=wait_ms)
    sending = dict(socket_sub_port=args.sub_port, start_proxy_broker=broker)

    def message(self, value=None):
        return (number(kind, value) if topic == ASK else value,)

    # Wrapyfi keeps its registry by the names of class and method: every topic needs its own.
    name = "Exchange" + "".join(part.capitalize() for part in topic.replace("-", "/").split("/"))
    message.__qualname__ = f"{name}.message"
    message = MiddlewareCommunicator.register(data_type, "zeromq", name, topic, **options, **sending)(message)
    return type(name, (MiddlewareCommunicator,), {"message": message})()


class Way:
    """One end of one topic; connects when it is first used."""

    def __init__(self, kind, topic, mode, broker=False):
        self.node = register(kind, topic, broker, wait_ms=200 if mode == "listen" else 20_000)
        self.node.activate_communication(self.node.message, mode=mode)

    def send(self, value):
        self.node.message(value=value)

    def receive(self):
        try:
            (value,) = self.node.message()
        except TimeoutError:
            return None
        return value if arrived(value) else None

    def ask(self, seq):
        (value,) = self.node.message(value=seq)
        return value


def say(document):
    print(json.dumps(document), flush=True)


def leave(*_):
    import multiprocessing
    for child in multiprocessing.active_children():
        child.terminate()
    os._exit(0)


class Source:
    def __init__(self):
        self.ways, self.next = {}, 1
        listener = socket.create_server(("127.0.0.1", 0))
        say({"acks": listener.getsockname()[1]})
        self.acks, _ = listener.accept()
        self.partial = b""

    def way_to(self, topic, payload):
        if topic not in self.ways:
            # Wrapyfi starts its broker, a process, with the first of them.
            self.ways[topic] = Way(payload, topic, "request" if topic == ASK else "publish", broker=topic != ASK)
        return self.ways[topic]

    def hear(self, patience):
        self.acks.settimeout(patience)
        try:
            data = self.acks.recv(65536)
        except (socket.timeout, BlockingIOError):
            return 0
        if not data:
            leave()
        self.partial += data
        whole = len(self.partial) // 16 * 16
        heard = list(struct.iter_unpack("<QQ", self.partial[:whole]))
        self.partial = self.partial[whole:]
        for seq, when in heard:
            if seq not in self.due:
                continue
            if seq in self.seen:
                self.duplicates += 1
                continue
            self.seen[seq] = when
        return len(heard)

    def begin(self):
        self.due, self.seen, self.duplicates, self.awake, self.late = {}, {}, 0, 0, 0
        self.start = time.monotonic_ns()

    def send(self, payload, due=None, value=None):
        if value is None:
            value = number(payload, self.next)
        self.due[self.next] = due or time.monotonic_ns()
        self.next += 1
        self.way.send(value)

    def finish(self):
        while len(self.seen) < len(self.due) and self.hear(SILENCE_S):
            pass
        self.hear(0.005)
        last = max(self.seen.values(), default=self.start)
        return {"sent": len(self.due), "refused": 0, "received": len(self.seen), "duplicates": self.duplicates,
                  "latency_us": [(self.seen[seq] - self.due[seq]) / 1e3 for seq in sorted(self.seen)],
                  "latest_us": self.late / 1e3, "awake_ns": self.awake, "span_ns": last - self.start}

    def paced(self, payload, count, hz):
        self.begin()
        period = int(1e9 / hz)
        self.start += 2_000_000
        for index in range(count):
            due = self.start + index * period
            value = number(payload, self.next)
            nap = due - time.monotonic_ns() - AWAKE_NS
            if nap > 0:
                time.sleep(nap / 1e9)
            since = time.monotonic_ns()
            while (now := time.monotonic_ns()) < due:
                pass
            self.awake += now - since
            self.late = max(self.late, now - due)
            self.send(payload, due, value)
        return self.finish()

    def warm(self, payload):
        self.begin()
        start = self.start
        while not self.seen:
            self.send(payload)
            self.hear(0.04)
            if time.monotonic_ns() - start > 20e9:
                raise SystemExit("nothing arrived within 20 s")
        time.sleep(0.3)
        self.hear(0.001)
        return self.paced(payload, WARM, 10.0)

    def window(self, payload, count, inflight):
        self.begin()
        for _ in range(count):
            self.send(payload)
            while len(self.due) - len(self.seen) >= inflight:
                if not self.hear(SILENCE_S):
                    return self.finish()
        return self.finish()

    def asked(self, payload, count):
        """Microseconds of requests one after the other, each of which is answered with another picture."""
        self.begin()
        client, latency = self.way_to(ASK, payload), []
        for seq in range(1, count + 1):
            start = time.perf_counter_ns()
            value = client.ask(seq)
            latency.append((time.perf_counter_ns() - start) / 1e3)
            if number_of(payload, value) != seq:
                raise SystemExit(f"request {seq} was answered with {number_of(payload, value)}")
        return {"sent": count, "refused": 0, "received": count, "duplicates": 0, "latency_us": latency,
                "latest_us": 0.0, "awake_ns": 0, "span_ns": time.monotonic_ns() - self.start}

    def run(self):
        for line in sys.stdin:
            order = json.loads(line)
            payload = order["payload"]
            if order["do"] == "ask":
                say(self.asked(payload, order["count"]))
                continue
            self.way = self.way_to(("/in/" if order["way"] == "hop" else "/via/") + payload, payload)
            if order["do"] == "warm":
                say(self.warm(payload))
            elif order["do"] == "paced":
                say(self.paced(payload, order["count"], order["hz"]))
            else:
                say(self.window(payload, order["count"], order["inflight"]))
        leave()


def follow(act, rest):
    """Calls `act(order)` again and again for the order read last; `rest()` where it is null."""
    current = [None]

    def read():
        for line in sys.stdin:
            current[0] = json.loads(line)
        leave()

    threading.Thread(target=read, daemon=True).start()
    while True:
        order = current[0]
        rest() if order is None else act(order)


def sink():
    acks = socket.create_connection(("127.0.0.1", args.acks))
    acks.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    ways = {}

    def act(order):
        topic = ("/in/" if order["way"] == "hop" else "/out/") + order["payload"]
        if topic not in ways:
            ways[topic] = Way(order["payload"], topic, "listen")
        value = ways[topic].receive()
        if value is not None:
            now = time.monotonic_ns()
            acks.sendall(struct.pack("<QQ", number_of(order["payload"], value), now))
        elif order["way"] == "forward":
            time.sleep(0.0001)

    follow(act, lambda: time.sleep(0.01))


def forward():
    ways = {}

    def act(order):
        payload = order["payload"]
        if payload not in ways:
            ways[payload] = Way(payload, f"/via/{payload}", "listen"), Way(payload, f"/out/{payload}", "publish")
        listener, publisher = ways[payload]
        value = listener.receive()
        if value is None:
            time.sleep(0.0001)
        else:
            publisher.send(value)

    follow(act, lambda: time.sleep(0.01))


def serve():
    say({})
    server = Way("vga-rgb", ASK, "reply", broker=True)
    # Not by sys.stdin, which the process of Wrapyfi's broker would wait for.
    threading.Thread(target=lambda: (os.read(0, 1), leave()), daemon=True).start()
    while True:
        try:
            server.node.message()
        except TimeoutError:
            pass


def code():
    """{"payload", "repeats"} on stdin: medians of Wrapyfi's own coding in microseconds."""
    import cv2
    from wrapyfi.utils.image_encoders import JpegEncoder
    from wrapyfi.utils.serialization_encoders import JsonDecodeHook, JsonEncoder
    hook, jpeg = JsonDecodeHook().object_hook, JpegEncoder()

    def write(value):
        return json.dumps(value, cls=JsonEncoder).encode()

    def read(text):
        return json.loads(text.decode(), object_hook=hook)

    def compress(value):
        return jpeg.encode_jpg_image(value, return_numpy=True).tobytes()

    def decompress(file):
        return cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_COLOR)

    for line in sys.stdin:
        order = json.loads(line)
        value = number(order["payload"], 0)
        if order["payload"] == "audio":
            value = (8820, 1, 44100, value[0])
        coder, decoder = (compress, decompress) if order["payload"] == "vga-jpeg" else (write, read)
        encode, decode = [], []
        for _ in range(order["repeats"]):
            start = time.perf_counter_ns()
            coded = coder(value)
            between = time.perf_counter_ns()
            decoder(coded)
            encode.append(between - start)
            decode.append(time.perf_counter_ns() - between)
        say({"encode_us": sorted(encode)[len(encode) // 2] / 1e3, "decode_us": sorted(decode)[len(decode) // 2] / 1e3})


signal.signal(signal.SIGTERM, leave)
if args.role == "source":
    Source().run()
elif args.role == "sink":
    sink()
elif args.role == "forward":
    forward()
elif args.role == "serve":
    serve()
else:
    code()
