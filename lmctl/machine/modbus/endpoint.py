"""Where a Modbus device is, as the machine profile writes it."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import parse_qsl, urlsplit

from lmctl.errors import ConfigError

_TCP_PORT = 502


@dataclass(frozen=True)
class TcpEndpoint:
    text: str
    host: str
    port: int


@dataclass(frozen=True)
class RtuEndpoint:
    """A serial line. parity : "N", "E" or "O"."""

    text: str
    path: str
    baud: int = 19_200
    parity: str = "E"
    stop_bits: int = 1

    @property
    def character_s(self) -> float:
        return (9 + (self.parity != "N") + self.stop_bits) / self.baud


def parse_modbus_endpoint(text: str) -> TcpEndpoint | RtuEndpoint:
    """`modbus-tcp://HOST[:PORT]` or `modbus-rtu:///dev/ttyUSB0?baud=19200&parity=E&stop=1`.

    Raises ConfigError for anything else.
    """
    try:
        parts = urlsplit(text)
        if parts.scheme == "modbus-tcp" and parts.hostname and parts.path in ("", "/") and (
            not parts.query and parts.port != 0
        ):
            return TcpEndpoint(text, parts.hostname, parts.port or _TCP_PORT)
        path = parts.netloc + parts.path
        if parts.scheme == "modbus-rtu" and path.strip("/"):
            settings = parse_qsl(
                parts.query, keep_blank_values=True, strict_parsing=bool(parts.query)
            )
            return _rtu(text, path, settings)
    except ValueError:
        pass
    raise ConfigError(
        f"{text!r} is not an endpoint of a Modbus device",
        hint="write modbus-tcp://192.168.0.6:502 or "
        "modbus-rtu:///dev/ttyUSB0?baud=19200&parity=E",
    )


def _rtu(text: str, path: str, settings: list[tuple[str, str]]) -> RtuEndpoint:
    """Raises ValueError for settings that are unknown, doubled or out of range."""
    given = dict(settings)
    if len(given) != len(settings) or not given.keys() <= {"baud", "parity", "stop"}:
        raise ValueError
    baud, parity = int(given.get("baud", "19200")), given.get("parity", "E").upper()
    stop_bits = int(given.get("stop", "1"))
    if not 300 <= baud <= 4_000_000 or parity not in ("N", "E", "O") or stop_bits not in (1, 2):
        raise ValueError
    return RtuEndpoint(text, path, baud, parity, stop_bits)
