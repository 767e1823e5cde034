"""Read the zip package of a 3MF file: find the model to build, and give the parts' bytes.

The relationships of the package name the start part (Open Packaging Conventions, ISO/IEC 29500-2);
where a model lies in the archive, and its name, do not matter. Sizes are bounded before
anything is unpacked, and XML that declares a document type, and so could define entities, is
refused.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Callable
from posixpath import join, normpath
from typing import Any
from urllib.parse import unquote
from xml.parsers import expat

from lmctl.errors import InputError
from lmctl.part.sources.files import MAX_DATA_BYTES, DataFile
from lmctl.part.sources.recognition import unreadable_file

START_PART = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
_RELATIONSHIPS = "_rels/.rels"

#: Between an element's namespace and its name, as expat is set to write them.
NAMESPACE_END = "|"

Start = Callable[[str, dict[str, str]], None]


class ThreemfPackage:
    """A 3MF file opened; its parts are known by names without the leading slash, in any case.

    Raises InputError where the file is no zip archive.
    """

    def __init__(self, file: DataFile) -> None:
        self.file = file
        self._unpacked = 0
        try:
            self._archive = zipfile.ZipFile(io.BytesIO(file.data))
        except (zipfile.BadZipFile, NotImplementedError, OSError, ValueError):
            raise self.damage_error("it is not a whole zip archive") from None
        self._members = {i.filename.lower().lstrip("/"): i for i in self._archive.infolist()}

    def start_part(self) -> str:
        """The name of the model to build. Raises InputError where none or several could be meant.
        """
        if _RELATIONSHIPS in self._members:
            targets: list[str] = []

            def start(name: str, attributes: dict[str, str]) -> None:
                if name.endswith(NAMESPACE_END + "Relationship") and (
                    attributes.get("Type") == START_PART
                ):
                    targets.append(attributes.get("Target", ""))

            self.parse(_RELATIONSHIPS, start)
            named = {part_name(target, "") for target in targets}
        else:
            models = [name for name in self._members if name.endswith(".model")]
            named = {"3d/3dmodel.model"} & set(models) or set(models)
        if not named:
            raise self.damage_error("it holds no 3D model")
        if len(named) > 1:
            raise self.damage_error("several models could be the one to build: "
                                    + ", ".join(sorted(named))[:150])
        return named.pop()

    def parse(self, part: str, start: Start, **handlers: Any) -> None:
        """Read a part's XML: `start` is called with each element's name and attributes.

        handlers : others of expat's, by its own names. Raises InputError
        """
        parser = expat.ParserCreate(namespace_separator=NAMESPACE_END)
        parser.buffer_text = True
        parser.StartElementHandler = start
        for name, handler in handlers.items():
            setattr(parser, name, handler)

        def refuse_document_type(*_: Any) -> None:
            raise self.damage_error(f"{part} defines entities")

        parser.StartDoctypeDeclHandler = refuse_document_type
        try:
            parser.Parse(self._bytes(part), True)
        except KeyError as error:  # of the attributes that `start` looks up
            raise self.damage_error(
                f"{part}: an element lacks its attribute {error.args[0]}") from None
        except (expat.ExpatError, LookupError, ValueError) as error:
            raise self.damage_error(f"{part}: {str(error)[:100]}") from None

    def damage_error(self, why: str) -> InputError:
        """The error for a package that cannot be read."""
        return unreadable_file(self.file, why)

    def _bytes(self, part: str) -> bytes:
        member = self._members.get(part)
        if member is None:
            raise self.damage_error(f"there is no part {part} in it")
        self._unpacked += member.file_size
        if self._unpacked > MAX_DATA_BYTES:
            raise self.damage_error(f"{part} unpacks to {member.file_size:,} bytes; at most "
                                    f"{MAX_DATA_BYTES:,} in all")
        try:
            # no further than the stated size, true or not
            with self._archive.open(member) as opened:
                return opened.read(member.file_size + 1)
        except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError,
                OSError, ValueError):
            raise self.damage_error(
                f"{part} is damaged in the archive, or packed in a way that is not "
                                    "known") from None


def part_name(target: str, beside: str) -> str:
    """The name of the part that a reference means. beside : the part that the reference is in."""
    path = unquote(target)
    folder = beside.rpartition("/")[0]
    absolute = path if path.startswith("/") else join("/" + folder, path)
    return normpath(absolute).lstrip("/").lower()
