"""The listings of Wrapyfi's paper, as they are printed there, with the calls around them.

    listings.py mirror publish|listen [zeromq]       lines of the message
    listings.py forward send_yarp publish            one method in one mode
    listings.py channel publish|listen               the shapes of three values on three middlewares
"""
import json
import sys
import time

import numpy as np
from wrapyfi.connect.wrapper import MiddlewareCommunicator


class MirrorCls(MiddlewareCommunicator):
  @MiddlewareCommunicator.register('NativeObject', 
   '$0', 'MirrorCls', '/example/read_msg', 
   carrier='tcp', should_wait='$blocking')
  def read_msg(self, mware, msg='', blocking=True):
    msg_ip = input('type message:')
    obj = {'msg': msg, 'msg_ip': msg_ip}
    return obj,


class ForwardCls(MiddlewareCommunicator):
  @MiddlewareCommunicator.register('NativeObject', 
   'yarp', 'ForwardCls', '/example/native_yarp_msg', 
   carrier='mcast', should_wait=True)
  def send_yarp(self, msg):
    return msg,

  @MiddlewareCommunicator.register('NativeObject', 
   'zeromq', 'ForwardCls', '/example/native_zmq_msg', 
   carrier='tcp')
  def send_zmq(self, msg):
    return msg,


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


def mirror(mode, mware="zeromq"):
    mirror = MirrorCls()
    mirror.activate_communication(
        'read_msg', mode=mode)
    return lambda number: mirror.read_msg(mware, msg=f"call {number}")[0]


def forward(method, mode):
    forward = ForwardCls()
    forward.activate_communication(method, mode=mode)
    return lambda number: getattr(forward, method)(f"message {number}")[0]


def channel(mode):
    channels = ChannelCls()
    channels.activate_communication("read_mulret_mulmware", mode=mode)

    def call(_number):
        native, image, sound = channels.read_mulret_mulmware()
        return [list(native[0].shape), list(image.shape), list(sound[0].shape), sound[1]]

    return call


call = {"mirror": mirror, "forward": forward, "channel": channel}[sys.argv[1]](*sys.argv[2:])
for number in range(100000):
    print(json.dumps(call(number)), flush=True)
    time.sleep(0.02)
