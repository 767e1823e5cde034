"""Every code either firmware can give says what it is and what to do."""

from __future__ import annotations

import pytest

from firmware_protocol.codes import alarm_meaning, error_meaning, position_lost
from firmware_protocol.dialect import GRBL, GRBLHAL

GRBL_ERRORS = [*range(1, 18), *range(20, 39)]
GRBLHAL_ERRORS = [*range(1, 59), *range(60, 67), *range(70, 93), 253]


@pytest.mark.parametrize(
    ("dialect", "errors", "alarms"),
    [(GRBL, GRBL_ERRORS, range(1, 11)), (GRBLHAL, GRBLHAL_ERRORS, range(1, 23))],
    ids=["grbl", "grblhal"],
)
def test_every_code_is_told_in_words_with_a_remedy(dialect, errors, alarms):
    for meaning in [error_meaning(code, dialect) for code in errors] + [
        alarm_meaning(code, dialect) for code in alarms
    ]:
        assert "not listed" not in meaning.words
        assert len(meaning.words) > 10
        assert len(meaning.remedy) > 10


def test_unlisted_codes_say_so():
    assert "not listed for grbl" in error_meaning(44, GRBL).words
    assert "not listed" not in error_meaning(44, GRBLHAL).words
    assert "not listed" in alarm_meaning(99, GRBLHAL).words


def test_the_same_number_is_another_alarm_in_the_other_firmware():
    assert "emergency stop" in alarm_meaning(10, GRBLHAL).words
    assert "emergency stop" not in alarm_meaning(10, GRBL).words


def test_codes_of_the_transcripts_are_listed(scenarios):
    for scenario in scenarios:
        dialect = GRBL if scenario.dialect == "grbl" else GRBLHAL
        for line in scenario.received:
            kind, _, code = line.partition(":")
            if kind == "error":
                assert "not listed" not in error_meaning(int(code), dialect).words
            if kind == "ALARM":
                assert "not listed" not in alarm_meaning(int(code), dialect).words


def test_alarms_that_lose_the_position():
    assert [n for n in range(1, 11) if not position_lost(n, GRBL)] == [2, 4, 5]
    assert position_lost(10, GRBLHAL)
    assert not position_lost(13, GRBLHAL)
