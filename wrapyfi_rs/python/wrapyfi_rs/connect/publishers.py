"""The middlewares that have publishers."""

from .. import _native


class Publishers:
    """Names of the middlewares; classes of other middlewares are written in Rust (``docs/not-here.md``)."""

    mwares = set(_native.middlewares())

    @staticmethod
    def scan():
        """Nothing to look for: the middlewares are built in."""
