"""A worn bar, from its scan to a finished run, as the example has it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def test_a_worn_bar_is_filled_up(lmctl: Callable[..., Any]) -> None:
    assert lmctl("init", "repair", ".").code == 0
    planned = lmctl("plan", "repair.toml", "--machine", "cell.toml")
    assert planned.code == 0
    assert "lies on 'nominal'" in planned.talk
    pictured = lmctl("show", "repair.lmj", "--layer", "1")
    assert pictured.data.strip() == "repair-layer-1.png"
    run = lmctl("run", "repair.lmj", "--sim")
    assert run.code == 0
    assert ": done" in run.data
