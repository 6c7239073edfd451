"""Channeling: three returned values, each on a middleware of its own: YARP, ROS 1 and ZeroMQ.

    python channeling.py publish
    python channeling.py listen                 prints what arrived: None where a middleware is not there

Listing 3 of Wrapyfi's paper, as it is printed there, with the calls around it.
"""
import sys
import time

import numpy as np
from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator


class ChannelCls(MiddlewareCommunicator):
  @MiddlewareCommunicator.register('NativeObject', 
   'yarp', 'ChannelCls', '/example/native_yarp_msg', 
   carrier='mcast', should_wait=True)
  @MiddlewareCommunicator.register('Image', 
   'ros', 'ChannelCls', '/example/image_ros_msg', 
   carrier='tcp', width='$img_width', 
   height='$img_height', rgb=True, queue_size=10)
  @MiddlewareCommunicator.register('AudioChunk', 
   'zeromq', 'ChannelCls', '/example/audio_zmq_msg', 
   carrier='tcp', rate='$aud_rate', 
   chunk='$aud_chunk', channels='$aud_chann')
  def read_mulret_mulmware(self, 
   img_width=200, img_height=200, 
   aud_rate=44100, aud_chunk=8820, aud_chann=1):
    ros_img = np.random.randint(256, 
     size=(img_height, img_width, 3), dtype=np.uint8)
    zeromq_aud = (np.random.uniform(-1,1, aud_chunk), 
     aud_rate,)
    yarp_native = [ros_img, zeromq_aud]
    return yarp_native, ros_img, zeromq_aud


channels = ChannelCls()
channels.activate_communication("read_mulret_mulmware", mode=sys.argv[1])
while True:
    native, image, (sound, rate) = channels.read_mulret_mulmware()
    arrived = [native and len(native), getattr(image, "shape", None), getattr(sound, "shape", None), rate]
    print(*arrived, flush=True)
    time.sleep(0.05)
