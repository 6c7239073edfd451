"""Sound: the fields of ``wrapyfi_msgs/msg/AudioChunk``."""

import numpy as np

from .arrays import as_array, buffer, octets
from .values import MessageError

#: Types of a sample, and what the field ``encoding`` calls them.
ENCODINGS = {"float32": "FLOAT32LE", "int16": "S16LE"}

#: What the field ``coding_format`` has where the samples of one channel are an array of one dimension.
FLAT = "flat"


def from_audio(message):
    """Samples of shape (frames, channels), or (frames,), as a view of the message's bytes, and the rate in Hz.

    The number of bytes says what a sample is, because Wrapyfi labels its 32-bit floats ``S16LE``.
    """
    found = octets(message.data, "data")
    shape = int(message.chunk_size), int(message.channels)
    for code in ("f4", "i2"):
        dtype = np.dtype((">" if message.is_bigendian else "<") + code)
        if shape[0] * shape[1] * dtype.itemsize == found.size:
            is_flat = shape[1] == 1 and getattr(message, "coding_format", "") == FLAT
            return found.view(dtype).reshape(shape[:1] if is_flat else shape), int(message.sample_rate)
    samples = shape[0] * shape[1]
    raise MessageError(
        f"{shape[0]} samples of {shape[1]} channels need {samples * 4} bytes as float32 or {samples * 2} "
        f"as int16, {found.size} are there (encoding {message.encoding!r}, coding_format "
        f"{message.coding_format!r})"
    )


def audio_fields(value):
    """The fields of the ``AudioChunk`` message for a pair of samples and their rate, as Wrapyfi has it."""
    try:
        samples, rate = value
        samples, rate = as_array(samples), int(rate)
    except MessageError:
        raise
    except (TypeError, ValueError, OverflowError):
        raise MessageError(f"sound is a pair of samples and rate, not of type {type(value).__name__}") from None
    if samples.dtype.name not in ENCODINGS or samples.ndim not in (1, 2):
        raise MessageError(
            f"samples are float32 or int16 of shape (frames,) or (frames, channels), not {samples.dtype} "
            f"of shape {samples.shape}: use astype"
        )
    frames, channels = samples.shape if samples.ndim == 2 else (samples.size, 1)
    if channels > 255 or not 0 <= rate < 1 << 32:
        raise MessageError(f"{channels} channels of {rate} Hz: at most 255, and a rate from 0 to {(1 << 32) - 1}")
    samples = samples.astype(samples.dtype.newbyteorder("<"), copy=False)
    return {
        "chunk_size": frames,
        "channels": channels,
        "sample_rate": rate,
        "encoding": ENCODINGS[samples.dtype.name],
        "coding_format": FLAT if samples.ndim == 1 else "",
        "step": channels * samples.itemsize,
        "data": buffer(samples),
    }
