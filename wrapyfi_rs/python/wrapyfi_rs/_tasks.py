"""Waits of a task: a thread waits, and the loop runs on."""

import asyncio
import contextvars

from ._ends import OPENED


async def in_thread(work, waits):
    """What ``work`` returns, run on another thread. Where the task is cancelled, so is each of ``waits``, a list to which
    ``work`` may add what it opens."""
    context = contextvars.copy_context()
    context.run(OPENED.set, waits)
    loop = asyncio.get_running_loop()
    running = loop.run_in_executor(None, context.run, work)
    try:
        return await asyncio.shield(running)
    except asyncio.CancelledError:
        # Its wait may have yet to begin.
        while not running.done():
            for wait in waits.copy():
                wait.cancel()
            await asyncio.wait([running], timeout=0.01)
        running.exception()
        raise
