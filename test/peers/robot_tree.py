"""The ports of a robot, as many as an iCub has, on YARP's own library.

Prints `ready` when all are open. Each output sends when somebody reads it: encoders and numbers at 100 Hz,
pictures at 30 Hz, words at 1 Hz. Ends at the end of its input.
"""

import argparse
import sys
import threading
import time

import yarp


def names(count):
    """Kind and name of each port: of ten, four outputs of numbers, two of words, a camera, inputs, rpc."""
    for number in range(count):
        part = f"/icub/part{number // 10}"
        yield [
            ("vector", f"{part}/state:o"),
            ("vector", f"{part}/stateOld:o"),
            ("bottle", f"{part}/events:o"),
            ("image", f"{part}/cam/left"),
            ("input", f"{part}/command:i"),
            ("rpc", f"{part}/rpc:i"),
            ("vector", f"{part}/inertial"),
            ("bottle", f"{part}/analog:o"),
            ("input", f"{part}/target:i"),
            ("vector", f"{part}/torques:o"),
        ][number % 10]


def opened(kind, name):
    """A port of a kind."""
    port = {
        "vector": yarp.BufferedPortVector,
        "image": yarp.BufferedPortImageRgb,
        "bottle": yarp.BufferedPortBottle,
        "input": yarp.BufferedPortVector,
        "rpc": yarp.RpcServer,
    }[kind]()
    if not port.open(name):
        sys.exit(f"no port {name}")
    return port


def send(kind, port):
    """Sends a message of the port's kind."""
    message = port.prepare()
    if kind == "vector":
        message.resize(6)
    elif kind == "image":
        message.resize(320, 240)
    else:
        message.clear()
        message.addString("hello")
        message.addFloat64(1.5)
    port.write()


def main():
    """Opens the ports, and sends until the input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ports", type=int, default=250)
    count = parser.parse_args().ports
    yarp.Network.init()
    ports = [(kind, opened(kind, name)) for kind, name in names(count)]
    ended = threading.Event()

    def run(kinds, period_s):
        mine = [(kind, port) for kind, port in ports if kind in kinds]
        while not ended.wait(period_s):
            for kind, port in mine:
                if port.getOutputCount() > 0:
                    send(kind, port)

    threads = [
        threading.Thread(target=run, args=(kinds, period_s))
        for kinds, period_s in [(("vector",), 0.01), (("image",), 1 / 30), (("bottle",), 1.0)]
    ]
    for thread in threads:
        thread.start()
    print("ready", time.time(), flush=True)
    sys.stdin.read()
    ended.set()
    for thread in threads:
        thread.join()
    for _, port in ports:
        port.close()
    yarp.Network.fini()


if __name__ == "__main__":
    main()
