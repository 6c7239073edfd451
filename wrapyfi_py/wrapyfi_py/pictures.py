"""Pictures of Pillow: ``["picture", {"encoding": "rgb8", "width", "height", "data"}]``, or a file:
``{"format": "png", "data"}``."""

import io

import numpy as np

from .values import Absent, MessageError, library, mapping, member

#: Encodings by the names of ``sensor_msgs/image_encodings``: element type, channels, Pillow's mode, and whether
#: blue comes first.
ENCODINGS = {
    "mono8": ("uint8", 1, "L", False),
    "8UC1": ("uint8", 1, "L", False),
    "rgb8": ("uint8", 3, "RGB", False),
    "bgr8": ("uint8", 3, "RGB", True),
    "8UC3": ("uint8", 3, "RGB", True),
    "rgba8": ("uint8", 4, "RGBA", False),
    "bgra8": ("uint8", 4, "RGBA", True),
    "8UC4": ("uint8", 4, "RGBA", True),
    "mono16": ("uint16", 1, "I;16", False),
    "16UC1": ("uint16", 1, "I;16", False),
    "32SC1": ("int32", 1, "I", False),
    "32FC1": ("float32", 1, "F", False),
    "32FC3": ("float32", 3, None, False),
}

#: Formats of a file, by Pillow's names.
FORMATS = {"jpeg": "JPEG", "png": "PNG"}

#: Encoding of what has a mode of its own.
MODES = {
    "CMYK": "8UC4",
    "L": "mono8",
    "RGB": "rgb8",
    "RGBA": "rgba8",
    "I;16": "mono16",
    "I": "32SC1",
    "F": "32FC1",
    "1": "mono8",
}


def read(body, reader):
    """The image of Pillow. A file is decompressed when its pixels are asked for."""
    body = mapping(body, "picture")
    data = member(body, "data", np.ndarray, "picture")
    mode = body.get("mode")
    if "format" in body:
        return _file(member(body, "format", str, "picture"), data, reader)
    encoding = member(body, "encoding", str, "picture")
    if encoding not in ENCODINGS:
        raise MessageError(f"encoding {encoding[:40]!r} is none of {', '.join(ENCODINGS)}")
    element, channels, own_mode, blue_first = ENCODINGS[encoding]
    size = member(body, "width", int, "picture"), member(body, "height", int, "picture")
    shape = (size[1], size[0]) if channels == 1 else (size[1], size[0], channels)
    if (data.dtype.name, data.shape) != (element, shape):
        raise MessageError(
            f"data of a picture is {data.dtype} of shape {list(data.shape)}, the fields say {element} of "
            f"shape {list(shape)}"
        )
    if own_mode is None:
        raise Absent(f"Pillow has no mode for {encoding}")
    image = library("PIL.Image")
    reader.budget.take("a picture", data.nbytes)
    if mode in ("P", "CMYK") and (mode == "CMYK") == (channels == 4):
        # Places in a palette that nobody sends, and inks: no other encoding's pixels.
        own_mode, blue_first = mode, False
    if blue_first:
        data = data[..., [2, 1, 0, 3][:channels]]
    if 0 in size:
        return image.new(mode or own_mode, size)
    # One copy: an image of Pillow may be written to, a message may not.
    found = image.frombytes(own_mode, size, np.ascontiguousarray(data).tobytes())
    return found if mode in (None, own_mode) else found.convert(str(mode), dither=image.Dither.NONE)


def _file(name, data, reader):
    if name not in FORMATS:
        raise MessageError(f"format {name[:40]!r} of a picture is none of {', '.join(FORMATS)}")
    if data.dtype != np.uint8 or data.ndim != 1:
        raise MessageError(f"the file of a picture is uint8 of one dimension, not {data.dtype} of {data.ndim}")
    image = library("PIL.Image")
    reader.budget.take("the file of a picture", data.nbytes)
    found = image.open(io.BytesIO(data.tobytes()), formats=[FORMATS[name]])
    reader.budget.take("the pixels of a picture", found.width * found.height * 4)
    return found


def write(value):
    """Tag and body of an image of Pillow; ``None`` for anything else."""
    from PIL import Image

    if not isinstance(value, Image.Image):
        return None
    if value.mode not in MODES:
        raise MessageError(f'a picture of mode {value.mode}: use convert("RGB")')
    encoding = MODES[value.mode]
    element, channels, own_mode, _ = ENCODINGS[encoding]
    pixels = value.convert(own_mode) if value.mode == "1" else value
    shape = (value.height, value.width) if channels == 1 else (value.height, value.width, channels)
    data = np.asarray(pixels).astype(element, copy=False).reshape(shape)
    mode = {} if value.mode == own_mode else {"mode": value.mode}
    return "picture", {"encoding": encoding, "width": value.width, "height": value.height, **mode, "data": data}
