"""The two functions: which message it is, and which class it shall be."""

from .arrays import as_array, from_tensor, is_tensor, octets, tensor_fields
from .reading import read
from .sound import audio_fields, from_audio
from .values import MAX_MESSAGE_MIB, MessageError
from .writing import write


def to_python(message, *, limit_mib=MAX_MESSAGE_MIB):
    """The object that a message of ``wrapyfi_msgs`` stands for.

    ============  =====================================================================
    NativeObject  the object: dicts, lists, tuples, sets, numbers, text, arrays, …
    Tensor        a NumPy array
    AudioChunk    samples of shape (frames, channels) or (frames,), and their rate in Hz
    ============  =====================================================================

    Any object with the fields of one of these is taken for it. Arrays are views of the message's memory.

    :param limit_mib: bytes that a message, and again everything copied out of it, may have, in MiB
    :raises MessageError: where the message is malformed or exceeds a limit
    """
    limit = int(limit_mib * (1 << 20))
    if hasattr(message, "json") and hasattr(message, "tensors"):
        text = message.json
        if not isinstance(text, str):
            raise MessageError(f"json is of type {type(text).__name__}, not str")
        size = len(text) + sum(octets(tensor.data, "data").size for tensor in message.tensors)
        _check(size, limit)
        return read(text, message.tensors, limit)
    if hasattr(message, "dtype") and hasattr(message, "shape") and hasattr(message, "data"):
        _check(octets(message.data, "data").size, limit)
        return from_tensor(message)
    if hasattr(message, "chunk_size") and hasattr(message, "sample_rate"):
        _check(octets(message.data, "data").size, limit)
        return from_audio(message)
    raise MessageError(f"{type(message).__name__} is no NativeObject, Tensor or AudioChunk of wrapyfi_msgs")


def _check(size, limit):
    if size > limit:
        raise MessageError(f"message of {size} bytes, the limit is {limit}: raise limit_mib")


def from_python(value, message="NativeObject", *, header=None, messages=None):
    """The message of ``wrapyfi_msgs`` for an object.

    :param message: ``NativeObject``, ``Tensor`` or ``AudioChunk``, as a name or as a class of that name. A
        ``Tensor`` is made of an array, an ``AudioChunk`` of a pair of samples (float32 or int16) and rate.
    :param header: ``std_msgs/Header`` of the message, where it has one
    :param messages: what has the classes as attributes, to be called with their fields as keywords; by default
        ``wrapyfi_msgs.msg``
    :raises MessageError: where something in the object has no form in the message; the text says where
    """
    name = message if isinstance(message, str) else message.__name__
    if messages is None and (isinstance(message, str) or name == "NativeObject"):
        import wrapyfi_msgs.msg as messages
    make = getattr(messages, name, None) if isinstance(message, str) else message
    fields = {} if header is None or name == "Tensor" else {"header": header}
    if name == "NativeObject":
        text, tensors = write(value)
        return make(json=text, tensors=[messages.Tensor(**tensor) for tensor in tensors], **fields)
    if name == "Tensor":
        elements = as_array(value)
        if not is_tensor(elements):
            raise MessageError(f"{elements.dtype} elements are no numbers of a Tensor: send a NativeObject")
        return make(**tensor_fields(elements))
    if name == "AudioChunk":
        return make(**audio_fields(value), **fields)
    raise MessageError(f"{name} is no message of wrapyfi_msgs: NativeObject, Tensor or AudioChunk")
