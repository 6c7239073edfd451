#!/usr/bin/env python3
"""A node with parameters, as one on rmw_cyclonedds_cpp has them, confined to the loopback interface.

    param_node.py --node /camera '{"rate": 10, "gain": 1.5, "label": "left", "ids": [1, 2]}'

It serves list, get, get types and set, and tells its changes on /parameter_events. `rate` may be 1 to 60,
what is called `serial` is read-only, and types do not change, with the texts of rclpy. A JSON object on
stdin sets parameters of its own, null deletes. The domain is ROS_DOMAIN_ID. Lines on stdout: `ready`, `heard`
with the number of readers of its events, `set` for what others set. The types are written by hand.
"""
import argparse
import json
import os
import queue
import sys
import threading
import time
import traceback
from dataclasses import dataclass

parser = argparse.ArgumentParser()
parser.add_argument("--node", required=True)
parser.add_argument("parameters", nargs="+", help="JSON; blanks in it are fine")
args = parser.parse_args()

LOOPBACK = """<CycloneDDS><Domain Id="any">
  <General><Interfaces><NetworkInterface name="lo"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
  <Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
    <Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""
os.environ["CYCLONEDDS_URI"] = LOOPBACK  # read when the domain is created: always loopback

from cyclonedds.core import Policy, Qos  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.idl import IdlStruct, types  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from cyclonedds.util import duration  # noqa: E402

from lines import leave, leaving, say  # noqa: E402

MSG, SRV = "rcl_interfaces.msg.dds_.", "rcl_interfaces.srv.dds_."
commands = queue.Queue()


@dataclass
class Value(IdlStruct, typename=MSG + "ParameterValue_"):
    type: types.uint8 = 0
    bool_value: bool = False
    integer_value: types.int64 = 0
    double_value: types.float64 = 0.0
    string_value: str = ""
    byte_array_value: types.sequence[types.uint8] = ()
    bool_array_value: types.sequence[bool] = ()
    integer_array_value: types.sequence[types.int64] = ()
    double_array_value: types.sequence[types.float64] = ()
    string_array_value: types.sequence[str] = ()


@dataclass
class Parameter(IdlStruct, typename=MSG + "Parameter_"):
    name: str
    value: Value


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: types.int32
    nanosec: types.uint32


@dataclass
class ParameterEvent(IdlStruct, typename=MSG + "ParameterEvent_"):
    stamp: Time
    node: str
    new_parameters: types.sequence[Parameter]
    changed_parameters: types.sequence[Parameter]
    deleted_parameters: types.sequence[Parameter]


@dataclass
class Listed(IdlStruct, typename=MSG + "ListParametersResult_"):
    names: types.sequence[str]
    prefixes: types.sequence[str]


@dataclass
class Result(IdlStruct, typename=MSG + "SetParametersResult_"):
    successful: bool
    reason: str


@dataclass
class ListRequest(IdlStruct, typename=SRV + "ListParameters_Request_"):
    client: types.uint64
    sequence: types.int64
    prefixes: types.sequence[str]
    depth: types.uint64


@dataclass
class ListReply(IdlStruct, typename=SRV + "ListParameters_Response_"):
    client: types.uint64
    sequence: types.int64
    result: Listed


@dataclass
class GetRequest(IdlStruct, typename=SRV + "GetParameters_Request_"):
    client: types.uint64
    sequence: types.int64
    names: types.sequence[str]


@dataclass
class GetReply(IdlStruct, typename=SRV + "GetParameters_Response_"):
    client: types.uint64
    sequence: types.int64
    values: types.sequence[Value]


@dataclass
class TypesRequest(IdlStruct, typename=SRV + "GetParameterTypes_Request_"):
    client: types.uint64
    sequence: types.int64
    names: types.sequence[str]


@dataclass
class TypesReply(IdlStruct, typename=SRV + "GetParameterTypes_Response_"):
    client: types.uint64
    sequence: types.int64
    types: types.sequence[types.uint8]


@dataclass
class SetRequest(IdlStruct, typename=SRV + "SetParameters_Request_"):
    client: types.uint64
    sequence: types.int64
    parameters: types.sequence[Parameter]


@dataclass
class SetReply(IdlStruct, typename=SRV + "SetParameters_Response_"):
    client: types.uint64
    sequence: types.int64
    results: types.sequence[Result]


FIELDS = ["", "bool_value", "integer_value", "double_value", "string_value", "byte_array_value",
          "bool_array_value", "integer_array_value", "double_array_value", "string_array_value"]
TYPES = ["NOT_SET", "BOOL", "INTEGER", "DOUBLE", "STRING", "BYTE_ARRAY", "BOOL_ARRAY", "INTEGER_ARRAY",
         "DOUBLE_ARRAY", "STRING_ARRAY"]
SCALARS = {bool: 1, int: 2, float: 3, str: 4}


def kind(value):
    if isinstance(value, list):
        return 5 + SCALARS[type(value[0])] if value else 7
    return 0 if value is None else SCALARS[type(value)]


def message(value):
    number = kind(value)
    blank = Value(0, False, 0, 0.0, "", [], [], [], [], [])
    blank.type = number
    if number:
        setattr(blank, FIELDS[number], value)
    return blank


def content(value):
    return getattr(value, FIELDS[value.type]) if value.type else None


def fault(have, name, value):
    """Why a parameter cannot have a value, as rclpy says it; nothing where it can."""
    if name not in have:
        return "Invalid access to undeclared parameter(s): []"
    if name == "serial":
        return f"Trying to set a read-only parameter: {name}."
    expected = kind(have[name])
    if value.type != expected:
        return f"Wrong parameter type, expected 'Type.{TYPES[expected]}' got 'Type.{TYPES[value.type]}'"
    if name == "rate" and not 1 <= value.integer_value <= 60:
        return f"Parameter rate out of range. Min: 1, Max: 60, value: {value.integer_value}"
    return ""


def client_of(endpoint):
    """What rmw_cyclonedds_cpp puts into USER_DATA of both endpoints of a client."""
    data = endpoint.qos[Policy.Userdata].data if endpoint and Policy.Userdata in endpoint.qos else b""
    return next((pair for pair in data.split(b";") if pair.startswith(b"clientid=")), None)


class Requests:
    """Requests whose client hears the reply: its reader may be found later than its writer, and what is
    written before that is lost. rmw_cyclonedds_cpp waits in the same way."""
    def __init__(self, reader, writer):
        self.reader, self.writer, self.waiting = reader, writer, []

    def take(self):
        # A client that leaves is a sample too, without content.
        for sample in self.reader.take(32):
            if hasattr(sample, "client"):
                asker = self.reader.get_matched_publication_data(sample.sample_info.publication_handle)
                self.waiting.append((client_of(asker), sample))
        if not self.waiting:
            return []
        try:
            readers = self.writer.get_matched_subscriptions()
        except IndexError:  # one was matched while the list was made: the next step asks again
            return []
        hearing = {client_of(self.writer.get_matched_subscription_data(handle)) for handle in readers}
        ready = [sample for client, sample in self.waiting if client is None or client in hearing]
        self.waiting = [(client, sample) for client, sample in self.waiting if client and client not in hearing]
        return ready


class Node:
    def __init__(self, participant, have):
        self.have = have
        self.servers = 0
        self.participant = participant
        self.events = DataWriter(participant, Topic(participant, "rt/parameter_events", ParameterEvent),
                                 qos=self.qos(b""))
        self.list = self.server("list_parameters", ListRequest, ListReply)
        self.get = self.server("get_parameters", GetRequest, GetReply)
        self.types = self.server("get_parameter_types", TypesRequest, TypesReply)
        self.set = self.server("set_parameters", SetRequest, SetReply)

    @staticmethod
    def qos(user_data):
        found = Qos(Policy.Reliability.Reliable(duration(infinite=True)), Policy.Durability.Volatile,
                    Policy.History.KeepLast(1000), Policy.DataRepresentation(use_cdrv0_representation=True))
        return found + Qos(Policy.Userdata(user_data)) if user_data else found

    def server(self, name, request, reply):
        self.servers += 1
        qos = self.qos(f"serviceid= 1.10.{os.getpid() & 255:x}.{os.getpid() >> 8 & 255:x}"
                       f".b1.e9.b5.5b.8c.25.64.0.0.0.0.{self.servers:x};".encode())
        service = f"{args.node}/{name}"
        reader = DataReader(self.participant, Topic(self.participant, f"rq{service}Request", request), qos=qos)
        writer = DataWriter(self.participant, Topic(self.participant, f"rr{service}Reply", reply), qos=qos)
        return Requests(reader, writer), writer

    def tell(self, new=(), changed=(), deleted=()):
        now = time.time_ns()
        stamp = Time(now // 10 ** 9 % 2 ** 31, now % 10 ** 9)
        self.events.write(ParameterEvent(stamp, args.node, list(new), list(changed), list(deleted)))

    def change(self, name, value):
        """As the node itself does."""
        if value is None:
            if self.have.pop(name, None) is not None:
                self.tell(deleted=[Parameter(name, message(None))])
            return
        known, self.have[name] = name in self.have, value
        parameter = [Parameter(name, message(value))]
        self.tell(changed=parameter) if known else self.tell(new=parameter)

    def step(self):
        """Answers what has arrived."""
        have = self.have
        requests, writer = self.list
        for request in requests.take():
            groups = {name.rsplit(".", 1)[0] for name in have if "." in name}
            writer.write(ListReply(request.client, request.sequence, Listed(list(have), sorted(groups))))
        requests, writer = self.get
        for request in requests.take():
            known = all(name in have for name in request.names)
            values = [message(have[name]) for name in request.names] if known else []
            writer.write(GetReply(request.client, request.sequence, values))
        requests, writer = self.types
        for request in requests.take():
            known = all(name in have for name in request.names)
            found = [kind(have[name]) for name in request.names] if known else []
            writer.write(TypesReply(request.client, request.sequence, found))
        requests, writer = self.set
        for request in requests.take():
            results = []
            for parameter in request.parameters:
                why = fault(have, parameter.name, parameter.value)
                results.append(Result(not why, why))
                if not why:
                    value = content(parameter.value)
                    have[parameter.name] = value
                    self.tell(changed=[parameter])
                    say("set", name=parameter.name, value=value)
            writer.write(SetReply(request.client, request.sequence, results))


def listen_to_stdin():
    for line in sys.stdin:
        commands.put(json.loads(line))
    leaving.set()


def main():
    node = Node(DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0"))), json.loads(" ".join(args.parameters)))
    say("ready")
    heard = 0
    while not leaving.is_set():
        node.step()
        readers = node.events.get_publication_matched_status().current_count
        if readers != heard:
            heard = readers
            say("heard", readers=readers)
        try:
            for name, value in commands.get_nowait().items():
                node.change(name, value)
        except queue.Empty:
            leaving.wait(0.005)


if __name__ == "__main__":
    import signal
    signal.signal(signal.SIGTERM, lambda *_: leaving.set())
    threading.Thread(target=listen_to_stdin, daemon=True).start()
    try:
        main()
    except Exception:  # the test reads the reason on stderr
        traceback.print_exc()
        leave(1)
    leave(0)
