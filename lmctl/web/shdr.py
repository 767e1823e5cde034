"""MTConnect adapter: the snapshot of the run under way as SHDR text over TCP, for an agent.

    2026-03-01T08:00:00.000Z|execution|ACTIVE|line|128
    2026-03-01T08:00:00.000Z|system|FAULT|door|1||the safety door is open

An agent connects, is sent every item, and then those that change; it asks `* PING` to see that the
adapter lives. It can send nothing that acts. Form: MTConnect, adapter protocol 2.0.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from datetime import UTC, datetime
from typing import Any

from lmctl.errors import UsageError

#: Between two looks at the snapshot, and what an agent is told to expect [s].
_PERIOD_S, _HEARTBEAT_S = 0.5, 10.0

#: An agent that takes nothing for so long is dropped [s].
_SLOW_S = 10.0

_MAX_AGENTS, _MAX_REQUEST_BYTES = 8, 256

UNAVAILABLE = "UNAVAILABLE"

#: The controlled vocabulary of EXECUTION for each state of a run.
EXECUTION = {
    **dict.fromkeys(("ready", "connecting", "checking", "gas", "powder", "armed"), "READY"),
    **dict.fromkeys(("depositing", "purging", "resuming", "finishing"), "ACTIVE"),
    **dict.fromkeys(("holding", "held", "opening", "refilling", "weighing"), "FEED_HOLD"),
    **dict.fromkeys(("stopping", "stopped"), "PROGRAM_STOPPED"),
    **dict.fromkeys(("tripped", "faulted"), "INTERRUPTED"), "done": "PROGRAM_COMPLETED",
}


def shdr_items(now: Mapping[str, Any] | None) -> dict[str, str]:
    """{item: its value as SHDR text} of a snapshot; None: no run is under way."""
    if now is None:
        return {"avail": "AVAILABLE", **dict.fromkeys(
            ("execution", "program", "line", "path_feedrate_override", "path_feedrate", "x_act",
             "y_act", "z_act", "laser_power", "shield_gas"), UNAVAILABLE),
            "execution": "READY", "system": "NORMAL||||"}
    x, y, z = (now["position_mm"] or (None, None, None))[:3]
    items = {
        "avail": "AVAILABLE", "execution": EXECUTION.get(now["state"], UNAVAILABLE),
        "program": _text(now["part"]), "line": _number(now["line"]),
        "path_feedrate_override": _number(now["override_percent"]),
        "path_feedrate": _number(now["speed_mm_s"]), "x_act": _number(x), "y_act": _number(y),
        "z_act": _number(z), "laser_power": _number(now["power_W"]),
        "shield_gas": _number(now["shield_gas_L_min"]), "system": _condition(now),
    }
    for at, hopper in enumerate(now["hoppers"]):
        for name, key in (("powder_commanded", "set_g_min"), ("powder_actual", "measured_g_min")):
            flows = now[key]
            items[f"{name}_{_text(hopper)}"] = UNAVAILABLE if flows is None else _number(flows[at])
    return items


def shdr_line(items: Mapping[str, str], at: datetime) -> list[bytes]:
    """Items as lines: plain ones share one, a condition has its own. at : UTC"""
    stamp = at.isoformat(timespec="milliseconds").replace("+00:00", "Z")
    plain = [f"{name}|{value}" for name, value in items.items() if name != "system"]
    lines = ["|".join([stamp, *plain])] if plain else []
    if "system" in items:
        lines.append(f"{stamp}|system|{items['system']}")
    return [f"{line}\n".encode("ascii", "replace") for line in lines]


class ShdrAdapter:
    """Serves agents. snapshots : of the runs under way, oldest first; the last one is shown"""

    def __init__(self, snapshots: Callable[[], list[dict[str, Any]]]) -> None:
        self._snapshots = snapshots
        self._agents: set[asyncio.Task[Any]] = set()

    @asynccontextmanager
    async def serving(self, host: str, port: int) -> AsyncIterator[str]:
        """Serve while the block runs; gives the address. Raises UsageError for a port in use."""
        try:
            server = await asyncio.start_server(self._serve, host, port, limit=_MAX_REQUEST_BYTES)
        except OSError as error:
            raise UsageError(f"cannot listen on {host} port {port} for SHDR",
                             where=str(error.strerror or error),
                             hint="--shdr names another port") from None
        try:
            yield f"{host}:{server.sockets[0].getsockname()[1]}"
        finally:
            server.close()
            for agent in tuple(self._agents):
                agent.cancel()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        if len(self._agents) >= _MAX_AGENTS:
            writer.close()
            return
        self._agents.add(task)
        answering = asyncio.create_task(self._answer(reader, writer))
        try:
            await self._send(writer)
        except (OSError, TimeoutError, asyncio.CancelledError):
            pass  # it has gone, does not read, or the adapter ends
        finally:
            answering.cancel()
            self._agents.discard(task)
            writer.transport.abort()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer pings; anything else is left unread, and an endless line ends the connection."""
        with suppress(OSError, ValueError):
            while line := await reader.readline():
                if line.startswith(b"* PING"):
                    writer.write(f"* PONG {_HEARTBEAT_S * 1000:.0f}\n".encode("ascii"))
        writer.transport.abort()

    async def _send(self, writer: asyncio.StreamWriter) -> None:
        sent: dict[str, str] = {}
        while not writer.is_closing():
            live = self._snapshots()
            items = shdr_items(live[-1] if live else None)
            items |= dict.fromkeys(sent.keys() - items.keys(), UNAVAILABLE)
            changed = {name: value for name, value in items.items() if sent.get(name) != value}
            writer.writelines(shdr_line(changed, datetime.now(UTC)))
            async with asyncio.timeout(_SLOW_S):
                await writer.drain()
            sent = items
            await asyncio.sleep(_PERIOD_S)


def _condition(now: Mapping[str, Any]) -> str:
    """Level, native code, native severity, qualifier and text of what is wrong."""
    active = [one for one in now["alarms"] if one["cleared_s"] is None]
    if active:
        return f"FAULT|{_text(active[0].get('name', ''))}|1||{_text(active[0]['what'])}"
    if now["warnings"]:
        return f"WARNING|feeder|2||{_text(now['warnings'][0]['what'])}"
    return "NORMAL||||"


def _number(value: float | None) -> str:
    return UNAVAILABLE if value is None else f"{value:g}" if isinstance(value, float) else str(
        value)


def _text(value: object) -> str:
    return "".join(c if c.isprintable() and c != "|" else " " for c in str(value))
