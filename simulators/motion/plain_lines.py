"""Fast parsing of ordinary program lines: analyse each line shape once, then read only numbers.

A program has thousands of similar lines: the same few letters in the same order, with the same
number of digits. The module analyses each such shape once. For later lines of that shape it reads
only the numbers. Any other line takes the firmware's way, through `words`; nothing is refused
here.
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
    """Getter for the values of N, G, X, Y, Z, F and S in an ordinary line's numbers.

    alike : the line translated by `ALIKE`
    returns : a callable; call it with the numbers in order, followed by None, the value of a
        missing letter. None where the line is not made of words with these letters, each at most
        once, separated by spaces
    """
    words = alike.decode("latin-1").split(" ")
    letters = "".join(word[:1] for word in words)
    if len(set(letters)) < len(words) or not set(_LETTERS).issuperset(letters):
        return None
    if not all(_NUMBER.fullmatch(word, 1) for word in words):
        return None
    return itemgetter(*map(letters.find, _LETTERS))
