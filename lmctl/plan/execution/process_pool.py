"""Processes of this machine as an executor, each on a pipe of its own.

`concurrent.futures.ProcessPoolExecutor` shares one result pipe and its lock among all workers: one
that is killed while it writes a large result leaves the others waiting for ever. Here a worker's
death closes only its own pipe, whatever it was doing, and the planner's death closes all pipes.
"""

from __future__ import annotations

import multiprocessing
import queue
import signal
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

#: Signals whose planner handlers must not run in its workers.
_SIGNALS = ("SIGTERM", "SIGHUP", "SIGQUIT")
_BROKEN = "a worker process ended before its work was done"


class _Call(NamedTuple):
    future: Future[Any]
    function: Callable[..., Any]
    arguments: tuple[Any, ...]


class ProcessPool(Executor):
    """So many processes; calls and results are pickled.

    initializer : called with `initargs` in each process first. Where the system can fork, these
        are not pickled, and share their memory with this process
    A future raises BrokenExecutor where the process died that worked on it, or would have.
    """

    def __init__(
        self, processes: int, initializer: Callable[..., None], initargs: tuple[Any, ...]
    ) -> None:
        can_fork = "fork" in multiprocessing.get_all_start_methods()
        context = multiprocessing.get_context("fork" if can_fork else "spawn")
        self._calls: queue.SimpleQueue[_Call | None] = queue.SimpleQueue()
        self._broken = False
        self._closed = False
        self._parent_ends: list[Connection] = []
        self._processes = []
        for _ in range(processes):  # all before the first thread: a fork copies no other thread
            parent_end, child_end = context.Pipe()
            self._parent_ends.append(parent_end)
            process = context.Process(  # type: ignore[attr-defined]
                target=_work, daemon=True,
                args=(child_end, tuple(self._parent_ends) if can_fork else (), initializer,
                      initargs))
            process.start()
            self._processes.append(process)
            child_end.close()
        self._threads = [
            threading.Thread(target=self._serve, args=(end,), daemon=True)
            for end in self._parent_ends]
        for thread in self._threads:
            thread.start()

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call a function that pickles by name. Raises RuntimeError after `shutdown`."""
        if self._closed:
            raise RuntimeError("the pool is shut down")
        future: Future[Any] = Future()
        self._calls.put(_Call(future, function, args))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let the processes end. cancel_futures : end them now, even while they work."""
        self._closed = True
        if cancel_futures:
            for process in self._processes:
                process.terminate()
        for _ in self._threads:
            self._calls.put(None)
        if wait:
            for worker in (*self._threads, *self._processes):
                worker.join()

    def _serve(self, pipe: Connection) -> None:
        """Hand calls to one process and take its results, in a thread of this one."""
        with pipe:
            while (call := self._calls.get()) is not None:
                if not call.future.set_running_or_notify_cancel():
                    continue
                if self._broken:
                    call.future.set_exception(BrokenExecutor(_BROKEN))
                    continue
                try:
                    pipe.send((call.function, call.arguments))
                    failed, result = pipe.recv()
                except (EOFError, OSError):
                    self._broken = True
                    call.future.set_exception(BrokenExecutor(_BROKEN))
                except Exception as error:  # what cannot be pickled, or read back
                    call.future.set_exception(error)
                else:
                    (call.future.set_exception if failed else call.future.set_result)(result)


def _work(
    pipe: Connection, others: tuple[Connection, ...], initializer: Callable[..., None],
    initargs: tuple[Any, ...],
) -> None:
    """The main loop of one process: run calls from its pipe until the pipe closes."""
    for other in others:  # copies of the planner's ends, which would hide its death
        other.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the planner ends its workers itself
    for name in _SIGNALS:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_DFL)
    initializer(*initargs)
    with pipe:
        while True:
            try:
                function, arguments = pipe.recv()
            except (EOFError, OSError):
                return
            try:
                answer = False, function(*arguments)
            except Exception as error:
                answer = True, error
            try:
                pipe.send(answer)
            except (BrokenPipeError, ConnectionResetError):
                return
            except Exception as error:  # an answer that cannot be pickled
                pipe.send((True, RuntimeError(f"{type(error).__name__}: {error}")))
