"""Forwarding: two methods on two middlewares; what the first one hears, the second one publishes.

    python forwarding.py publish disable        says something on YARP
    python forwarding.py listen publish         hears it there, and says it on ZeroMQ
    python forwarding.py disable listen         hears it there

Listing 2 of Wrapyfi's paper, as it is printed there, with the calls around it.
"""
import sys
import time

from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator


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


yarp_mode, zmq_mode = sys.argv[1:]
forward = ForwardCls()
forward.activate_communication('send_yarp', mode=yarp_mode)
forward.activate_communication('send_zmq', mode=zmq_mode)
for number in range(1_000_000):
    message, = forward.send_yarp(f"message {number}")
    message, = forward.send_zmq(message)
    if message is not None:
        print(message, flush=True)
    time.sleep(0.05)
