"""``import wrapyfi…`` that finds this package."""

import contextlib
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import pathlib
import sys

#: Modules that are here under another name, or that another version of Wrapyfi names differently.
RENAMED = {
    "wrapyfi.encoders": "wrapyfi_rs.utils.serialization_encoders",
    "wrapyfi.utils.image_encoders": "wrapyfi_rs.utils.core_utils",
}


class Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds ``wrapyfi.X`` as ``wrapyfi_rs.X``, and Wrapyfi's own tests where that is installed."""

    def find_spec(self, name, path=None, target=None):
        if name != "wrapyfi" and not name.startswith("wrapyfi."):
            return None
        if name.split(".")[1:2] == ["tests"]:
            return _of_wrapyfi(name)
        ours = RENAMED.get(name, "wrapyfi_rs" + name[len("wrapyfi") :])
        try:
            found = importlib.util.find_spec(ours)
        except ModuleNotFoundError:
            found = None
        if found is None:
            return None
        spec = importlib.util.spec_from_loader(name, self, is_package=found.submodule_search_locations is not None)
        spec.loader_state = ours
        return spec

    def create_module(self, spec):
        module = importlib.import_module(spec.loader_state)
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module):
        # It has run under its own name, which it keeps.
        module.__spec__ = module.__spec__.loader_state


def _of_wrapyfi(name):
    """A module of the Wrapyfi that is installed."""
    found = importlib.machinery.PathFinder.find_spec("wrapyfi")
    if found is None:
        return None
    folder = pathlib.Path(found.submodule_search_locations[0], *name.split(".")[1:-1])
    return importlib.machinery.PathFinder.find_spec(name, [str(folder)])


FINDER = Finder()


def install():
    """Makes ``import wrapyfi`` mean this package from now on."""
    if FINDER not in sys.meta_path:
        sys.meta_path.insert(0, FINDER)


@contextlib.contextmanager
def as_wrapyfi():
    """Makes ``import wrapyfi`` mean this package for a while."""
    if FINDER in sys.meta_path or "wrapyfi" in sys.modules:
        yield
        return
    sys.meta_path.insert(0, FINDER)
    try:
        yield
    finally:
        sys.meta_path.remove(FINDER)
        for name in [name for name in sys.modules if name == "wrapyfi" or name.startswith("wrapyfi.")]:
            del sys.modules[name]
