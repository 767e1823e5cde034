"""Which axis of a mesh or cloud points up, as a body of a part file that turns it."""

from __future__ import annotations

#: Axis and degrees of the turn that makes each axis of a model the upward one.
_TURNS = {
    "x": ([0, 1, 0], -90), "-x": ([0, 1, 0], 90), "y": ([1, 0, 0], 90), "-y": ([1, 0, 0], -90),
    "z": None, "-z": ([1, 0, 0], 180),
}

UP_AXES = tuple(_TURNS)


def turned_body_text(of: str, up: str) -> str:
    """The table of a body that turns the body `of`, so that its axis `up` points up; "" for z.

    >>> print(turned_body_text("model", "-z"))
    <BLANKLINE>
    [[body]]
    kind = "moved"
    of = "model"
    turn = { axis = [1, 0, 0], degrees = 180 }
    <BLANKLINE>
    """
    turn = _TURNS[up]
    if turn is None:
        return ""
    axis, degrees = turn
    return (f'\n[[body]]\nkind = "moved"\nof = "{of}"\n'
            f"turn = {{ axis = {axis}, degrees = {degrees} }}\n")
