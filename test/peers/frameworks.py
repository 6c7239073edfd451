"""Tensors of the large libraries, one case a library, for `wrapyfi_peer.py --cases frameworks`.

An object of a case is a dict of tensors by name; what identifies it is what a user can see of each:
element type, shape, elements, device, and what the library adds.
"""
import os
import sys
import types

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
os.environ.setdefault("CUDA_VISIBLE_DEVICES", "")
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import plugins  # noqa: E402
from plugins import case, digest  # noqa: E402, F401


def load(name):
    """As in plugins.py; a case may prepare the library before Wrapyfi's plug-in looks for it."""
    before = getattr(plugins.CASES[name], "before", None)
    if before:
        before()
    found = plugins.load(name)
    after = getattr(found, "after", None)
    if after:
        after()
    return found


def described(array):
    """What a NumPy array is, as far as it survives every library."""
    import hashlib
    import numpy as np
    array = np.asarray(array)
    return {"dtype": array.dtype.str, "shape": list(array.shape),
            "sha256": hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()}


@case(plugin="pytorch_tensor")
class Torch:
    @staticmethod
    def make(seq):
        import torch
        ramp = torch.arange(12, dtype=torch.float32) + seq
        tensors = {str(kind).split(".")[1]: ramp.to(kind) for kind in (
            torch.float32, torch.float64, torch.float16, torch.bfloat16, torch.int8, torch.uint8, torch.int16,
            torch.int32, torch.int64, torch.bool, torch.complex64, torch.complex128)}
        tensors.update(
            scalar=torch.tensor(1.5 + seq), empty=torch.zeros(0, 3), matrix=ramp.reshape(3, 4),
            transposed=ramp.reshape(3, 4).t(), part=ramp[2:9:3], expanded=ramp[:1].expand(5),
            learning=ramp.clone().requires_grad_(), parameter=torch.nn.Parameter(ramp.reshape(2, 6)),
            frozen=torch.nn.Parameter(ramp.clone(), requires_grad=False))
        return tensors

    @staticmethod
    def facts(tensors):
        import torch
        return {name: {"torch": str(tensor.dtype), "device": str(tensor.device), "learns": tensor.requires_grad,
                       "parameter": isinstance(tensor, torch.nn.Parameter),
                       **described(tensor.detach().float() if tensor.dtype is torch.bfloat16 else tensor.detach())}
                for name, tensor in tensors.items()}


@case(plugin="jax_tensor")
class Jax:
    @staticmethod
    def after():
        """Wrapyfi 0.5.0 looks for jax.Array, and its search ends at the class below: register that."""
        import jax
        from wrapyfi.utils.core_utils import PluginRegistrar
        PluginRegistrar.encoder_registry[type(jax.numpy.zeros(1))] = PluginRegistrar.decoder_registry["JAXTensor"]

    @staticmethod
    def make(seq):
        import jax.numpy as jnp
        return {"float32": jnp.arange(6, dtype="float32") + seq, "matrix": (jnp.arange(6) + seq).reshape(2, 3),
                "half": jnp.arange(3, dtype="float16") + seq, "flags": jnp.array([True, False]),
                "scalar": jnp.float32(1.5 + seq), "complex": jnp.array([1 + 2j, 3j], dtype="complex64")}

    @staticmethod
    def facts(arrays):
        return {name: {"library": type(array).__module__.split(".")[0], **described(array)}
                for name, array in arrays.items()}


@case(plugin="trax_array")
class Trax(Jax):
    """What Trax works with are JAX arrays: the plug-in asks only whether Trax is there."""

    @staticmethod
    def before():
        sys.modules["trax"] = types.ModuleType("trax")

    after = None

    @staticmethod
    def make(seq):
        import jax.numpy as jnp
        # Not among Jax's: what Wrapyfi sends of it there, it cannot read itself.
        return {"bfloat16": jnp.array([1.5, -2], dtype="bfloat16") + seq, "weak": jnp.asarray(1.5), **Jax.make(seq)}

    @staticmethod
    def facts(arrays):
        return {name: {"jax": str(array.aval), **described(array.astype("float32") if str(array.dtype) == "bfloat16" else array)}
                for name, array in arrays.items()}


