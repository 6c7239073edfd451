#!/usr/bin/env python3
"""Three results on three middlewares, the twin of examples/communicator/src/bin/channeling.rs. Without YARP
and ROS 2 in this Python the first two are None.

    python test/peers/channeling.py --mode listen
"""
import argparse
import os
import time

# A broker runs already: `wrapyfi broker`, or a publisher in Rust.
os.environ.setdefault("WRAPYFI_ZEROMQ_START_PROXY_BROKER", "False")
os.environ.setdefault("WRAPYFI_ZEROMQ_PUBSUB_MONITOR_LISTENER_SPAWN", "thread")

import numpy as np  # noqa: E402
from wrapyfi.connect.wrapper import MiddlewareCommunicator  # noqa: E402

import payload  # noqa: E402
from lines import say  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("--mode", default=None)
args = parser.parse_args()


class ChannelCls(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("NativeObject", "yarp", "ChannelCls", "/example/native_yarp_msg",
                                     carrier="mcast", should_wait=False)
    @MiddlewareCommunicator.register("Image", "ros2", "ChannelCls", "/example/image_ros_msg",
                                     carrier="tcp", width="$img_width", height="$img_height", rgb=True,
                                     queue_size=10, should_wait=False)
    @MiddlewareCommunicator.register("AudioChunk", "zeromq", "ChannelCls", "/example/audio_zmq_msg",
                                     carrier="tcp", rate="$aud_rate", chunk="$aud_chunk", channels="$aud_chann",
                                     should_wait=False)
    def read_mulret_mulmware(self, img_width=200, img_height=100, aud_rate=44100, aud_chunk=8820, aud_chann=1):
        image = np.random.randint(256, size=(img_height, img_width, 3), dtype=np.uint8)
        sound = (np.random.uniform(-1, 1, (aud_chunk, aud_chann)).astype(np.float32), aud_rate)
        return [image, sound], image, sound


def main():
    channels = ChannelCls()
    channels.activate_communication(channels.read_mulret_mulmware, mode=args.mode)
    while True:
        obj, image, sound = channels.read_mulret_mulmware(
            img_width=200, img_height=100, aud_rate=44100, aud_chunk=8820, aud_chann=1)
        if sound is not None and sound[0] is not None:
            say("message", object=obj is not None, image=image is not None,
                sound={"shape": list(sound[0].shape), "rate": int(sound[1]), "sha256": payload.digest(sound[0])})
        time.sleep(0.01)


if __name__ == "__main__":
    main()
