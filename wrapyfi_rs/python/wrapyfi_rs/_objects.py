"""Objects of other libraries, which the core hands over: to plug-ins written in Python first, then to what knows the library."""

import json

from ._ros_objects import fields_of
from .errors import ObjectError
from .utils.core_utils import PluginRegistrar


def _foreign():
    """What knows the libraries: imported when there is an object of one, because it takes NumPy."""
    from . import _foreign as found

    return found


class Codec:
    """Objects of one value of a method, with the options that it is registered with."""

    def __init__(self, data_type, options):
        self.data_type, self.options = data_type, options

    def encode(self, value):
        """What stands for an object: the key and the JSON of a plug-in, or None, and JSON with arrays beside it."""
        plugin = PluginRegistrar.writing(type(value))
        if plugin is not None:
            is_taken, found = plugin(**self.options).encode(value)
            if is_taken:
                text = json.dumps(found, default=self._of_plugin)
                return found["__wrapyfi__"][0], text.encode(), []
        return None, *_foreign().write(fields_of(value))

    def _of_plugin(self, value):
        """An object among the parts of a plug-in."""
        key, text, tensors = self.encode(value)
        if tensors:
            raise ObjectError(f"a plug-in with a {type(value).__name__} among its parts: write it as text")
        return json.loads(text)

    def decode(self, text, tensors):
        """The object that JSON stands for, with its arrays beside it."""
        return _foreign().read(text, tensors)

    def tagged(self, key, text, refused):
        """The object that a plug-in wrote, by the plug-in of this name here; else what it wrote, as it is."""
        plugin = PluginRegistrar.decoder_registry.get(key)
        parts = json.loads(text)["__wrapyfi__"]
        if plugin is not None:
            is_taken, found = plugin(**self.options).decode(key, parts)
            if is_taken:
                return found
        return _foreign().Tagged(key, parts[1:], refused or "no plug-in here reads it; pickles are not run")
