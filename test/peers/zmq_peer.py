#!/usr/bin/env python3
"""A bare ZeroMQ publisher that sends what no honest peer would.

    zmq_peer.py --topic /x --sub-port S --cases CASE,CASE    (--cases list prints their names)

It is an XPUB socket, so it waits until the broker passed on a subscription for the topic, then sends
each case once, in order, and prints {"event": "sent", "case"}.
"""
import argparse
import base64
import io
import json
import struct

import numpy as np
import zmq

import payload
from lines import leave, leaving, say, watch_stdin

STAMP = b"{timestamp:1700000000.25}"


def npy(array):
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def tagged(raw):
    return json.dumps({"__wrapyfi__": ["numpy.ndarray", base64.b64encode(raw).decode()]}).encode()


def lying_npy(shape, payload_bytes=64, descr="|u1"):
    """A .npy file whose header promises another size than what follows."""
    head = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    head += b" " * (-(10 + len(head) + 1) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + b"\0" * payload_bytes


GOOD_IMAGE = tagged(npy(payload.image(0)))
CASES = {
    # name: frames after the topic
    "native_truncated": [b'{"seq": 1, "list": [1, 2'],
    "native_empty": [b""],
    "native_not_utf8": [b"\xff\xfe\x00{"],
    "native_trailing": [b'{"a": 1} {"b": 2}'],
    "native_deep": [b"[" * 100_000 + b"]" * 100_000],
    "native_deep_tags": [b'{"__wrapyfi__": ["tuple", [' * 5000 + b"1" + b"]]}" * 5000],
    "native_huge_exponent": [b'{"n": 1e99999999999999999999}}'],
    "native_lying_npy": [b'{"a": ' + tagged(lying_npy("(1000000, 1000000)")) + b"}"],
    "native_overflow_npy": [b'{"a": ' + tagged(lying_npy("(4294967296, 4294967296, 4294967296)", descr="<f8")) + b"}"],
    "native_negative_npy": [b'{"a": ' + tagged(lying_npy("(-1, 64)")) + b"}"],
    "native_npy_no_newline": [b'{"a": ' + tagged(b"\x93NUMPY\x01\x00\xff\xff{'descr'") + b"}"],
    "native_bad_base64": [b'{"a": {"__wrapyfi__": ["numpy.ndarray", "@@@"]}}'],
    "native_no_body": [],
    "native_three_frames": [b"\x00\x01garbage", b"\xde\xad\xbe\xef"],
    "image_short": [STAMP, tagged(lying_npy("(48, 64, 3)"))],
    "image_one_dimension": [STAMP, tagged(npy(np.arange(10, dtype=np.uint8)))],
    "image_four_dimensions": [STAMP, tagged(npy(np.zeros((2, 2, 2, 2), np.uint8)))],
    "image_seven_channels": [STAMP, tagged(npy(np.zeros((4, 4, 7), np.uint8)))],
    "image_text_array": [STAMP, tagged(npy(np.array([["a", "b"]])))],
    "image_not_json": [STAMP, b"\x89PNG\r\n\x1a\n" + bytes(100)],
    "image_empty_body": [STAMP, b""],
    "image_header_only": [STAMP],
    "image_body_only": [GOOD_IMAGE],
    "image_truncated": [STAMP, GOOD_IMAGE[: len(GOOD_IMAGE) // 2]],
    "image_three_garbage": [b"\x00", b"\x01" * 300],
    "image_pickle": [STAMP, tagged(lying_npy("(1,)", 16, "|O"))],
    "jpeg_garbage": [STAMP, b"\xff\xd8\xff\xe0" + b"\x55" * 500],
    "jpeg_empty": [STAMP, b""],
    "audio_lying_size": [STAMP, b'{"__wrapyfi__": ["tuple", [9999, 2, 16000, ' + tagged(npy(payload.audio(0))) + b"]]}"],
    "audio_negative": [STAMP, b'{"__wrapyfi__": ["tuple", [-1, 1, 16000, ' + tagged(npy(payload.audio(0))) + b"]]}"],
    "audio_not_a_tuple": [STAMP, b'{"chunk": 1}'],
    "audio_huge_rate": [STAMP, b'{"__wrapyfi__": ["tuple", [441, 1, 1e400, ' + tagged(npy(payload.audio(0))) + b"]]}"],
    # Matches a subscription of the topic by prefix, as ZeroMQ does, but is another topic.
    "other_topic_by_prefix": None,
}

parser = argparse.ArgumentParser()
parser.add_argument("--topic", default="/x")
parser.add_argument("--sub-port", type=int, default=0)
parser.add_argument("--cases", required=True)
args = parser.parse_args()
if args.cases == "list":
    say("cases", names=sorted(CASES))
    raise SystemExit(0)
names = args.cases.split(",")
unknown = [n for n in names if n not in CASES]
if unknown:
    parser.error(f"unknown cases: {', '.join(unknown)}")

watch_stdin()
context = zmq.Context()
socket = context.socket(zmq.XPUB)
socket.setsockopt(zmq.XPUB_VERBOSE, 1)
socket.connect(f"tcp://127.0.0.1:{args.sub_port}")
say("ready", role="raw")
topic, subscribed = args.topic.encode(), False
while not subscribed and not leaving.is_set():
    if socket.poll(50):
        heard = socket.recv()
        subscribed = heard[:1] == b"\x01" and topic.startswith(heard[1:])
for name in names if subscribed else []:
    frames = CASES[name]
    if frames is None:
        socket.send_multipart([topic + b"_other", b'{"seq": 0}'])
    else:
        socket.send_multipart([topic, *frames])
    say("sent", case=name)
say("done", count=len(names))
leaving.wait()
socket.close(linger=1000)
context.term()
leave(0)
