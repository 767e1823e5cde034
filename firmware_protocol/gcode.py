"""One block of G-code as text: comments and spaces taken off, words split, or an error number.

The interpreter decides what the words *mean*. This module makes only the checks that both firmwares
make before that: letters (`error:1`) and numbers (`error:2`).
"""

from __future__ import annotations

import re

ERROR_EXPECTED_LETTER = 1
ERROR_BAD_NUMBER = 2

_UPPER = bytes(c - 32 if 97 <= c <= 122 else c for c in range(256))
_SPACES = bytes(range(0x21)) + b"/"  # the block-delete switch is off: '/' is ignored
_COMMENT = re.compile(rb"\([^)]*(?:\)|$)|;.*", re.DOTALL)
_NUMERIC = b"0123456789.+- "
_PLAIN = b"NGXYZFSMPT"  # with these float() reads nothing but digits: no E, INF, NAN
_LETTER = re.compile("([A-Z])")
_SOUND = re.compile(r"(?:[A-Z][+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))*")


class GcodeError(Exception):
    """The block is refused with `error:code`."""

    def __init__(self, code: int) -> None:
        super().__init__(f"error:{code}")
        self.code = code


def strip_comments_and_spaces(line: bytes) -> bytes:
    """What the firmware stores of a line: upper case, without spaces, comments and '/'.

    A comment runs from '(' to ')' or to the end of the line, or from ';' to the end.

    >>> strip_comments_and_spaces(b"N5 g1 x10.5 (there) F600 ; slow")
    b'N5G1X10.5F600'
    """
    if b"(" in line or b";" in line:
        line = _COMMENT.sub(b"", line)
    return line.translate(_UPPER, _SPACES)


def tokenise_block(line: bytes) -> list[tuple[str, float]]:
    """The words of a block in order, as (letter, value); an empty block gives no words.

    line : raw or already stripped text, without its line end
    raises : GcodeError 1 where a letter is missing, 2 where a number is

    >>> tokenise_block(b"N120 G1 X-10.5 F600")
    [('N', 120.0), ('G', 1.0), ('X', -10.5), ('F', 600.0)]
    """
    letters = line.translate(None, _NUMERIC)
    if not letters.translate(None, _PLAIN):  # the ordinary line, twice as fast
        words = line.decode().split()
        try:
            if len(words) == len(letters):  # so each begins with its letter, if float() agrees
                return [(word[0], float(word[1:])) for word in words]
        except ValueError:
            pass  # words without spaces between, or a mistake
    block = strip_comments_and_spaces(line).decode("latin-1")
    junk, *parts = _LETTER.split(block)
    try:
        block_words = list(zip(parts[::2], map(float, parts[1::2]), strict=True))
    except ValueError:
        raise _refusal(block) from None
    if junk or "_" in block or not block.isascii():  # float() is laxer than the firmware
        raise _refusal(block)
    return block_words


def _refusal(block: str) -> GcodeError:
    """What the firmware answers where reading the block from the left first fails."""
    sound = _SOUND.match(block)
    at = sound.end() if sound else 0
    return GcodeError(
        ERROR_BAD_NUMBER if "A" <= block[at : at + 1] <= "Z" else ERROR_EXPECTED_LETTER)
