"""Files named on the command line, looked for before anything large is imported for them."""

from __future__ import annotations

import re
from pathlib import Path

import click

from lmctl.errors import MissingFileError


class InputFile(click.ParamType):
    """A file that a command reads; what is in it, its reader judges. Raises MissingFileError."""

    name = "path"

    def convert(
        self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None
    ) -> Path:
        path = Path(value)
        try:
            path.stat()
        except (FileNotFoundError, NotADirectoryError):
            raise MissingFileError.for_path(path) from None
        except OSError:
            pass  # it is there, or its name is too long: its reader reports what is wrong
        return path


class InputFileOrRun(InputFile):
    """A file that a command reads, or a run by its name or its folder."""

    name = "path or run"

    def convert(
        self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None
    ) -> Path:
        path = Path(value)
        if re.fullmatch(r"run-[0-9]{4,9}", str(value)) and not path.exists():
            return path
        return super().convert(value, param, ctx)


def is_run(path: Path) -> bool:
    """Whether what was named is a run: its name, its folder, or its journal."""
    return path.suffix.lower() == ".jsonl" or path.is_dir() or not path.exists()
