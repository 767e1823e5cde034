"""Journals of runs that broke off, made from the journal of a whole one."""

from __future__ import annotations

import shutil

from firmware_protocol.dialect import GRBLHAL
from lmctl.run.journal.format import FIRST_PREVIOUS_HASH, encode_record, line_hash, read_records
from lmctl.run.journal.recovery import MachineSeen
from lmctl.run.journal.run_folders import RunFolder


def seen(position_mm, **more):
    """A controller without homing, that says a place and has not restarted."""
    known = {"at_zero": False, "restarted": False, "homed": False, "doubt": "", "recorded_loss": "",
             "dialect": GRBLHAL, "uptimes_s": {}}
    at = None if position_mm is None else tuple(position_mm)
    return MachineSeen(at, **{**known, **more})


def broken_off(folder, whole, records):
    """The folder of a run whose journal ends after so many records, as a crash leaves it."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    shutil.copyfile(whole.job, folder / "job.lmj")
    lines, prev = [], FIRST_PREVIOUS_HASH
    for seq, record in enumerate(list(read_records(whole.journal))[:records]):
        fields = {k: v for k, v in record.items() if k not in ("prev", "seq", "t", "kind")}
        line = encode_record(prev, seq, record["t"], record["kind"], fields)
        lines.append(line)
        prev = line_hash(line)
    whole_lines = b"".join(line + b"\n" for line in lines)
    (folder / "journal.jsonl").write_bytes(whole_lines + b'{"prev":"half writ')
    return RunFolder(folder)


def changed_header(folder, whole, records, **fields):
    """The same, with other fields in its header; None takes one away."""
    made = broken_off(folder, whole, records)
    lines, prev = [], FIRST_PREVIOUS_HASH
    for seq, record in enumerate(read_records(made.journal)):
        kept = {k: v for k, v in record.items() if k not in ("prev", "seq", "t", "kind")}
        if seq == 0:
            kept = {k: v for k, v in (kept | fields).items() if v is not None}
        lines.append(encode_record(prev, seq, record["t"], record["kind"], kept))
        prev = line_hash(lines[-1])
    made.journal.write_bytes(b"\n".join(lines) + b"\n")
    return made
