"""Where a motion controller is, as the machine profile writes it."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import urlsplit

from lmctl.errors import ConfigError


@dataclass(frozen=True)
class Endpoint:
    """A parsed endpoint: kind "tcp" with host and port, or "serial" or "pty" with a path."""

    text: str
    kind: str
    host: str = ""
    port: int = 0
    path: str = ""


def parse_endpoint(text: str) -> Endpoint:
    """`tcp://HOST:PORT`, `serial:///dev/ttyUSB0` or `pty:///dev/pts/3`. Raises ConfigError."""
    try:
        parts = urlsplit(text)
        if parts.scheme == "tcp" and parts.hostname and parts.port and parts.path in ("", "/"):
            return Endpoint(text, "tcp", host=parts.hostname, port=parts.port)
    except ValueError:  # a port that is no number, or out of range
        pass
    else:
        path = parts.netloc + parts.path  # serial://COM3 has no third slash
        if parts.scheme in ("serial", "pty") and path.strip("/"):
            return Endpoint(text, parts.scheme, path=path)
    raise ConfigError(
        f"{text!r} is not an endpoint of a motion controller",
        hint="write tcp://192.168.0.5:23, serial:///dev/ttyUSB0 or pty:///dev/pts/3",
    )
