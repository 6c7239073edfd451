"""Lines of the core in Python's log, whose logger is ``wrapyfi_rs``: those that the core says at the level of
``RUST_LOG``, else from "info" on. Python's own levels choose among them."""

import atexit
import logging
import threading

from . import _native

_LEVELS = {"ERROR": logging.ERROR, "WARN": logging.WARNING, "INFO": logging.INFO}
_thread = None


def start():
    """Hands lines on from now on; again in the child of a fork, which has no thread of its parent's."""
    global _thread
    if _thread is None or not _thread.is_alive():
        _thread = threading.Thread(target=_forever, name="wrapyfi_rs log", daemon=True)
        _thread.start()


def _forever():
    while True:
        _hand_on(_native.log_lines(True))


def _hand_on(lines):
    for level, logger, text in lines:
        logging.getLogger(logger).log(_LEVELS.get(level, logging.DEBUG), "%s", text)


# What was said last.
atexit.register(lambda: _hand_on(_native.log_lines(False)))
