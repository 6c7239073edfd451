"""A camera as a script of Wrapyfi's has it: camera.py publish|listen MIDDLEWARE; a listener ends with the first frame."""
import sys
import time

import numpy as np
from wrapyfi.connect.wrapper import MiddlewareCommunicator

FRAME = np.full((48, 64, 3), (255, 0, 7), np.uint8)


class Camera(MiddlewareCommunicator):
    @MiddlewareCommunicator.register("Image", sys.argv[2], "Camera", "/camera", width=64, height=48, rgb=True)
    def frame(self):
        return FRAME,


camera = Camera()
camera.activate_communication("frame", mode=sys.argv[1])
while True:
    frame, = camera.frame()
    if sys.argv[1] == "listen":
        assert np.array_equal(frame, FRAME), frame
        break
    time.sleep(0.05)
