#!/usr/bin/env python3
"""A DDS program on CycloneDDS that speaks ROS 2's names and types, confined to the loopback interface.

    cyclone_peer.py subscribe --topic /cam --type sensor_msgs/msg/Image --count 3 [--cdr]
    cyclone_peer.py publish   --topic /cam --type sensor_msgs/msg/Image --flavour red --count 0
    cyclone_peer.py publish   --topic /x --type wrapyfi_msgs/msg/NativeObject --case pandasframe
    cyclone_peer.py graph

The domain is ROS_DOMAIN_ID. Lines on stdout: `ready`, `matched`, `message`, `node`, `endpoint`, `gone`,
`done`. CDR is written and read by cyclonedds' own Python codec, from rosbags' type definitions; with --case,
an object of plugins.py, native objects are made and read by wrapyfi_py.
"""
import argparse
import base64
import hashlib
import io
import json
import os
import re
import time
import traceback

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["subscribe", "publish", "crowd", "graph"])
parser.add_argument("--topic")
parser.add_argument("--type")
parser.add_argument("--count", type=int, default=0, help="0: until stdin closes")
parser.add_argument("--rate", type=float, default=20.0)
parser.add_argument("--flavour")
parser.add_argument("--case", help="an object of another library, by its name in plugins.py, instead of a flavour")
parser.add_argument("--encoding", default="", help="image encoding; default by flavour")
parser.add_argument("--frame-id", default="")
parser.add_argument("--plain", action="store_true", help="only the fields of what is received")
parser.add_argument("--text", help="std_msgs/msg/String: the text itself, with {n} for the number")
parser.add_argument("--best-effort", action="store_true")
parser.add_argument("--transient-local", action="store_true")
parser.add_argument("--fields", type=json.loads, help="publish a message with these fields, JSON without blanks")
parser.add_argument("--depth", type=int, default=50)
parser.add_argument("--lose", type=int, default=0, help="packets that are not sent, of a thousand")
parser.add_argument("--hash", help="type hash to announce instead of the right one")
parser.add_argument("--humble-node", help="announce the endpoint as this node's, as ROS 2 Humble does")
parser.add_argument("--cdr", action="store_true", help="print the payload as received, in hex")
args = parser.parse_args()
if args.role != "graph" and not (args.topic and args.type):
    parser.error("--topic and --type are needed")

# Who loses packets loses the one in which it announces itself, too, and by default says it again 30 s later.
AGAIN = "<SPDPInterval>500ms</SPDPInterval>" if args.lose else ""
LOOPBACK = f"""<CycloneDDS><Domain Id="any">
  <General><Interfaces><NetworkInterface name="lo"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
  <Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
    <Peers><Peer address="127.0.0.1"/></Peers>{AGAIN}</Discovery>
  <Internal><Test><XmitLossiness>{args.lose}</XmitLossiness></Test></Internal>
</Domain></CycloneDDS>"""
os.environ["CYCLONEDDS_URI"] = LOOPBACK  # read when the domain is created: always loopback

import numpy as np  # noqa: E402
from cyclonedds.builtin import (BuiltinDataReader, BuiltinTopicDcpsPublication,  # noqa: E402
                                BuiltinTopicDcpsSubscription)
from cyclonedds._clayer import ddspy_take  # noqa: E402
from cyclonedds.core import InstanceState, Policy, Qos, SampleState, ViewState  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.idl import make_idl_struct  # noqa: E402
from cyclonedds.idl import types as idl  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from cyclonedds.util import duration  # noqa: E402

import interfaces  # noqa: E402
import payload  # noqa: E402
from lines import leave, leaving, say, watch_stdin  # noqa: E402

if args.case:
    import sys
    import types
    sys.path.insert(0, str(interfaces.ROOT / "wrapyfi_py"))
    import plugins
    import wrapyfi_py
    CASE = plugins.CASES[args.case]

STORE = interfaces.store()
BASE = {"bool": bool, "byte": idl.uint8, "char": idl.uint8, "octet": idl.uint8, "float32": idl.float32,
        "float64": idl.float64, "string": str}
