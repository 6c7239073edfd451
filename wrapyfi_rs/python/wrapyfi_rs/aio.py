"""The functions of the package for asyncio: the loop runs on while they wait.

    async for message in aio.echo("ros2:/chatter", count=3): print(message)
    await aio.call("ros2:/light", data=True)

Arguments, results and exceptions are those of the functions of these names in ``wrapyfi_rs``. Where a task is cancelled, its
wait ends at once, and a goal is cancelled.
"""

import functools
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any, ParamSpec, TypeVar

from . import graph
from ._tasks import in_thread

_P, _T = ParamSpec("_P"), TypeVar("_T")


async def echo(endpoint: str, data_type: "str | type | None" = None, **options: Any) -> AsyncIterator[Any]:
    """The messages of a topic, one after the other as they come; ``options`` are those of ``wrapyfi_rs.echo``."""
    messages, waits, end = graph.echo(endpoint, data_type, **options), [], object()
    try:
        while (message := await in_thread(functools.partial(next, messages, end), waits)) is not end:
            yield message
    finally:
        messages.close()


def _awaitable(function: Callable[_P, _T]) -> Callable[_P, Awaitable[_T]]:
    @functools.wraps(function)
    async def awaited(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        return await in_thread(functools.partial(function, *args, **kwargs), [])

    return awaited


call = _awaitable(graph.call)
send_goal = _awaitable(graph.send_goal)
list = _awaitable(graph.list)  # noqa: A001
why = _awaitable(graph.why)
