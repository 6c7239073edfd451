"""``python -m wrapyfi_rs script.py …``: runs a script of Wrapyfi's on this package."""

import os
import runpy
import sys

from . import __version__, _alias


def main():
    """Runs the script, or with ``-m`` the module, that the arguments name."""
    usage = "usage: python -m wrapyfi_rs SCRIPT [ARGUMENT …], or python -m wrapyfi_rs -m MODULE [ARGUMENT …]"
    match sys.argv[1:]:
        case ["-h" | "--help", *_]:
            return print(f"{usage}\nruns a script of Wrapyfi's on wrapyfi_rs: `import wrapyfi` is this package")
        case ["--version", *_]:
            return print(f"wrapyfi_rs {__version__}")
        case [] | ["-m"]:
            sys.exit(usage)
        case ["-m", _, *_]:
            pass
        case [option, *_] if option.startswith("-"):
            sys.exit(f"python -m wrapyfi_rs: there is no option {option}\n{usage}")
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
