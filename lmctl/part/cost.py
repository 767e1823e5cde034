"""What a part will take before it is made: memory, disk, time; said early and refused in time."""

from __future__ import annotations

from dataclasses import dataclass

from lmctl.errors import InputError
from lmctl.field.store import no_room, room_for_mapped
from lmctl.part.resolution import (
    BYTES_KEPT,
    BYTES_PER_NODE,
    LIMIT_VARIABLE,
    disk_bytes,
    in_bytes,
    memory_limit_bytes,
)

#: Seconds a node, measured on a 2020s desktop core: they tell minutes from hours, no more.
CLOUD_S, OPERAND_S = 700e-9, 80e-9

#: Less than this is not worth a line.
SHORT_S, SMALL_BYTES = 5.0, 300e6


@dataclass(frozen=True)
class Item:
    """One thing to make: of what it is, its nodes, seconds a node, and whether all are stored.

    Large ones that are stored keep what stays of them on the disk.
    """

    what: str
    nodes: int
    each_s: float
    stored: bool

    @property
    def disk_bytes(self) -> float:
        return disk_bytes(self.nodes) if self.stored else 0.0


@dataclass(frozen=True)
class Cost:
    """Everything a part has to make before it can answer."""

    items: tuple[Item, ...]

    @property
    def memory_bytes(self) -> float:
        """What is kept of all, and what the largest takes besides while it is made."""
        kept = sum(BYTES_KEPT * item.nodes - item.disk_bytes for item in self.items)
        making = [(BYTES_PER_NODE - BYTES_KEPT) * i.nodes for i in self.items if i.stored]
        return kept + max(making, default=0)

    @property
    def disk_bytes(self) -> float:
        """What is kept in temporary files."""
        return sum(item.disk_bytes for item in self.items)

    @property
    def seconds(self) -> float:
        return sum(item.nodes * item.each_s for item in self.items)

    def said(self) -> str:
        """A line for a person, "" where there is little to wait for."""
        if self.seconds < SHORT_S and self.memory_bytes < SMALL_BYTES:
            return ""
        disk = ""
        if self.disk_bytes:
            disk = f", {in_bytes(self.disk_bytes)} of disk in {room_for_mapped()[0]}"
        return (f"this part takes about {in_bytes(self.memory_bytes)} of memory{disk} and "
                f"{_duration(self.seconds)} to make ready")

    def check(self) -> None:
        """Raises InputError where more memory would be taken than the user allows, or more disk
        than is free."""
        if self.disk_bytes and self.disk_bytes > room_for_mapped()[1]:
            raise no_room(self.disk_bytes)
        limit = memory_limit_bytes()
        if self.memory_bytes <= limit:
            return
        largest = sorted(self.items, key=lambda item: -item.nodes)[:3]
        share = (self.memory_bytes / limit) ** (1 / 3)
        raise InputError(
            f"this part would take about {in_bytes(self.memory_bytes)} of memory",
            where=[f"allowed are {in_bytes(limit)}",
                   *(f"{item.what}: {item.nodes:.2g} grid nodes" for item in largest)],
            hint=f"make pitch_mm {share:.2g} times as large, or allow more memory with "
            f"{LIMIT_VARIABLE}",
        )


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
