"""The decorator, in ``wrapper``, and what scripts ask of the ends that there are."""

from ..utils.core_utils import PluginRegistrar

# Not before a script has imported this: one that runs by ``python -m wrapyfi_rs`` may name folders of plug-ins first.
PluginRegistrar.scan()
