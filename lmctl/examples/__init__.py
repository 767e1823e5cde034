"""Examples that ship with lmctl: the graded gear, the bench and its cell profile."""

__all__: list[str] = []
