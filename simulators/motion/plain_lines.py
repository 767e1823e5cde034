"""Ordinary lines of a program, and the numbers in them, without taking every letter in hand.

A program is thousands of lines alike: the same few letters in the same order, and as many digits.
So what a line's shape says is worked out once a shape, and of the next line like it only the
numbers are read. A line that is not ordinary goes the firmware's way, through `words`; nothing is
refused here.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from operator import itemgetter
from typing import Any

_LETTERS = "NGXYZFS"
_NUMBER = re.compile(r"[+-]?(?:0+\.?0*|\.0+)")

#: Translates a line to its shape: all digits 0.
DIGITS_TO_ZERO_TABLE = bytes.maketrans(b"123456789", b"000000000")

#: Translates an ordinary line to its numbers, with spaces between.
LETTERS_TO_SPACES_TABLE = bytes.maketrans(_LETTERS.encode(), b" " * len(_LETTERS))


@lru_cache(maxsize=4096)
def word_value_extractor(alike: bytes) -> Callable[[Sequence[float | None]],
                                                   tuple[Any, ...]] | None:
    """What picks the values of N, G, X, Y, Z, F and S out of an ordinary line's numbers.

    alike : the line translated by `ALIKE`
    returns : to be called with the numbers in their order and None behind them, which is what a
        letter gets that is not there; or None where the line is not words of these letters, none
        of them twice, with spaces between
    """
    words = alike.decode("latin-1").split(" ")
    letters = "".join(word[:1] for word in words)
    if len(set(letters)) < len(words) or not set(_LETTERS).issuperset(letters):
        return None
    if not all(_NUMBER.fullmatch(word, 1) for word in words):
        return None
    return itemgetter(*map(letters.find, _LETTERS))
