"""Estimate memory, disk and time of a part before it is built; refuse it if too large."""

from __future__ import annotations

from dataclasses import dataclass

from lmctl.errors import InputError
from lmctl.field.array_storage import mapped_storage_space, storage_full_message
from lmctl.part.resolution import (
    BYTES_KEPT_PER_NODE,
    BYTES_PER_NODE,
    MEMORY_LIMIT_VARIABLE,
    field_disk_bytes,
    format_bytes,
    memory_limit_bytes,
)

#: Seconds per node, measured on a 2020s desktop core: enough to separate minutes from hours.
CLOUD_S, OPERAND_S = 700e-9, 80e-9

#: Less than this is not reported.
SHORT_S, SMALL_BYTES = 5.0, 300e6


@dataclass(frozen=True)
class CostItem:
    """One thing to make: of what it is, its nodes, seconds a node, and whether all are stored.

    Large ones that are stored keep what stays of them on the disk.
    """

    description: str
    nodes: int
    seconds_per_node: float
    is_stored: bool

    @property
    def disk_bytes(self) -> float:
        return field_disk_bytes(self.nodes) if self.is_stored else 0.0


@dataclass(frozen=True)
class PartCost:
    """Everything a part has to compute before it is ready."""

    items: tuple[CostItem, ...]

    @property
    def memory_bytes(self) -> float:
        """What is kept of all, and what the largest takes besides while it is made."""
        kept = sum(BYTES_KEPT_PER_NODE * item.nodes - item.disk_bytes for item in self.items)
        making = [
            (BYTES_PER_NODE - BYTES_KEPT_PER_NODE) * i.nodes for i in self.items if i.is_stored]
        return kept + max(making, default=0)

    @property
    def disk_bytes(self) -> float:
        """What is kept in temporary files."""
        return sum(item.disk_bytes for item in self.items)

    @property
    def seconds(self) -> float:
        return sum(item.nodes * item.seconds_per_node for item in self.items)

    def summary(self) -> str:
        """A line for the user, "" where the cost is small."""
        if self.seconds < SHORT_S and self.memory_bytes < SMALL_BYTES:
            return ""
        disk = ""
        if self.disk_bytes:
            disk = f", {format_bytes(self.disk_bytes)} of disk in {mapped_storage_space()[0]}"
        return (f"this part takes about {format_bytes(self.memory_bytes)} of memory{disk} and "
                f"{_duration(self.seconds)} to make ready")

    def refuse_if_too_large(self) -> None:
        """Raises InputError where more memory would be taken than the user allows, or more disk
        than is free."""
        if self.disk_bytes and self.disk_bytes > mapped_storage_space()[1]:
            raise storage_full_message(self.disk_bytes)
        limit = memory_limit_bytes()
        if self.memory_bytes <= limit:
            return
        largest = sorted(self.items, key=lambda item: -item.nodes)[:3]
        share = (self.memory_bytes / limit) ** (1 / 3)
        raise InputError(
            f"this part would take about {format_bytes(self.memory_bytes)} of memory",
            where=[f"allowed are {format_bytes(limit)}",
                   *(f"{item.description}: {item.nodes:.2g} grid nodes" for item in largest)],
            hint=f"make pitch_mm {share:.2g} times as large, or allow more memory with "
            f"{MEMORY_LIMIT_VARIABLE}",
        )


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
