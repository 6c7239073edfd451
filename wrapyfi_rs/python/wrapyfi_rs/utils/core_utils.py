"""Plug-ins written in Python: objects of other libraries on Wrapyfi's wire."""

import importlib.util
import logging
import os
import pathlib
import sys

WRAPYFI_PLUGIN_PATHS = "WRAPYFI_PLUGIN_PATHS"


class Plugin:
    """Base of plug-ins. The key on the wire is the name of the class; ``register``'s options are its arguments."""

    def __init__(self, **kwargs):
        pass

    def encode(self, obj, *args, **kwargs):
        """``(True, {"__wrapyfi__": (key, part, …)})``, or ``(False, {})`` for an object that it does not take."""
        raise NotImplementedError

    def decode(self, obj_type, obj_full, *args, **kwargs):
        """``(True, object)`` for the list of key and parts, or ``(False, {})``."""
        raise NotImplementedError


class PluginRegistrar:
    """Plug-ins by the type that they write, and by the key that they read."""

    encoder_registry = {}
    decoder_registry = {}

    @staticmethod
    def register(types=None):
        """Registers a plug-in for these types; one without types, whose library is missing, is left out."""

        def registered(cls):
            if types is not None:
                PluginRegistrar.encoder_registry.update(dict.fromkeys(types, cls))
                PluginRegistrar.decoder_registry[cls.__name__] = cls
            return cls

        return registered

    @staticmethod
    def scan():
        """Runs the files ``plugins/*.py`` of the folders that ``WRAPYFI_PLUGIN_PATHS`` names. Unlike in Wrapyfi, the
        current folder is none of them."""
        for folder in filter(None, os.environ.get(WRAPYFI_PLUGIN_PATHS, "").split(os.pathsep)):
            for path in sorted((pathlib.Path(folder) / "plugins").glob("*.py")):
                if not path.stem.startswith("__"):
                    _run(path)

    @staticmethod
    def writing(kind):
        """The plug-in that writes objects of a type, or None: that of the class nearest to it."""
        classes = (PluginRegistrar.encoder_registry.get(cls) for cls in kind.__mro__[:-1])
        return next(filter(None, classes), None)


def _run(path):
    name = f"wrapyfi_rs_plugin_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        with _aliases():
            spec.loader.exec_module(module)
    except Exception:  # whatever a file of the user's raises
        del sys.modules[name]
        logging.getLogger("wrapyfi_rs").exception("the plug-in %s is left out", path)


def _aliases():
    """A plug-in for Wrapyfi imports ``wrapyfi.utils.core_utils``: that is this module."""
    from .. import _alias

    return _alias.as_wrapyfi()
