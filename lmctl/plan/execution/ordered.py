"""Work done ahead by an executor, taken in order, with no more in flight than a window allows."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def ordered_results(
    submit: Callable[[Item], Future[Result]], items: Iterable[Item], window: Callable[[], int]
) -> Iterator[Result]:
    """Results of `submit` for each item, in the items' order.

    window : at least 1, submissions whose result is not taken yet, at most; read each time
    Items are taken as the window has room, so that they may come from a generator that depends on
    results already given. Where the caller stops early, or a result is an exception, what has not
    begun is cancelled.
    """
    waiting: deque[Future[Result]] = deque()
    try:
        for item in items:
            waiting.append(submit(item))
            while len(waiting) >= window():
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()
