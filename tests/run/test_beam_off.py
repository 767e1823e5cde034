"""No power leaves for a machine that is not the bench."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lmctl.errors import JobError
from lmctl.run.program.beam_off import line_without_beam


@pytest.mark.parametrize(
    ("line", "sent"),
    [
        (b"N12 G1 X1.000 Y2.000 F600 S500", b"N12 G1 X1.000 Y2.000 F600 S0"),
        (b"N12 G1 X1.000 S0.5 Y2.000", b"N12 G1 X1.000 S0 Y2.000"),
        (b"N1 M4 S1000", b"N1 M4 S0"),
        (b"N1 G0 X5.000", b"N1 G0 X5.000"),
        (b"N1 M5", b"N1 M5"),
        (b"N1 M04 S3", b"N1 M04 S0"),
        (b"N1 G1 X1 S0", b"N1 G1 X1 S0"),
    ],
)
def test_power_becomes_zero_and_nothing_else_changes(line, sent):
    assert line_without_beam(line) == sent


@pytest.mark.parametrize("word", ["M3", "M03", "M3.0", "M67", "M44", "M5.1", "M30", "M", "M45"])
def test_other_m_words_are_refused(word):
    with pytest.raises(JobError, match="may not run without interlocks"):
        line_without_beam(f"N7 {word} S100".encode())


words = st.sampled_from(["G1", "G0", "X1.5", "Y-2", "F600", "S5", "S1000", "S0.1", "M4", "M5"])


@given(st.lists(words, min_size=1, max_size=8))
def test_whatever_the_words_no_power_is_left(line):
    sent = line_without_beam(" ".join(["N1", *line]).encode()).decode()
    assert all(float(s) == 0 for s in re.findall(r"S([0-9.]+)", sent))
    assert re.sub(r"S[0-9.]+", "S", sent) == re.sub(r"S[0-9.]+", "S", " ".join(["N1", *line]))
