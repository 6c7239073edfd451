#!/usr/bin/python3
"""Servers and clients of dynamic_reconfigure, with Debian's Python.

    reconfigure_peer.py serve --server /x [--node NAME]    a server of dynamic_reconfigure's own TestConfig
    reconfigure_peer.py lie   --server /x [--count N]      what no generator makes: a range the wrong way round, an enum
                                                           that is none, a type that is none, N parameters
    reconfigure_peer.py set   --server /x --value JSON     sets as rqt_reconfigure and dynparam do
    reconfigure_peer.py get   --server /x                  prints the values, and at every change

The server makes int_ odd and refuses the str_ "no". Lines on stdout: {"event": "ready"}, {"event": "config", "value"}.
"""
import argparse
import json

import rospy
from dynamic_reconfigure.cfg import TestConfig
from dynamic_reconfigure.client import Client
from dynamic_reconfigure.msg import Config, ConfigDescription, Group, IntParameter, ParamDescription
from dynamic_reconfigure.server import Server
from dynamic_reconfigure.srv import Reconfigure

from lines import leave, leaving, say, watch_stdin

parser = argparse.ArgumentParser()
parser.add_argument("role", choices=["serve", "lie", "set", "get"])
parser.add_argument("--server", default="/x")
parser.add_argument("--node", default="reconfigure_peer")
parser.add_argument("--value", default="{}")
parser.add_argument("--count", type=int, default=0)
args = parser.parse_args()

watch_stdin()
rospy.init_node(args.node, anonymous=args.role in ("set", "get"), disable_signals=True)


def plain(config):
    return {name: value for name, value in config.items() if name != "groups"}


def serve():
    def made(config, level):
        if config["str_"] == "no":
            raise ValueError("str_ is never no")
        config["int_"] |= 1
        say("config", value=plain(config))
        return config

    Server(TestConfig, made, args.server)
    say("ready")
    leaving.wait()


def lie():
    names = ["turned", "unreadable", "odd"] + [f"p{number}" for number in range(args.count)]
    kinds = {"odd": "complex"}
    edits = {"unreadable": "{'enum': [__import__('os').abort()]}"}
    told = [ParamDescription(it, kinds.get(it, "int"), 0, "", edits.get(it, "")) for it in names]
    low = Config(ints=[IntParameter(it, 9 if it == "turned" else 0) for it in names])
    high = Config(ints=[IntParameter(it, 5) for it in names])
    now = Config(ints=[IntParameter(it, 3) for it in names])
    rospy.Service(f"{args.server}/set_parameters", Reconfigure, lambda request: {"config": request.config})
    descriptions = rospy.Publisher(f"{args.server}/parameter_descriptions", ConfigDescription, latch=True, queue_size=1)
    updates = rospy.Publisher(f"{args.server}/parameter_updates", Config, latch=True, queue_size=1)
    descriptions.publish(ConfigDescription(groups=[Group("Default", "", told, 0, 0)], max=high, min=low, dflt=now))
    updates.publish(now)
    say("ready")
    leaving.wait()


def change():
    client = Client(args.server, timeout=60)
    say("config", value=plain(client.update_configuration(json.loads(args.value))))


def watch():
    Client(args.server, timeout=60, config_callback=lambda config: say("config", value=plain(config)))
    say("ready")
    leaving.wait()


{"serve": serve, "lie": lie, "set": change, "get": watch}[args.role]()
leave()
