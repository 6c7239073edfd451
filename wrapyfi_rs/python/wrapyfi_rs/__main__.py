"""``python -m wrapyfi_rs script.py …``: runs a script of Wrapyfi's on this package."""

import os
import runpy
import sys

from . import _alias


def main():
    """Runs the script, or with ``-m`` the module, that the arguments name."""
    if len(sys.argv) < 2 or (sys.argv[1] == "-m" and len(sys.argv) < 3):
        sys.exit("usage: python -m wrapyfi_rs SCRIPT [ARGUMENT …], or python -m wrapyfi_rs -m MODULE [ARGUMENT …]")
    _alias.install()
    del sys.argv[0]
    if sys.argv[0] == "-m":
        del sys.argv[0]
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
    else:
        sys.path[0] = os.path.dirname(os.path.abspath(sys.argv[0]))
        runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    main()
