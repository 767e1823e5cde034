"""Files named on the command line, looked for before anything large is imported for them."""

from __future__ import annotations

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
