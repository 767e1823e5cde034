"""What a test asks of an error: the facts that a person needs, and what to do next."""

from __future__ import annotations

from lmctl.errors import LmctlError


def assert_states(error: LmctlError, *facts: str) -> None:
    """The error, as it is printed, states each of the facts, and has a hint or lists mistakes."""
    text = error.render()
    assert [fact for fact in facts if fact not in text] == [], text
    assert error.hint or getattr(error, "findings", ()), text
