"""The endpoint of a motion controller, as the machine profile states it."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import urlsplit

from lmctl.errors import ConfigError
from lmctl.machine.endpoint_keys import endpoint_keys


@dataclass(frozen=True)
class MotionEndpoint:
    """A parsed endpoint: kind "tcp" with host and port, or "serial" or "pty" with a path."""

    text: str
    kind: str
    host: str = ""
    port: int = 0
    path: str = ""


def parse_motion_endpoint(text: str) -> MotionEndpoint:
    """`tcp://HOST:PORT`, `serial:///dev/ttyUSB0` or `pty:///dev/pts/3`, without keys.

    Raises ConfigError for anything else; it names keys behind a `?`, none of which is known.
    """
    try:
        parts = urlsplit(text)
        port = parts.port
        if "#" in text or "@" in parts.netloc:  # they would have no effect
            raise ValueError
    except ValueError:  # a port that is no number, or out of range
        raise _no_endpoint(text) from None
    path = parts.netloc + parts.path  # serial://COM3 has no third slash
    if parts.scheme == "tcp" and parts.hostname and port and parts.path in ("", "/"):
        endpoint_keys(text, parts.query, {}, "remove what follows the ?")
        return MotionEndpoint(text, "tcp", host=parts.hostname, port=port)
    if parts.scheme in ("serial", "pty") and path.strip("/"):
        endpoint_keys(text, parts.query, {}, "write baud = 9600 into [motion] of the machine "
                      "profile; a motion controller's line is 8N1")
        return MotionEndpoint(text, parts.scheme, path=path)
    raise _no_endpoint(text)


def _no_endpoint(text: str) -> ConfigError:
    return ConfigError(
        f"{text!r} is not an endpoint of a motion controller",
        hint="write tcp://192.168.0.5:23, serial:///dev/ttyUSB0 or pty:///dev/pts/3",
    )
