"""From measured points to a field: neighbours, fitted patches, inside and outside."""

from __future__ import annotations

__all__: list[str] = []