BASE.update({f"{sign}int{bits}": getattr(idl, f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)})
_made = {}


def idl_type(node):
    kind, detail = node
    if kind.name == "BASE":
        name, bound = detail
        return idl.bounded_str[bound] if name == "string" and bound else BASE[name]
    if kind.name == "NAME":
        return struct(detail)
    element, length = idl_type(detail[0]), detail[1]
    if kind.name == "ARRAY":
        return idl.array[element, length]
    return idl.sequence[element, length] if length else idl.sequence[element]


def struct(ros_type):
    """The cyclonedds class of a ROS type, under its DDS name."""
    if ros_type not in _made:
        fields = {name: idl_type(node) for name, node in STORE.fielddefs[ros_type][1]}
        fields = fields or {"structure_needs_at_least_one_member": idl.uint8}
        name = interfaces.dds_name(ros_type)
        _made[ros_type] = make_idl_struct(name.rsplit("::", 1)[1], name.replace("::", "."), fields)
    return _made[ros_type]


def blank(ros_type):
    """A message with every field zero or empty."""
    values = {}
    for name, (kind, detail) in STORE.fielddefs[ros_type][1]:
        if kind.name == "NAME":
            values[name] = blank(detail)
        elif kind.name == "BASE":
            values[name] = "" if detail[0] == "string" else False if detail[0] == "bool" else 0
        elif kind.name == "ARRAY":
            values[name] = [0] * detail[1]
        else:
            values[name] = []
    return struct(ros_type)(**values)


def fill(message, fields):
    for name, value in fields.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


def qos(user_data=b""):
    infinite = duration(infinite=True)
    found = Qos(Policy.Reliability.BestEffort if args.best_effort else Policy.Reliability.Reliable(infinite),
                Policy.Durability.TransientLocal if args.transient_local else Policy.Durability.Volatile,
                Policy.History.KeepLast(args.depth),
                Policy.DataRepresentation(use_cdrv0_representation=True))
    if args.transient_local and args.role == "publish":  # as rmw_cyclonedds_cpp: what is kept for late subscribers
        kept = Policy.History.KeepLast(args.depth)
        found += Qos(Policy.DurabilityService(0, kept, max_samples=-1, max_instances=-1, max_samples_per_instance=-1))
    return found + Qos(Policy.Userdata(user_data)) if user_data else found


# Messages ------------------------------------------------------------------------------------------


def case_message(seq):
    """The message that wrapyfi_py makes of a case's object, filled into cyclonedds' own classes."""
    def maker(ros_type):
        # cyclonedds takes lists and bytes alone.
        return lambda **fields: fill(blank(ros_type), {
            name: bytes(value) if name == "data" else list(value) if name == "shape" else value
            for name, value in fields.items()})

    made = types.SimpleNamespace(**{name: maker(f"wrapyfi_msgs/msg/{name}") for name in ("NativeObject", "Tensor")})
    return wrapyfi_py.from_python({"object": CASE.make(seq)}, messages=made)


def case_facts(value):
    found = CASE.facts(value["object"])
    return {"sha256": plugins.digest(found), "facts": found}