@case(plugin="tensorflow_tensor")
class TensorFlow:
    @staticmethod
    def make(seq):
        import tensorflow as tf
        ramp = tf.range(6, dtype=tf.float32) + seq
        return {"float32": ramp, "matrix": tf.reshape(tf.cast(ramp, tf.int64), (2, 3)), "flags": ramp > 2.0,
                "half": tf.cast(ramp, tf.float16), "scalar": tf.constant(1.5 + seq), "empty": tf.zeros((0, 3)),
                "complex": tf.cast(ramp, tf.complex64)}

    @staticmethod
    def facts(tensors):
        return {name: {"tf": tensor.dtype.name, **described(tensor.numpy())} for name, tensor in tensors.items()}


@case(plugin="paddle_tensor")
class Paddle:
    @staticmethod
    def before():
        """Wrapyfi 0.5.0 asks for a module that Paddle 2.6 renamed."""
        import paddle
        if not hasattr(paddle, "fluid"):
            paddle.fluid = types.SimpleNamespace(libpaddle=paddle.base.libpaddle)

    @staticmethod
    def make(seq):
        import numpy as np
        import paddle
        ramp = np.arange(6, dtype="<f4") + np.float32(seq)
        return {"float32": paddle.to_tensor(ramp.reshape(2, 3)), "int64": paddle.to_tensor([seq, 2]),
                "half": paddle.to_tensor(ramp.astype("<f2")), "flags": paddle.to_tensor(ramp > 2),
                "bfloat16": paddle.to_tensor(ramp).astype("bfloat16"), "scalar": paddle.to_tensor(1.5 + seq)}

    @staticmethod
    def facts(tensors):
        return {name: {"paddle": str(tensor.dtype), "place": str(tensor.place), "name": tensor.name,
                       **described(tensor.numpy())}
                for name, tensor in tensors.items()}


@case(plugin="zarr_array")
class Zarr:
    @staticmethod
    def after():
        """Wrapyfi 0.5.0 deletes the folder before anything of it is read: here it stays until the end."""
        import tempfile

        class Folder(tempfile.TemporaryDirectory):
            def __exit__(self, *_):
                Zarr.folders.append(self)

        module = next(m for name, m in sys.modules.items() if name.endswith(".plugins.zarr_array"))
        module.tempfile = types.SimpleNamespace(TemporaryDirectory=Folder)

    folders = []

    @staticmethod
    def make(seq):
        import numpy as np
        import zarr
        from numcodecs import Blosc, Zlib
        ramp = np.arange(3000, dtype="<i4").reshape(50, 60) + seq
        return {"lz4": zarr.array(ramp, chunks=(20, 25)), "zlib": zarr.array(ramp.astype("<f8"), compressor=Zlib()),
                "bits": zarr.array(ramp, compressor=Blosc("zstd", shuffle=Blosc.BITSHUFFLE)),
                "plain": zarr.array(ramp.astype("<u2"), compressor=None, order="F", chunks=(7, 60)),
                "single": zarr.array(np.float32(1.5 + seq)), "filled": zarr.full((4, 5), float(seq), chunks=2)}

    @staticmethod
    def facts(arrays):
        return {name: described(array[...]) for name, array in arrays.items()}


@case(plugin="dask_data")
class Dask:
    @staticmethod
    def make(seq):
        import dask.array as da
        ramp = da.arange(12, chunks=5) + seq
        return {"int64": ramp, "float32": ramp.astype("f4"), "matrix": ramp.reshape(3, 4), "flags": ramp > 5,
                "complex": ramp.astype("c8"), "empty": da.zeros((0, 3))}

    @staticmethod
    def facts(arrays):
        return {name: described(array.compute()) for name, array in arrays.items()}
