"""What the README shows of the library is a program that runs."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from lmctl.examples.templates import write_template

README = Path(__file__).resolve().parent.parent / "README.md"


def test_the_library_in_ten_lines(tmp_path: Path) -> None:
    (program,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.S)
    statements = [line for line in program.splitlines() if line and not line.startswith(
        ("import", "from"))]
    assert len(statements) <= 10
    write_template("box", tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False,
    )
    assert done.returncode == 0, done.stderr
    distance, log = done.stdout.split("\n", 1)
    assert distance.startswith("[2.]")
    assert "JOB LOG" in log
    assert "whole and sealed" in log
