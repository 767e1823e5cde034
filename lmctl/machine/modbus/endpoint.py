"""The endpoint of a Modbus device, as the machine profile states it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

from lmctl.errors import ConfigError
from lmctl.machine.endpoint_keys import endpoint_key_error, endpoint_keys

_TCP_PORT = 502
_LEAST_BAUD, _MOST_BAUD = 300, 4_000_000

#: Keys of a modbus-rtu endpoint, each with its values in words.
RTU_KEYS = {
    "baud": f"{_LEAST_BAUD}..{_MOST_BAUD} (19200)", "parity": "N, E or O (E)", "stop": "1 or 2 (1)",
}


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

    Raises ConfigError for anything else; it names keys that are not known, and those that are.
    """
    try:
        parts = urlsplit(text)
        port = parts.port
        if "#" in text or "@" in parts.netloc:  # they would have no effect
            raise ValueError
    except ValueError:
        raise _no_endpoint(text) from None
    if parts.scheme == "modbus-tcp" and parts.hostname and parts.path in ("", "/") and port != 0:
        endpoint_keys(text, parts.query, {}, "a port follows the host: HOST:502")
        return TcpEndpoint(text, parts.hostname, port or _TCP_PORT)
    path = parts.netloc + parts.path
    if parts.scheme == "modbus-rtu" and path.strip("/"):
        return _rtu(text, path, endpoint_keys(text, parts.query, RTU_KEYS, ""))
    raise _no_endpoint(text)


def _no_endpoint(text: str) -> ConfigError:
    return ConfigError(
        f"{text!r} is not an endpoint of a Modbus device",
        hint="write modbus-tcp://192.168.0.6:502 or "
        "modbus-rtu:///dev/ttyUSB0?baud=19200&parity=E&stop=1",
    )


def _rtu(text: str, path: str, keys: Mapping[str, str]) -> RtuEndpoint:
    """Raises ConfigError for a value out of range."""
    baud, parity = keys.get("baud", "19200"), keys.get("parity", "E").upper()
    stop_bits = keys.get("stop", "1")
    wrong = []
    if not (baud.isdecimal() and _LEAST_BAUD <= int(baud) <= _MOST_BAUD):
        wrong.append(f"baud={baud}")
    if parity not in ("N", "E", "O"):
        wrong.append(f"parity={parity}")
    if stop_bits not in ("1", "2"):
        wrong.append(f"stop={stop_bits}")
    if wrong:
        raise endpoint_key_error(text, f"{' and '.join(wrong)} will not do", RTU_KEYS)
    return RtuEndpoint(text, path, int(baud), parity, int(stop_bits))
