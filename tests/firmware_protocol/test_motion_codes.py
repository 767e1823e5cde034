"""Every code either firmware can give says what it is and what to do."""

from __future__ import annotations

import pytest

from firmware_protocol.codes import alarm_loses_position, alarm_meaning, error_meaning
from firmware_protocol.dialect import GRBL, GRBLHAL

GRBL_ERRORS = [*range(1, 18), *range(20, 39)]
GRBLHAL_ERRORS = [*range(1, 59), *range(60, 67), *range(70, 93), 253]


@pytest.mark.parametrize(
    ("dialect", "errors", "alarms"),
    [(GRBL, GRBL_ERRORS, range(1, 11)), (GRBLHAL, GRBLHAL_ERRORS, range(1, 23))],
    ids=["grbl", "grblhal"],
)
def test_every_code_is_reported_in_words_with_a_remedy(dialect, errors, alarms):
    for meaning in [error_meaning(code, dialect) for code in errors] + [
        alarm_meaning(code, dialect) for code in alarms
    ]:
        assert "not listed" not in meaning.description
        assert len(meaning.description) > 10
        assert len(meaning.remedy) > 10


def test_unlisted_codes_say_so():
    assert "not listed for grbl" in error_meaning(44, GRBL).description
    assert "not listed" not in error_meaning(44, GRBLHAL).description
    assert "not listed" in alarm_meaning(99, GRBLHAL).description


@pytest.mark.parametrize(
    ("code", "words"),
    [(64, "no memory card is mounted"), (65, "no file system is mounted"),
     (66, "the file system is read-only"), (84, "a file could not be opened"),
     (85, "the file system could not be formatted")],
)
def test_numbers_that_grblhal_gave_another_meaning(code, words):
    """grblHAL `errors.h` of 2025, and the SD card plugin's texts for it."""
    assert error_meaning(code, GRBLHAL).description == words


@pytest.mark.parametrize("code", [86, 87, 88, 89])
def test_a_number_whose_text_differs_between_builds_is_to_be_asked_of_the_controller(code):
    assert "$EE" in error_meaning(code, GRBLHAL).remedy


def test_the_same_number_is_another_alarm_in_the_other_firmware():
    assert "emergency stop" in alarm_meaning(10, GRBLHAL).description
    assert "emergency stop" not in alarm_meaning(10, GRBL).description


def test_codes_of_the_transcripts_are_listed(scenarios):
    for scenario in scenarios:
        dialect = GRBL if scenario.dialect == "grbl" else GRBLHAL
        for line in scenario.received:
            kind, _, code = line.partition(":")
            if kind == "error":
                assert "not listed" not in error_meaning(int(code), dialect).description
            if kind == "ALARM":
                assert "not listed" not in alarm_meaning(int(code), dialect).description


def test_alarms_that_lose_the_position():
    assert [n for n in range(1, 11) if not alarm_loses_position(n, GRBL)] == [2, 4, 5]
    assert alarm_loses_position(10, GRBLHAL)
    assert not alarm_loses_position(13, GRBLHAL)
