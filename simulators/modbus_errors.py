"""How a simulated Modbus device does not do what it was asked."""

from __future__ import annotations

#: Exception codes (Modbus application protocol).
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, REFUSED, BUSY = 1, 2, 3, 4, 6


class ExceptionReplyError(Exception):
    """A request is answered by a Modbus exception."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


class RequestIgnoredError(Exception):
    """A request is not answered at all."""
