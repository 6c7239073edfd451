"""What the twins of examples/communicator share. Import it before wrapyfi: it chooses threads instead of
processes, and no broker, because one runs already (`wrapyfi broker`, or a publisher in Rust)."""
import os

os.environ.setdefault("WRAPYFI_ZEROMQ_START_PROXY_BROKER", "False")
os.environ.setdefault("WRAPYFI_ZEROMQ_PUBSUB_MONITOR_LISTENER_SPAWN", "thread")

import pathlib  # noqa: E402

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import zmq  # noqa: E402

import payload  # noqa: E402
from lines import leave  # noqa: E402


def pictures(folder):
    """The PNG files of a folder, by name, in OpenCV's channel order."""
    files = sorted(pathlib.Path(folder).glob("*.png"))
    if not files:
        raise SystemExit(f"{folder} has no .png file")
    return [cv2.imread(str(file)) for file in files]


def image_facts(image):
    return {"shape": list(image.shape), "sha256": payload.digest(image)}


def sound_facts(sound):
    samples, rate = sound
    if samples.ndim == 1:
        samples = samples[:, None]
    return {"shape": list(samples.shape), "rate": int(rate), "sha256": payload.digest(samples)}


def greys(image):
    """Mean of the channels, rounded down, as the Rust twins compute it."""
    return image.astype(np.uint16).sum(axis=2) // 3


def save(image, path):
    """Whole, or not at all: whoever looks into the folder may do so at any time."""
    _, file = cv2.imencode(".png", image)
    part = path.with_suffix(".part")
    part.write_bytes(file.tobytes())
    part.rename(path)


def leave_after_the_last_message():
    """What was published last may still be in the socket."""
    zmq.Context.instance().destroy(linger=10_000)
    leave()
