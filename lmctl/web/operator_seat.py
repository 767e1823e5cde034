"""The seat of the one operator who may act through a live page at a time.

The operator who takes it gets a key that each act must carry, with a number higher than that of the
act before: an act that was recorded and sent again is refused.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field

from lmctl.errors import UsageError

#: An operator without a request for so long has left the seat [s].
IDLE_S = 60.0

_LONGEST_NAME = 80


@dataclass
class _Taken:
    name: str
    address: str
    used_s: float
    key: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    last_number: int = 0


class OperatorSeat:
    """One operator at a time. now_s : a clock that never goes back"""

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._taken: _Taken | None = None

    @property
    def operator(self) -> str:
        """Who has the seat, "" where it is free."""
        taken = self._taken
        if taken is not None and self._now_s() - taken.used_s > IDLE_S:
            self._taken = taken = None
        return "" if taken is None else taken.name

    def take(self, name: object, address: str, *, take_over: bool = False) -> str:
        """Take the seat; returns its key.

        take_over : also from an operator who has it
        Raises UsageError where another operator has it, or the name cannot be meant.
        """
        if not isinstance(name, str) or not name.isprintable() or not (
            1 <= len(name.strip()) <= _LONGEST_NAME
        ):
            raise UsageError(f'"operator" is a name of 1 to {_LONGEST_NAME} characters')
        if self.operator and not take_over:
            assert self._taken is not None
            raise UsageError(
                f"{self.operator} is the operator already", where=f"from {self._taken.address}",
                hint="one operates at a time: ask for the seat to be left, or take it over")
        self._taken = _Taken(name.strip(), address, self._now_s())
        return self._taken.key

    def holder_of(self, key: str | None) -> str:
        """The name under which the holder of a key acts; keeps the seat.

        Raises UsageError where the key is not that of the seat, or no longer.
        """
        taken = self._taken
        if key is None or not self.operator or taken is None or not hmac.compare_digest(
            key.encode("utf-8", "surrogateescape"), taken.key.encode()
        ):
            has = f": {self.operator} has it" if self.operator else ""
            raise UsageError(f"you do not have the operator's seat{has}",
                             hint="take control first")
        taken.used_s = self._now_s()
        return f"{taken.name} (live page, {taken.address})"

    def accept_number(self, number: object) -> None:
        """An act of the present holder carries this number. Raises UsageError for a repeated one.
        """
        assert self._taken is not None
        if type(number) is not int or not 0 < number < 2**53:
            raise UsageError('"number" is a whole number, higher for each act')
        if number <= self._taken.last_number:
            raise UsageError("this act was sent before, and is not repeated",
                             where=f"number {number}; the last one was {self._taken.last_number}",
                             hint="look at the state, and act anew")
        self._taken.last_number = number

    def leave(self, key: str | None) -> None:
        """Leave the seat. Raises as `holder_of`."""
        self.holder_of(key)
        self._taken = None
