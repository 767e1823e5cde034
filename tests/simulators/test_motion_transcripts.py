"""The simulated controller against what the real firmware said (transcripts).

Compared: every answer and message, in order; of the status reports the state, its number and the
fields present, in order. Not compared, as the recordings' README says: millimetres, and `Pn:` (the
Grbl build's inputs are unconnected).
"""

import json
from pathlib import Path

import pytest

from firmware_protocol.status import parse_status

RECORDINGS = Path(__file__).parents[1] / "firmware_protocol" / "transcripts"
FILES = {"grbl": "grbl-1.1h.jsonl", "grblhal": "grblhal.jsonl"}

# How long after each write the next one follows [s]; the last value goes on. The recordings do not
# tell, and the builds lag behind by up to 0.5 s: these are waits with which the *states* recorded
# come about. 0 puts the writes into one packet, where the Grbl build had not yet read the line
# when the real-time byte came.
WAITS = {
    ("grbl", "laser-move"): [1, 1, 0, 0.3, 0.3, 2, 1, 1, 0, 2],
    ("grbl", "hold-and-resume"): [1, 0, 1, 1, 1, 1, 0.5, 0.5, 1, 3],
    ("grbl", "resume-too-early"): [1, 0, 1, 0.3, 0.5, 0.5, 0.5, 3],
    ("grbl", "overrides"): [0.2] * 8 + [0.5, 2],
    ("grbl", "safety-door"): [1, 0, 1, 1, 0.5, 3, 1, 0.3],
    ("grbl", "reset-in-motion"): [0.2, 0.2, 0.2, 0.2, 0, 0.5, 0, 1],
    ("grbl", "cancel-from-hold"): [0, 0.7, 1, 1],
    ("grbl", "check-mode"): [1, 1, 1, 1, 0, 1],
    ("grbl", "jog"): [0, 0.1, 0.5, 0.5, 0.5, 0.5, 0, 1],
    ("grbl", "soft-limits"): [1, 1, 1, 0, 1],
    ("grbl", "line-numbers"): [0.5, 0, 0.1, 0.5, 0.5, 0.5],
    ("grbl", "buffer-state"): [0.1] * 13 + [0.1, 3],
    ("grbl", "sleep"): [0, 0.5, 0.5, 0.5, 0, 1],
    ("grbl", "dwell-and-sync"): [0, 0, 0, 0.1, 3],
    ("grbl", "error-policy"): [0, 0, 0, 0, 1.5],
    ("grblhal", "laser-move"): [0.1, 0.1, 0.3, 0.2, 0.2, 1, 0.1, 0.1, 1],
    ("grblhal", "hold-and-resume"): [0.1, 0.6, 0.06, 0.04, 0.2, 0.1, 0.2, 0, 4],
    ("grblhal", "resume-too-early"): [0.1, 0.6, 0.02, 0.2, 0.1, 0.1, 0.3, 3],
    ("grblhal", "overrides"): [0.4, 0.02, 0.02, 0.02, 0.02, 0.3, 0.3, 0.3, 0.3, 3],
    ("grblhal", "safety-door"): [0.1, 0.6, 0.3, 0.1, 0.6, 3, 0.1, 3],
    ("grblhal", "line-numbers"): [0.1, 0.1, 0.4, 0.5, 0.5, 2],
    ("grblhal", "buffer-state"): [0.02] * 13 + [0.1, 4],
}
SLOWLY = [1.5]
# Whatever was still moving at the end of a scenario when the next began.
PAUSES = {("grbl", "safety-door"): 0.1}
# The grblHAL recording was restarted here: output off, reports as after a reset.
RESET_BEFORE = {("grblhal", "dwell-and-sync")}

# Lines of the recordings that are not reproduced: (dialect, scenario, index) and why.
NOT_REPRODUCED = {
    ("grblhal", "check-mode", 0): "H: stands there for no reason that the recording shows",
    ("grblhal", "buffer-state", 13): "H: as above",
    ("grblhal", "sleep", 1): "H: as above",
    ("grbl", "overrides", 4): "Ov: the build took the bytes of one write apart, one report each",
}
# Lines said beyond the recording, and why.
ALSO_SAID = {
    ("grbl", "reset-in-motion"): ["error:9"],  # to G1 in Alarm: the build's reset swallowed it
}


def load(dialect):
    text = (RECORDINGS / FILES[dialect]).read_text()
    return [json.loads(line) for line in text.splitlines()]


def essence(line):
    """What is comparable of a line."""
    report = parse_status(line)
    if report is None:
        return line
    state, *fields = line.strip("<>").split("|")
    return (state, *(key for key, _, _ in (f.partition(":") for f in fields) if key != "Pn"))


ANYTHING = ("a report that is not reproduced",)


def agree(wanted, got):
    """got begins with what is wanted."""
    return len(got) >= len(wanted) and all(
        a in (b, ANYTHING) for a, b in zip(wanted, got, strict=False)
    )


def replay(rig, dialect):
    controller = rig(dialect, info="", settings={10: 1} if dialect == "grbl" else {})
    for row in load(dialect):
        scenario = row["scenario"]
        if (dialect, scenario) in RESET_BEFORE:
            controller.ask("\x18", 1.0)
        controller.ask("\n", 0.1)
        waits = WAITS.get((dialect, scenario), SLOWLY)
        waits = waits + [waits[-1]] * (len(row["sent"]) - len(waits))
        said = []
        packet = ""
        for text, wait in zip(row["sent"], waits, strict=True):
            packet += text
            if wait:
                said += controller.ask(packet, wait)
                packet = ""
        said += controller.ask(packet, PAUSES.get((dialect, scenario), 20.0))
        yield scenario, row["received"], said


@pytest.mark.parametrize("dialect", ["grbl", "grblhal"])
def test_says_what_the_firmware_said(rig, dialect):
    differences = {}
    for scenario, recorded, said in replay(rig, dialect):
        extra = list(ALSO_SAID.get((dialect, scenario), []))
        said = [line for line in said if not (line in extra and not extra.remove(line))]
        wanted = [
            ANYTHING if (dialect, scenario, index) in NOT_REPRODUCED else essence(line)
            for index, line in enumerate(recorded)
        ]
        got = [essence(line) for line in said]
        if dialect == "grbl":
            # It shows an answer only after the next byte: answers come later than reports here,
            # and what a scenario ends with is not in it.
            same = all(
                agree([x for x in wanted if type(x) is kind], [x for x in got if type(x) is kind])
                for kind in (str, tuple)
            )
        else:
            same = len(wanted) == len(got) and agree(wanted, got)
        if not same:
            differences[scenario] = (wanted, got)
    assert differences == {}
