"""Mirroring: one program, which publishes where it runs in one mode and listens where it runs in another.

    python mirroring.py publish                 type messages here
    python mirroring.py listen                  they arrive here, in as many terminals as are wanted
    python mirroring.py publish ros2            over another middleware: yarp, ros, ros2

Listing 1 of Wrapyfi's paper, as it is printed there, with the calls around it.
"""
import sys

from wrapyfi_rs.connect.wrapper import MiddlewareCommunicator


class MirrorCls(MiddlewareCommunicator):
  @MiddlewareCommunicator.register('NativeObject', 
   '$0', 'MirrorCls', '/example/read_msg', 
   carrier='tcp', should_wait='$blocking')
  def read_msg(self, mware, msg='', blocking=True):
    msg_ip = input('type message:')
    obj = {'msg': msg, 'msg_ip': msg_ip}
    return obj,


mode, *mware = sys.argv[1:]
mirror = MirrorCls()
mirror.activate_communication(
    'read_msg', mode=mode)
while True:
    my_message, = mirror.read_msg(*mware or ["zeromq"], msg="hello")
    print(my_message, flush=True)
