"""Objects of other libraries that Wrapyfi's plug-ins carry: one case a library, for wrapyfi_peer.py.

A case says which plug-in of Wrapyfi it needs, makes object number `seq`, and says what identifies
an object, in plain JSON: a receiver of the same object says the same.
"""
import hashlib
import importlib.util
import json
import os
import pathlib
import shutil
import tempfile

CASES = {}


def case(plugin):
    """Registers a class with `make(seq)` and `facts(object)`; `plugin` is Wrapyfi's file for it."""
    def register(cls):
        cls.plugin = plugin
        CASES[cls.__name__.lower()] = cls
        return cls
    return register


def load(name):
    """Makes Wrapyfi load the plug-in of a case, and no other. To be called before Wrapyfi is imported.

    Wrapyfi 0.5.0 looks for its own plug-ins beside a file that has moved, so they are pointed out to
    it. One alone, because those for classes with a common base take each other's objects.
    """
    found = CASES[name]
    if found.plugin is None:
        return found
    source = pathlib.Path(importlib.util.find_spec("wrapyfi").origin).parent / "plugins" / f"{found.plugin}.py"
    folder = pathlib.Path(tempfile.mkdtemp(prefix="wrapyfi_plugin_"))
    try:
        (folder / "plugins").mkdir()
        shutil.copy(source, folder / "plugins")
        os.environ["WRAPYFI_PLUGIN_PATHS"] = str(folder)
        import wrapyfi
        assert wrapyfi.PluginRegistrar.decoder_registry, f"Wrapyfi did not load {source}"
    finally:
        shutil.rmtree(folder)
    return found


def digest(facts):
    """Hash of what `facts` says, to compare messages by."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


# NumPy needs no plug-in: it is here because every library's object must travel in this way.


@case(plugin=None)
class Numpy:
    @staticmethod
    def make(seq):
        import numpy as np
        return np.arange(6, dtype="<i4").reshape(2, 3) + seq

    @staticmethod
    def facts(array):
        return {"dtype": array.dtype.str, "shape": list(array.shape), "values": array.tolist()}


@case(plugin="pint_quantities")
class Pint:
    @staticmethod
    def make(seq):
        import pint
        return pint.Quantity(1.5 + seq, "kilogram * meter / second ** 2")

    @staticmethod
    def facts(quantity):
        return {"magnitude": float(quantity.magnitude), "units": str(quantity.units)}
