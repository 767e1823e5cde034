"""Write a job a layer at a time, in constant memory; the file appears complete or not at all."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import zipfile
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import JobError
from lmctl.job import container
from lmctl.job.manifest_json import manifest_to_json, part_digest
from lmctl.job.packed_layer import PackedLayer, pack_layer
from lmctl.job.schema import JobLayer, JobManifest, LayerEntry


class JobWriter:
    """Writes one job file. Use as a context manager; `finish` makes the file appear.

    The bytes go to a hidden file in the same folder, which takes the job's name only after they
    are durable. On any exception, KeyboardInterrupt included, the hidden file is removed, and an
    earlier file of the job's name stays unchanged.

    Raises JobError where the file cannot be written, ValueError where a layer breaks a rule of
    the format (a planner's mistake, not a user's).
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        self._entries: list[LayerEntry] = []
        self._last_flow: NDArray[np.float64] | None = None
        self._finished = False

    def __enter__(self) -> Self:
        if self._path.is_dir():
            raise JobError(f"{self._path} is a folder, not a file name",
                           hint="name a file in it with -o")
        try:
            self._file = self._temporary.open("xb+")
            self._zip = zipfile.ZipFile(self._file, "w", zipfile.ZIP_STORED)
        except OSError as error:
            raise self._cannot_write(error) from None
        except BaseException:  # an interrupt may come as soon as the file is there
            self._discard()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if not self._finished:
            self._discard()
            if error is None:
                raise ValueError("the job was not finished")

    def add_layer(self, layer: JobLayer) -> LayerEntry:
        """Append the next layer. Its index, first line and first time go on from the last."""
        return self.add_packed_layer(pack_layer(layer, self._next_path()))

    def add_packed_layer(self, layer: PackedLayer) -> LayerEntry:
        """Append the next layer, packed already."""
        self._check(layer)
        names = container.layer_member_names(layer.entry.index)
        self._write(dict(zip(names, layer.members, strict=True)))
        self._entries.append(layer.entry)
        self._last_flow = layer.last_flow_g_s
        return layer.entry

    def finish(self, manifest: JobManifest, part_text: str) -> JobManifest:
        """Complete the file and give it its name; returns the manifest with its layer table."""
        if not self._entries:
            raise ValueError("a job needs at least one layer")
        if manifest.part_sha256 != part_digest(part_text):
            raise ValueError("part_sha256 is not that of the part's text")
        manifest = dataclasses.replace(manifest, layers=tuple(self._entries))
        self._write({container.PART_MEMBER: part_text.encode(),
                     container.MANIFEST_MEMBER: manifest_to_json(manifest)})
        try:
            self._zip.comment = container.unsigned_trailer()
            self._zip.close()
            container.write_digest(self._file)
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self._temporary.replace(self._path)
            _sync_folder(self._path.parent)
        except OSError as error:
            raise self._cannot_write(error) from None
        self._finished = True
        return manifest

    def _check(self, layer: PackedLayer) -> None:
        entry = layer.entry
        if len(self._entries) == container.MAX_LAYERS:
            raise JobError(f"the job has more than {container.MAX_LAYERS:,} layers",
                           hint="raise process.layer_height_mm or split the part")
        if entry.index != len(self._entries):
            raise ValueError(f"layer {entry.index} given where {len(self._entries)} is next")
        if entry.first_path != self._next_path():
            raise ValueError(
                f"layer {entry.index}: paths are not numbered on from {self._next_path()}")
        if not self._entries:
            return
        last = self._entries[-1]
        if entry.first_line != last.first_line + last.n_lines:
            raise ValueError(f"layer {entry.index}: lines are not numbered on")
        if entry.start_s != last.end_s or not np.array_equal(
            layer.first_flow_g_s, np.asarray(self._last_flow)
        ):
            raise ValueError(f"layer {entry.index}: powder flow does not go on from the last")

    def _next_path(self) -> int:
        last = self._entries[-1] if self._entries else None
        return last.first_path + last.n_paths if last else 0

    def _write(self, members: dict[str, bytes]) -> None:
        try:
            for name, data in members.items():
                self._zip.writestr(container.new_member(name), data)
        except OSError as error:
            raise self._cannot_write(error) from None

    def _discard(self) -> None:
        with contextlib.suppress(OSError, ValueError, AttributeError):
            self._zip.close()  # else it would try when it is collected
        with contextlib.suppress(OSError, AttributeError):
            self._file.close()
        self._temporary.unlink(missing_ok=True)

    def _cannot_write(self, error: OSError) -> JobError:
        return JobError.cannot_write(self._path, error)


def _sync_folder(folder: Path) -> None:
    """Make the new name durable, where the system can do that."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
