"""The margins of a plan's mixture, from a job's totals, in one line."""

from __future__ import annotations

from typing import Any


def margins_text(totals: dict[str, Any]) -> str:
    """Shares of path (±0.02) and volume (±0.03) that get their mixture, as predicted and at worst.

    totals : of a manifest; "" where they state no margins: one material, or an earlier version
    """
    margins = totals.get("margins")
    if not isinstance(margins, dict):
        return ""
    ranges = [margins.get(key) for key in ("path", "volume")]
    words = []
    for of, found in zip(("path", "volume"), ranges, strict=True):
        if not isinstance(found, dict):
            return ""
        text = f"{found['predicted']:.1%} of the {of} as predicted"
        if "worst" in found:
            text += f" ({found['worst']:.1%} at worst)"
        words.append(text)
    unmeasured = margins.get("intervals_not_measured")
    if unmeasured:
        words.append(f"intervals not measured of hopper {', '.join(unmeasured)}")
    return ", ".join(words)
