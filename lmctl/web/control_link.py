"""The live page's own connection to the control socket of a run, on the page's event loop."""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from lmctl.errors import JournalError, UsageError
from lmctl.run.control.client import run_not_in_progress
from lmctl.run.control.socket_path import connect_to_run

#: A run that has not answered by then is taken for stopped or hung [s].
ANSWER_S = 5.0

_MAX_ANSWER_BYTES = 1_000_000


class ControlLink:
    """One open connection. Use as an async context manager.

    Entering raises JournalError where no process drives the run, or it is another user's.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    async def __aenter__(self) -> Self:
        # A process that is stopped takes no more connections: connecting may wait for seconds.
        connection = await asyncio.to_thread(connect_to_run, self._folder)
        if connection is None:
            raise JournalError(f"{self._folder.name} is not under way",
                               hint="`lmctl recover` goes on with a run that ended")
        self._reader, self._writer = await asyncio.open_unix_connection(
            sock=connection, limit=_MAX_ANSWER_BYTES)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._writer.transport.abort()  # a run that hangs takes nothing more: nothing is waited for
        with suppress(OSError):
            await self._writer.wait_closed()

    async def request(self, do: str, **values: Any) -> dict[str, Any]:
        """The answer to one request; values : as in `lmctl.run.control.server`.

        Raises JournalError where the run does not answer, UsageError where it refuses.
        """
        try:
            async with asyncio.timeout(ANSWER_S):
                self._writer.write(json.dumps({"do": do, **values}).encode("ascii") + b"\n")
                await self._writer.drain()
                line = await self._reader.readline()
        except TimeoutError:
            raise JournalError(f"{self._folder.name} does not answer",
                               where="its process may be stopped",
                               hint="look at it where it was started") from None
        except (OSError, ValueError):  # the latter: an answer longer than any of ours
            line = b""
        if not line:
            raise await asyncio.to_thread(run_not_in_progress, self._folder)
        return _understood(self._folder, line)


def _understood(folder: Path, line: bytes) -> dict[str, Any]:
    try:
        answer: dict[str, Any] = json.loads(line)
        ok = answer.pop("ok")
    except (ValueError, TypeError, KeyError, AttributeError):
        raise JournalError(f"what {folder.name} answers makes no sense",
                           hint="is it driven by another version of lmctl?") from None
    if not ok:
        raise UsageError(str(answer.get("error", "refused")), where=answer.get("where", ()),
                         hint=str(answer.get("hint", "")))
    return answer
