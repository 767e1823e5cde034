"""Whether tests/faults/MATRIX.md is what its generator makes, without making all of it.

The document carries two digests: of what the generator reads (kinds of fault, states, what is
expected, the cell and the job), and of its own rows, which an edit by hand changes. A few cells,
chosen by the latter, are made anew.
"""

from __future__ import annotations

import hashlib
import random
import re
from pathlib import Path

from simulators.faults.kinds import FAULT_KINDS
from tests.faults import expected
from tests.faults.kills import shortened
from tests.faults.matrix import STATES, faults_of, try_one, write_job

MATRIX = Path(__file__).with_name("MATRIX.md")
ADVICE = "run `make faults`, look at what has changed, and commit the table"
_SAMPLED = 6
_DIGESTS = re.compile(r"<!-- made from ([0-9a-f]{64}), rows ([0-9a-f]{64}) -->")


def stamp(rows: list[str]) -> str:
    """The line that the generator writes below its table."""
    return f"<!-- made from {digest_of_inputs()}, rows {digest_of_rows(rows)} -->"


def digest_of_inputs() -> str:
    """SHA-256 of what the generator reads: by meaning, so that words of documents do not count."""
    kinds = [
        (name, kind.is_lasting, [
            (one.name, one.default, one.minimum, one.maximum,
             one.choices) for one in kind.parameters
        ])
        for name, kind in sorted(FAULT_KINDS.items())
    ]
    judged = (sorted(expected.EXPECTED.items()), sorted(expected.SEEN_WITHIN_S.items()),
              sorted(expected.LASTS_S.items()), sorted(expected.UNSEEN))
    texts = (shortened("cell-safe.toml"), shortened("bench-safe.toml"))
    rows = [str(fault) for name in FAULT_KINDS for fault in faults_of(name)]
    return _sha256(repr((kinds, judged, texts, rows, [state.value for state in STATES])))


def digest_of_rows(rows: list[str]) -> str:
    """SHA-256 of the rows of the table as they stand."""
    return _sha256("\n".join(rows))


def rows_of(text: str) -> list[str]:
    """The rows of the document's table, without its head."""
    return [line for line in text.splitlines() if line.startswith("| ")][2:]


def staleness(text: str, folder: Path, sampled: int = _SAMPLED) -> list[str]:
    """In what a document differs from what its generator makes, as far as is looked at.

    folder : where sampled cells are run
    """
    rows, stamped = rows_of(text), _DIGESTS.search(text)
    if stamped is None:
        return ["it carries no digests"]
    found = []
    if stamped[1] != digest_of_inputs():
        found.append("kinds, states, expectations or the cell have changed since it was made")
    if stamped[2] != digest_of_rows(rows):
        found.append("its rows were edited by hand")
    wanted = [str(fault) for name in FAULT_KINDS for fault in faults_of(name)]
    if [cells_of(row)[0] for row in rows] != wanted:
        found.append("its rows are not those of the faults there are")
    if found:
        return found
    faults = [fault for name in FAULT_KINDS for fault in faults_of(name)]
    job = write_job(folder)
    draw = random.Random(stamped[2])
    for at in draw.sample(range(len(rows)), min(sampled, len(rows))):
        state = draw.choice(STATES)
        made, listed = try_one(faults[at], state, folder, job).text, cells_of(rows[at])[
            2 + STATES.index(state)]
        if made != listed:
            found.append(f"{faults[at]} in {state}: it says {listed!r}, and is {made!r}")
    return found


def cells_of(row: str) -> list[str]:
    """The cells of a row of a Markdown table."""
    return [cell.strip() for cell in row.strip("| ").split(" | ")]


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
