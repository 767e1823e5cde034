"""Viewers of a live page, and a flood of requests to it: a process of its own.

    python tests/benchmarks/far_end/page_load.py URL VIEWERS REQUESTS_A_SECOND

Until it is ended. Prints a line once the viewers are connected; on SIGTERM how many requests a
second it has sent while it was not stopped, and how many events arrived.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import time
from urllib.parse import urlsplit

_CONNECTIONS = 20
_GET = b"GET /api/session HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


class PageLoad:
    def __init__(self, url: str, requests_s: float) -> None:
        parts = urlsplit(url)
        self._address = parts.hostname, parts.port
        self._every_s = _CONNECTIONS / (requests_s or 1.0)
        self.sent = self.events = 0
        self.busy_s = 0.0

    async def view(self) -> None:
        while True:
            with contextlib.suppress(OSError):
                reader, writer = await asyncio.open_connection(*self._address)
                writer.write(b"GET /api/runs/run-0001/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
                while data := await reader.read(1 << 16):
                    self.events += data.count(b"\nevent: ") + data.startswith(b"event: ")
                writer.close()
            await asyncio.sleep(0.5)

    async def flood(self) -> None:
        """One of the connections; the page closes it with each refusal."""
        while True:
            began = time.monotonic()
            with contextlib.suppress(OSError):
                reader, writer = await asyncio.open_connection(*self._address)
                writer.write(_GET)
                self.sent += 1
                await reader.read(1 << 12)
                writer.close()
            took = time.monotonic() - began
            if took < 5.0:  # not stopped in between
                self.busy_s += max(took, self._every_s) / _CONNECTIONS
            await asyncio.sleep(max(0.0, self._every_s - took))


async def main(url: str, viewers: int, requests_s: float) -> None:
    os.nice(15)  # they are other computers in truth, and must not take this one's time
    load, stopped = PageLoad(url, requests_s), asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stopped.set)
    tasks = [asyncio.create_task(load.view()) for _ in range(viewers)]
    await asyncio.sleep(1.0)
    if requests_s:
        tasks += [asyncio.create_task(load.flood()) for _ in range(_CONNECTIONS)]
    print("ready", flush=True)
    await stopped.wait()
    print(load.sent / load.busy_s if load.busy_s else 0.0, load.events, flush=True)
    for task in tasks:
        task.cancel()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3])))
