"""`lmctl` and the simulated cell as processes of their own, forked from one that has imported both.

A host that is killed must be a process; that each of sixty spends a second of a core on imports
proves nothing.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from importlib import import_module
from multiprocessing.process import BaseProcess
from pathlib import Path

_PRELOADED = ["lmctl.cli.run", "lmctl.cli.recover", "lmctl.cli.bench", "lmctl.run.executor",
              "simulators.__main__"]


def start(program: str, arguments: list[object], folder: Path, name: str) -> BaseProcess:
    """Start `python -m program arguments`; what it says goes to folder/name.out and .err."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PRELOADED)
    process = context.Process(
        target=_be, args=(program, list(map(str, arguments)), str(folder / name)), daemon=True
    )
    process.start()
    return process


def _be(program: str, arguments: list[str], said: str) -> None:
    for stream, descriptor in (("out", 1), ("err", 2)):
        with open(f"{said}.{stream}", "w") as file:
            os.dup2(file.fileno(), descriptor)
    sys.exit(import_module(f"{program}.__main__").main(arguments))