def make(seq):
    """Message number `seq` of a flavour, and the hashes a receiver must find."""
    if args.case:
        message = case_message(seq)
        return message, case_facts({"object": CASE.make(seq)})
    message, flavour = blank(args.type), args.flavour
    if hasattr(message, "header"):
        now = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = now // 10 ** 9, now % 10 ** 9
        message.header.frame_id = args.frame_id
    if args.fields is not None:
        return fill(message, args.fields), {"fields": args.fields}
    if args.type == "std_msgs/msg/String" and args.text is not None:
        message.data = args.text.replace("{n}", str(seq))
        return message, {"value": message.data}
    if args.type == "std_msgs/msg/String":
        value = payload.native(seq, flavour or "small")
        message.data = encode_json(value)
        return message, {"sha256": payload.digest(value)}
    if args.type == "geometry_msgs/msg/Twist":
        message.linear.x, message.angular.z = seq + 0.5, -1.25
        return message, {}
    if args.type == "sensor_msgs/msg/Image":
        frame = payload.image(seq, flavour or "colour")
        encoding = args.encoding or {"mono": "mono8", "float": "32FC3", "float_mono": "32FC1"}.get(flavour, "bgr8")
        sent = frame[..., ::-1] if encoding == "rgb8" else frame
        message.height, message.width = frame.shape[:2]
        message.encoding, message.step = encoding, frame.strides[0]
        message.data = sent.tobytes()
        return message, {"sha256": payload.digest(frame)}
    if args.type == "sensor_msgs/msg/CompressedImage":
        import cv2
        frame = payload.image(seq, flavour or "jpg")
        data = cv2.imencode(".jpg", frame)[1].tobytes()
        message.format, message.data = "jpeg", data
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        return message, {"sha256": hashlib.sha256(data).hexdigest(), "decoded_sha256": payload.digest(pixels)}
    if args.type in ("wrapyfi_msgs/msg/AudioChunk", "wrapyfi_ros2_interfaces/msg/ROS2AudioMessage"):
        sound = payload.audio(seq, 441, 2 if flavour == "stereo" else 1)
        message.chunk_size, message.channels, message.sample_rate = *sound.shape, 16000
        message.encoding = "FLOAT32LE" if args.type.startswith("wrapyfi_msgs") else "S16LE"
        message.step, message.data = sound.strides[0], sound.tobytes()
        return message, {"sha256": payload.digest(sound)}
    if args.type == "wrapyfi_msgs/msg/NativeObject":
        value = payload.native(seq, flavour or "small")
        message.json = json.dumps(take_out(json.loads(encode_json(value)), message.tensors))
        return message, {"sha256": payload.digest(value)}
    raise SystemExit(f"no payload for {args.type}")


def encode_json(value):
    from wrapyfi.utils.serialization_encoders import JsonEncoder
    return json.dumps(value, cls=JsonEncoder)


def take_out(found, tensors):
    """Replaces the arrays inside parsed JSON by their index in `tensors`, as our NativeObject has it."""
    if isinstance(found, list):
        return [take_out(v, tensors) for v in found]
    if not isinstance(found, dict):
        return found
    tag = found.get("__wrapyfi__")
    if isinstance(tag, list) and tag[0] == "numpy.ndarray":
        array = np.load(io.BytesIO(base64.b64decode(tag[1])))
        tensor = blank("wrapyfi_msgs/msg/Tensor")
        tensor.dtype, tensor.shape, tensor.data = array.dtype.name, list(array.shape), array.tobytes()
        tensors.append(tensor)
        return {"__wrapyfi__": ["tensor", len(tensors) - 1]}
    return {k: take_out(v, tensors) for k, v in found.items()}


def decode_json(text, tensors=()):
    """A native object from its JSON; in our NativeObject, arrays stand outside it."""
    from wrapyfi.utils.serialization_encoders import JsonDecodeHook
    usual = JsonDecodeHook().object_hook

    def hook(found):
        tag = found.get("__wrapyfi__")
        if isinstance(tag, list) and tag[0] == "tensor":
            tensor = tensors[tag[1]]
            array = np.frombuffer(bytes(tensor.data), np.dtype(tensor.dtype).newbyteorder("<"))
            return array.reshape([int(n) for n in tensor.shape])
        return usual(found)

    return json.loads(text, object_hook=hook)


def facts(message):
    """Fields of a message; byte arrays by length and hash, native objects by digest too."""
    found = {"fields": plain(message)}
    if args.case:
        return found | case_facts(wrapyfi_py.to_python(message))
    if args.plain:
        return found
    if hasattr(message, "header"):
        found["stamp"] = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
    if hasattr(message, "data") and not isinstance(message.data, str):
        found["sha256"] = hashlib.sha256(bytes(message.data)).hexdigest()
        if getattr(message, "encoding", "") in ("bgr8", "rgb8"):
            flat = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
            pixels = flat[:, : message.width * 3].reshape(message.height, message.width, 3)
            found["channel_means"] = [float(pixels[..., c].mean()) for c in range(3)]
        return found
    text, tensors = None, ()
    if args.type == "std_msgs/msg/String":
        text = message.data
    elif args.type == "wrapyfi_msgs/msg/NativeObject":
        text, tensors = message.json, message.tensors
    if text is not None:
        try:
            value = decode_json(text, tensors)
            found.update(sha256=payload.digest(value), value=payload.neutral(value))
        except Exception as problem:
            found["undecodable"] = f"{type(problem).__name__}: {problem}"
    return found


