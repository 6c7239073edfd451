#!/usr/bin/env python3
"""Asks a node for parameters, as a client on rmw_cyclonedds_cpp does, confined to the loopback interface.

    param_peer.py --node /camera --client 81985529216486895 rate lens.label , nothing

Each call names parameters; a comma stands between calls. The domain is ROS_DOMAIN_ID. Lines on stdout:
`ready`, `reply` for each call, `done`. The types are written by hand: requests and replies begin with the
client's number and that of the call, which the server sends back.
"""
import argparse
import os
import time
import traceback
from dataclasses import dataclass

parser = argparse.ArgumentParser()
parser.add_argument("--node", required=True)
parser.add_argument("--client", type=int, required=True)
parser.add_argument("names", nargs="+")
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

from lines import leave, leaving, say, watch_stdin  # noqa: E402

AGAIN_S = 1.0  # a request may come before the server knows its client; it is asked again
GIVE_UP_S = 100.0


@dataclass
class Value(IdlStruct, typename="rcl_interfaces.msg.dds_.ParameterValue_"):
    type: types.uint8
    bool_value: bool
    integer_value: types.int64
    double_value: types.float64
    string_value: str
    byte_array_value: types.sequence[types.uint8]
    bool_array_value: types.sequence[bool]
    integer_array_value: types.sequence[types.int64]
    double_array_value: types.sequence[types.float64]
    string_array_value: types.sequence[str]


@dataclass
class Request(IdlStruct, typename="rcl_interfaces.srv.dds_.GetParameters_Request_"):
    client: types.uint64
    sequence: types.int64
    names: types.sequence[str]


@dataclass
class Reply(IdlStruct, typename="rcl_interfaces.srv.dds_.GetParameters_Response_"):
    client: types.uint64
    sequence: types.int64
    values: types.sequence[Value]


def ask(participant):
    end = "clientid= 1.10.26.7e.f1.b1.e9.b5.5b.8c.25.64.0.0.0.9;"
    qos = Qos(Policy.Reliability.Reliable(duration(infinite=True)), Policy.Durability.Volatile,
              Policy.History.KeepLast(1000), Policy.DataRepresentation(use_cdrv0_representation=True),
              Policy.Userdata(end.encode()))
    service = f"{args.node}/get_parameters"
    reader = DataReader(participant, Topic(participant, f"rr{service}Reply", Reply), qos=qos)
    writer = DataWriter(participant, Topic(participant, f"rq{service}Request", Request), qos=qos)
    say("ready")
    give_up = time.monotonic() + GIVE_UP_S
    while not (writer.get_publication_matched_status().current_count
               and reader.get_subscription_matched_status().current_count):
        if leaving.wait(0.01) or time.monotonic() > give_up:
            raise SystemExit(f"nobody serves {service}")
    sequence = 0
    for call in " ".join(args.names).split(","):
        asked, answered, again = {}, None, 0.0
        while answered is None:
            if leaving.is_set() or time.monotonic() > give_up:
                raise SystemExit(f"{service} was not answered")
            if time.monotonic() >= again:
                sequence += 1
                asked[sequence] = call
                writer.write(Request(args.client, sequence, call.split()))
                again = time.monotonic() + AGAIN_S
            for reply in reader.take(32):
                # Those of other clients come too.
                if reply.client == args.client and reply.sequence in asked:
                    answered = reply
            leaving.wait(0.005)
        say("reply", names=call.split(), sequence=answered.sequence,
            values=[{name: getattr(v, name) for name in ("type", "integer_value", "string_value")}
                    for v in answered.values])
    say("done")


if __name__ == "__main__":
    watch_stdin()
    try:
        ask(DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0"))))
    except SystemExit:
        raise
    except Exception:  # the test reads the reason on stderr
        traceback.print_exc()
        leave(1)
    leave(0)
