"""The middlewares that have servers."""

from .. import _native


class Servers:
    """Names of the middlewares; classes of other middlewares are written in Rust (``docs/not-here.md``)."""

    mwares = set(_native.middlewares())

    @staticmethod
    def scan():
        """Nothing to look for: the middlewares are built in."""
