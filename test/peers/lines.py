"""Talking to the test: one JSON object a line on stdout; end of file on stdin means "leave"."""
import json
import os
import signal
import sys
import threading

_lock = threading.Lock()
leaving = threading.Event()


def say(event, **facts):
    with _lock:
        sys.stdout.write(json.dumps({"event": event, **facts}) + "\n")
        sys.stdout.flush()


def watch_stdin():
    """Sets `leaving` at SIGTERM or when stdin closes: no peer outlives its test."""
    signal.signal(signal.SIGTERM, lambda *_: leaving.set())
    threading.Thread(target=_drain, daemon=True).start()


def _drain():
    fd = sys.stdin.fileno()
    while os.read(fd, 4096):
        pass
    leaving.set()


def leave(code=0):
    """Ends at once: exit hooks of a middleware may block on their own helpers."""
    sys.stdout.flush()
    import multiprocessing
    for child in multiprocessing.active_children():
        child.terminate()
        child.join()
    os._exit(code)
