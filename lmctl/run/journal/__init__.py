"""The journals of runs and machines, and what they prove afterwards."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.journal.figures import ExecutionFigures as ExecutionFigures
    from lmctl.run.journal.format import JournalVerification as JournalVerification
    from lmctl.run.journal.format import read_records as read_records
    from lmctl.run.journal.format import verify_journal as verify_journal
    from lmctl.run.journal.last_known_position import LastKnownPosition as LastKnownPosition
    from lmctl.run.journal.notes import Disposition as Disposition
    from lmctl.run.journal.notes import Note as Note
    from lmctl.run.journal.notes import add_note as add_note
    from lmctl.run.journal.notes import notes_path as notes_path
    from lmctl.run.journal.notes import read_notes as read_notes
    from lmctl.run.journal.notes import verify_notes as verify_notes
    from lmctl.run.journal.recorder import LatestReport as LatestReport
    from lmctl.run.journal.recorder import Refill as Refill
    from lmctl.run.journal.recorder import RunRecorder as RunRecorder
    from lmctl.run.journal.recorder import place_fields as place_fields
    from lmctl.run.journal.recorder import wall_stamp as wall_stamp
    from lmctl.run.journal.recovery import MachineSeen as MachineSeen
    from lmctl.run.journal.recovery import RecoveryPlace as RecoveryPlace
    from lmctl.run.journal.recovery import doubt_in_words as doubt_in_words
    from lmctl.run.journal.recovery import find_recovery_place as find_recovery_place
    from lmctl.run.journal.recovery import refuse_finished as refuse_finished
    from lmctl.run.journal.recovery import stated_by_operator as stated_by_operator
    from lmctl.run.journal.replay import RunReplay as RunReplay
    from lmctl.run.journal.replay import continuing_runs as continuing_runs
    from lmctl.run.journal.replay import replay_run as replay_run
    from lmctl.run.journal.run_folders import RunFolder as RunFolder
    from lmctl.run.journal.run_folders import command_line as command_line
    from lmctl.run.journal.run_folders import list_runs as list_runs
    from lmctl.run.journal.writer import JournalWriter as JournalWriter
    from lmctl.run.journal.writer import is_owned as is_owned

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "Disposition": "lmctl.run.journal.notes",
    "ExecutionFigures": "lmctl.run.journal.figures",
    "JournalVerification": "lmctl.run.journal.format",
    "JournalWriter": "lmctl.run.journal.writer",
    "LastKnownPosition": "lmctl.run.journal.last_known_position",
    "LatestReport": "lmctl.run.journal.recorder",
    "MachineSeen": "lmctl.run.journal.recovery",
    "Note": "lmctl.run.journal.notes",
    "RecoveryPlace": "lmctl.run.journal.recovery",
    "Refill": "lmctl.run.journal.recorder",
    "RunFolder": "lmctl.run.journal.run_folders",
    "RunRecorder": "lmctl.run.journal.recorder",
    "RunReplay": "lmctl.run.journal.replay",
    "add_note": "lmctl.run.journal.notes",
    "command_line": "lmctl.run.journal.run_folders",
    "continuing_runs": "lmctl.run.journal.replay",
    "doubt_in_words": "lmctl.run.journal.recovery",
    "find_recovery_place": "lmctl.run.journal.recovery",
    "is_owned": "lmctl.run.journal.writer",
    "list_runs": "lmctl.run.journal.run_folders",
    "notes_path": "lmctl.run.journal.notes",
    "place_fields": "lmctl.run.journal.recorder",
    "read_notes": "lmctl.run.journal.notes",
    "read_records": "lmctl.run.journal.format",
    "refuse_finished": "lmctl.run.journal.recovery",
    "replay_run": "lmctl.run.journal.replay",
    "stated_by_operator": "lmctl.run.journal.recovery",
    "verify_journal": "lmctl.run.journal.format",
    "verify_notes": "lmctl.run.journal.notes",
    "wall_stamp": "lmctl.run.journal.recorder",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
