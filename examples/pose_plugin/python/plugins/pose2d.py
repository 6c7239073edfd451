"""The Python twin of the example's plug-in: found by Wrapyfi through WRAPYFI_PLUGIN_PATHS."""
import dataclasses

from wrapyfi.utils.core_utils import Plugin, PluginRegistrar


@dataclasses.dataclass
class Pose:
    x_m: float
    y_m: float
    heading_rad: float


@PluginRegistrar.register(types=Pose.__mro__[:-1])
class Pose2D(Plugin):
    def __init__(self, **_options):
        pass

    def encode(self, obj, *_args, **_options):
        return True, {"__wrapyfi__": ("Pose2D", obj.x_m, obj.y_m, obj.heading_rad)}

    def decode(self, _type, parts, *_args, **_options):
        return True, Pose(*parts[1:4])
