"""Reports of a part of 1,000 layers, planned and run on the simulated cell, and of a huge journal.

`report_s`: wall clock of `lmctl report -o report.html`; `report_pdf_s`: the same as PDF;
`report_journal_mb`: size of that part's journal; `report_peak_mb`: memory of the HTML report;
`report_huge_peak_mb`: memory of the report of a journal whose samples repeat until it holds
`report_huge_gb`.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from lmctl.run.journal.format import read_records
from lmctl.run.journal.writer import JournalWriter
from tests.benchmarks.plan_rows.measured import LMCTL, run

_PART = """
name = "tower"
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [12, 8, 150]
[composition]
feature = { kind = "plane", point_mm = [0, 0, 0], normal = [0, 0, 1] }
profile = { kind = "linear", near = { "316L" = 0.7, "WC-12Co" = 0.3 }, \
far = { "316L" = 0.3, "WC-12Co" = 0.7 }, over_mm = [0, 150] }
[process]
layer_height_mm = 0.15
speed_mm_s = 30
"""
_HUGE_GB = 0.5


def rows() -> dict[str, float]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "tower.toml").write_text(_PART)
        run([*LMCTL, "plan", "tower.toml", "-o", "tower.lmj"], folder)
        run([*LMCTL, "run", "tower.lmj", "--sim", "--operator", "bench"], folder)
        journal = folder / "runs/run-0001/journal.jsonl"
        layers = sum(record["kind"] == "layer" for record in read_records(journal))
        if layers != 1000:
            raise SystemExit(f"the part has {layers} layers, not 1,000")
        html = run([*LMCTL, "report", "run-0001", "-o", "a.html"], folder)
        pdf = run([*LMCTL, "report", "run-0001", "-o", "a.pdf"], folder)
        huge = _huge(journal, folder / "huge")
        peak = run([*LMCTL, "report", str(huge), "-o", "b.html"], folder).peak_mb
        return {
            "report_s": round(html.wall_s, 1), "report_pdf_s": round(pdf.wall_s, 1),
            "report_journal_mb": round(journal.stat().st_size / 1e6, 1),
            "report_peak_mb": round(html.peak_mb), "report_huge_peak_mb": round(peak),
            "report_huge_gb": round(huge.stat().st_size / 1e9, 2),
        }


def _huge(journal: Path, folder: Path) -> Path:
    """A journal with the same layers whose samples repeat until it is as large as wanted."""
    folder.mkdir()
    header, *records = read_records(journal)
    samples = [one for one in records if one["kind"] == "samples"]
    size = sum(len(json.dumps(one)) + 80 for one in samples)
    times = int(_HUGE_GB * 1e9 / size) + 1
    for key in ("prev", "seq", "t", "kind", "format"):
        header.pop(key)
    with JournalWriter(folder / "journal.jsonl", header, local=header.pop("local")) as written:
        for record in records[:-1]:
            fields = {key: value for key, value in record.items()
                      if key not in ("prev", "seq", "t", "kind")}
            for _ in range(times if record["kind"] == "samples" else 1):
                written.append(record["t"], record["kind"], **fields)
            written.flush()
    return folder / "journal.jsonl"
