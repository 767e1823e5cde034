"""Read a job a layer at a time, in constant memory; refuse any file that is not a complete job."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import JobError, MissingFileError
from lmctl.job import container
from lmctl.job.layer_rules import first_broken_rule
from lmctl.job.manifest_json import manifest_from_json, part_digest
from lmctl.job.schema import JobLayer, JobManifest, line_dtype


class JobReader:
    """An open job file. Use as a context manager.

    digest : SHA-256 of the file, hexadecimal; identifies the job
    Opening reads the file once to verify its digest. Raises MissingFileError, or JobError where it
    is truncated, altered, of another version, or hostile; so do `layer` and `layers`.
    """

    manifest: JobManifest
    part_text: str
    digest: str

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> Self:
        try:
            self._file = self._path.open("rb")
        except FileNotFoundError:
            raise MissingFileError.for_path(self._path) from None
        except IsADirectoryError:
            raise JobError(f"{self._path} is a folder, not a job file",
                           hint="name the job file in it") from None
        except OSError as error:
            raise JobError.cannot_read(self._path, error) from None
        try:
            self._open()
        except BaseException:
            self._file.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._zip.close()
        self._file.close()

    def read_layer(self, index: int) -> JobLayer:
        """The layer, verified against its digest in the manifest."""
        entry = self.manifest.layers[index]
        where = f"layer {entry.index}"
        data = tuple(
            self._member(name, container.MAX_MEMBER_BYTES)
            for name in container.layer_member_names(entry.index)
        )
        if container.layer_digest(data) != entry.sha256:
            raise JobError(f"{self._path} was damaged or altered", where=where,
                           hint=container.REPLAN_HINT)
        n_hoppers = len(self.manifest.hoppers)
        text, *arrays = data
        try:
            program = tuple(text.decode("ascii").removesuffix("\n").split("\n"))
            lines = _array(arrays[0], line_dtype(len(self.manifest.materials)), ())
            flow_s = _array(arrays[1], np.dtype("<f8"), ())
            flow_g_s = _array(arrays[2], np.dtype("<f8"), (n_hoppers,))
        except ValueError as error:
            raise self._no_layer(where, str(error)) from None
        layer = JobLayer(entry.index, entry.z_mm, entry.first_line, program, lines, flow_s,
                         flow_g_s)
        broken = first_broken_rule(layer, len(self.manifest.materials), n_hoppers)
        if broken is None and len(program) != entry.n_lines:
            broken = f"{len(program)} lines where the manifest promises {entry.n_lines}"
        if broken is None and (flow_s[0], flow_s[-1]) != (entry.start_s, entry.end_s):
            broken = "its times are not those of the manifest"
        if broken:
            raise self._no_layer(where, broken)
        return layer

    def iterate_layers(self) -> Iterator[JobLayer]:
        """Every layer in order, one in memory at a time."""
        for index in range(len(self.manifest.layers)):
            yield self.read_layer(index)

    def _open(self) -> None:
        name = str(self._path)
        try:
            self.digest = container.verify_digest(self._file, name)
            self._zip = zipfile.ZipFile(self._file)
        except (zipfile.BadZipFile, NotImplementedError, ValueError, OSError) as error:
            raise JobError(f"{name} is not a job file", where=str(error),
                           hint=container.REPLAN_HINT) from None
        manifest = self._member(container.MANIFEST_MEMBER, container.MAX_TEXT_BYTES)
        self.manifest = manifest_from_json(manifest, name)
        expected = [
            n for i in range(len(self.manifest.layers)) for n in container.layer_member_names(i)]
        if self._zip.namelist() != [*expected, container.PART_MEMBER, container.MANIFEST_MEMBER]:
            raise JobError(f"{name} is not a job file lmctl made",
                           where="its members are not those its manifest lists",
                           hint=container.REPLAN_HINT)
        try:
            self.part_text = self._member(container.PART_MEMBER, container.MAX_TEXT_BYTES).decode()
        except UnicodeDecodeError:
            raise JobError(f"{name}: the part file in it is not text",
                           hint=container.REPLAN_HINT) from None
        if part_digest(self.part_text) != self.manifest.part_sha256:
            raise JobError(f"{name}: the part file in it is not the one planned",
                           hint=container.REPLAN_HINT)

    def _member(self, name: str, most_bytes: int) -> bytes:
        """A member's bytes; refuses sizes that are not what lies in the file."""
        try:
            info = self._zip.getinfo(name)
            if (
                info.compress_type != zipfile.ZIP_STORED
                or info.file_size != info.compress_size
                or info.file_size > most_bytes
            ):
                raise JobError(f"{self._path} is not a job file lmctl made",
                               where=f"{name} is compressed or too large",
                               hint=container.REPLAN_HINT)
            return self._zip.read(info)
        except KeyError:
            raise JobError(f"{self._path} is not a job file lmctl made",
                           where=f"it holds no {name}", hint=container.REPLAN_HINT) from None
        except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, ValueError,
                OSError) as error:
            raise JobError(f"{self._path}: {name} cannot be read", where=str(error),
                           hint=container.REPLAN_HINT) from None

    def _no_layer(self, where: str, broken: str) -> JobError:
        return JobError(f"{self._path} holds a layer that cannot be run",
                        where=f"{where}: {broken}", hint=container.REPLAN_HINT)


def _array(data: bytes, dtype: np.dtype[Any], columns: tuple[int, ...]) -> NDArray[Any]:
    """An array of this dtype and shape (n, *columns), n being what the bytes make.

    The header is never parsed, only compared with the one such an array has.
    """
    start = 10 + int.from_bytes(data[8:10], "little")
    row = dtype.itemsize * math.prod(columns)
    shape = (max(0, len(data) - start) // row, *columns)
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False,
                 "shape": shape})
    if data[:start] != header.getvalue() or len(data) - start != row * shape[0]:
        raise ValueError("an array of another type or size than the format's")
    return np.frombuffer(data, dtype, offset=start).reshape(shape)
