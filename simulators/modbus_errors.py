"""Errors with which a simulated Modbus device rejects or ignores a request."""

from __future__ import annotations

#: Exception codes (Modbus application protocol).
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, REFUSED, BUSY = 1, 2, 3, 4, 6


class ExceptionReplyError(Exception):
    """The device answers a request with a Modbus exception."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


class RequestIgnoredError(Exception):
    """The device does not answer a request."""