def plain(value):
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__}
    if isinstance(value, (bytes, bytearray)) or isinstance(value, (list, tuple)) and len(value) > 32 and isinstance(value[0], int):
        return {"bytes": len(value), "sha256": hashlib.sha256(bytes(v & 255 for v in value)).hexdigest()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    return value


# Roles ---------------------------------------------------------------------------------------------


def take(reader):
    """Samples with their bytes as they were on the wire, encapsulation header included."""
    any_state = SampleState.Any | ViewState.Any | InstanceState.Any
    found = ddspy_take(reader._ref, any_state, 32)
    if isinstance(found, int):
        raise RuntimeError(f"taking samples failed: {found}")
    return [(bytes(data), info) for data, info in found if info.valid_data]


def endpoint_setup(participant):
    user_data = f"typehash={args.hash or STORE.hash_rihs01(args.type)};".encode()
    return Topic(participant, "rt" + args.topic, struct(args.type)), qos(user_data)


def announce_as_humble(participant, writer):
    """ros_discovery_info with GIDs of 24 bytes, the layout before Iron."""
    prefix = "rmw_dds_common.msg.dds_"
    gid = make_idl_struct("Gid_", f"{prefix}.Gid_", {"data": idl.array[idl.uint8, 24]})
    node = make_idl_struct("NodeEntitiesInfo_", f"{prefix}.NodeEntitiesInfo_", {
        "node_namespace": str, "node_name": str, "reader_gid_seq": idl.sequence[gid], "writer_gid_seq": idl.sequence[gid]})
    kind = make_idl_struct("ParticipantEntitiesInfo_", f"{prefix}.ParticipantEntitiesInfo_", {
        "gid": gid, "node_entities_info_seq": idl.sequence[node]})
    how = Qos(Policy.Reliability.Reliable(duration(infinite=True)), Policy.Durability.TransientLocal, Policy.History.KeepLast(1),
              Policy.DataRepresentation(use_cdrv0_representation=True))
    announcer = DataWriter(participant, Topic(participant, "ros_discovery_info", kind), qos=how)
    padded = [gid(data=list(entity.guid.bytes) + [0] * 8) for entity in (participant, writer)]
    announcer.write(kind(gid=padded[0], node_entities_info_seq=[
        node(node_namespace="/", node_name=args.humble_node, reader_gid_seq=[], writer_gid_seq=[padded[1]])]))
    return announcer


def subscribe(participant):
    topic, how = endpoint_setup(participant)
    reader = DataReader(participant, topic, qos=how)
    say("ready", role="subscribe")
    index, matched = 0, 0
    while not leaving.is_set() and (args.count == 0 or index < args.count):
        # Not the list of handles: it fails where a publication is matched while it is made.
        now = reader.get_subscription_matched_status().current_count
        if now != matched:
            matched = now
            say("matched", count=now)
        batch = take(reader)
        for raw, _info in batch:
            if args.count and index >= args.count:
                break
            message = struct(args.type).deserialize(raw)
            say("message", index=index, **facts(message), **({"cdr": raw.hex()} if args.cdr else {}))
            index += 1
        if not batch:
            leaving.wait(0.005)
    say("done", count=index)


def publish(participant):
    topic, how = endpoint_setup(participant)
    writer = DataWriter(participant, topic, qos=how)
    announcer = announce_as_humble(participant, writer) if args.humble_node else None  # kept while publishing
    say("ready", role="publish")
    while not leaving.is_set() and not writer.get_publication_matched_status().current_count:
        leaving.wait(0.02)
    say("matched", count=writer.get_publication_matched_status().current_count)
    index = 0
    while not leaving.is_set() and (args.count == 0 or index < args.count):
        message, hashes = make(index)
        writer.write(message)
        say("message", index=index, **hashes)
        index += 1
        leaving.wait(1.0 / args.rate)
    if not args.best_effort and not leaving.is_set():
        writer.wait_for_acks(duration(seconds=30))
    say("done", count=index)
    leaving.wait()


def crowd(participant):
    """A writer of texts on each of the topics TOPIC_0, TOPIC_1, ..., as many as --count says."""
    kind = struct(args.type)
    writers = [DataWriter(participant, Topic(participant, f"rt{args.topic}_{number}", kind), qos=qos())
               for number in range(args.count)]
    say("ready", role="crowd")
    round = 0
    while not leaving.is_set():
        for writer in writers:
            writer.write(kind(data=str(round)))
        round += 1
        leaving.wait(1.0 / args.rate)


def times(found):
    """Deadline, lifespan, liveliness and lease of an endpoint; times that are infinite or absent as None."""
    def ms(policy, field):
        value = getattr(found[policy], field) if policy in found else None
        return None if value is None or value >= duration(infinite=True) else value / 1e6

    return {"deadline_ms": ms(Policy.Deadline, "deadline"), "lifespan_ms": ms(Policy.Lifespan, "lifespan"),
            "lease_ms": ms(Policy.Liveliness, "lease_duration"),
            "liveliness": type(found[Policy.Liveliness]).__name__.split(".")[-1] if Policy.Liveliness in found else None}


def graph(participant):
    """Nodes from ros_discovery_info, endpoints with their type hash from DDS discovery."""
    kind = "rmw_dds_common/msg/ParticipantEntitiesInfo"
    reliable = Qos(Policy.Reliability.Reliable(duration(infinite=True)), Policy.Durability.TransientLocal,
                   Policy.History.KeepAll, Policy.DataRepresentation(use_cdrv0_representation=True))
    nodes = DataReader(participant, Topic(participant, "ros_discovery_info", struct(kind)), qos=reliable)
    builtin = [("writer", BuiltinDataReader(participant, BuiltinTopicDcpsPublication)),
               ("reader", BuiltinDataReader(participant, BuiltinTopicDcpsSubscription))]
    say("ready", role="graph")
    while not leaving.is_set():
        for raw, _info in take(nodes):
            info = struct(kind).deserialize(raw)
            seen = [{"name": "/".join([n.node_namespace.rstrip("/"), n.node_name]),
                     "readers": [bytes(g.data).hex() for g in n.reader_gid_seq],
                     "writers": [bytes(g.data).hex() for g in n.writer_gid_seq]} for n in info.node_entities_info_seq]
            say("nodes", participant=bytes(info.gid.data).hex(), nodes=seen)
        for role, reader in builtin:
            for found in reader.take(64):
                if not found.sample_info.valid_data:
                    say("gone", role=role, guid=found.key.bytes.hex())
                elif found.participant_key != participant.guid:
                    user_data = bytes(found.qos[Policy.Userdata].data) if Policy.Userdata in found.qos else b""
                    hashes = re.findall(rb"typehash=(RIHS01_[0-9a-f]{64})", user_data)
                    say("endpoint", role=role, guid=found.key.bytes.hex(), topic=found.topic_name,
                        type=found.type_name, user_data=user_data.decode("latin-1"),
                        hash=hashes[0].decode() if hashes else None,
                        reliable=isinstance(found.qos[Policy.Reliability], Policy.Reliability.Reliable),
                        durability=str(found.qos[Policy.Durability]).split(".")[-1], **times(found.qos))
        leaving.wait(0.02)


if __name__ == "__main__":
    watch_stdin()
    try:
        domain = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
        {"subscribe": subscribe, "publish": publish, "crowd": crowd, "graph": graph}[args.role](domain)
    except Exception:  # the test reads the reason on stderr
        traceback.print_exc()
        leave(1)
    leave(0)
