"""Which error messages the tests bring about: the whole test run, many minutes on one core.

messages : texts that the code gives to errors, findings and mistakes
messages_tested : the share of them that a run of the tests has brought about; those that it has not
    are printed on standard error. With LMCTL_MESSAGES set to a folder that a run with
    `-p tests.house.message_log` has filled, nothing is run.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.house.message_sites import MessageSites
from tests.house.messages import untested

ROOT = Path(__file__).resolve().parents[3]


def rows() -> dict[str, float | int]:
    if folder := os.environ.get("LMCTL_MESSAGES"):
        return _rows(Path(folder))
    with tempfile.TemporaryDirectory() as made:
        subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-n", "auto", "-p", "tests.house.message_log"],
            cwd=ROOT, env=os.environ | {"LMCTL_MESSAGES": made}, stdout=sys.stderr, check=False)
        return _rows(Path(made))


def _rows(folder: Path) -> dict[str, float | int]:
    known = MessageSites().all()
    missing = untested([folder], known)
    for site in missing:
        print(f"{site.path}:{site.line}: {site.pattern}", file=sys.stderr)
    return {"messages": len(known), "messages_tested": round(1 - len(missing) / len(known), 3)}
