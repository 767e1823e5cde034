"""A job comes back as it was written, appears whole or not at all, and never grows in memory."""

import dataclasses
import os
import resource
import tracemalloc

import numpy as np
import pytest

from lmctl.errors import JobError
from lmctl.job.packed_layer import pack_layer
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.job.writer import JobWriter


def test_everything_comes_back(job_path, layer, part_text):
    with JobReader(job_path) as job:
        assert job.part_text == part_text
        assert len(job.digest) == 64
        assert [entry.n_lines for entry in job.manifest.layers] == [6, 6, 6]
        assert [(e.first_path, e.n_paths) for e in job.manifest.layers] == [(0, 1), (1, 1), (2, 1)]
        assert [(e.start_s, e.end_s) for e in job.manifest.layers] == [(0, 10), (10, 20), (20, 30)]
        for index, got in enumerate(job.iterate_layers()):
            want = layer(index)
            assert got.program == want.program
            assert (got.index, got.z_mm, got.first_line) == (index, want.z_mm, want.first_line)
            for name in ("lines", "flow_s", "flow_g_s"):
                np.testing.assert_array_equal(getattr(got, name), getattr(want, name))


def test_finish_returns_the_manifest_that_is_read(tmp_path, write):
    written = write(tmp_path / "a.lmj")
    with JobReader(tmp_path / "a.lmj") as job:
        assert job.manifest == written


def test_equal_jobs_are_equal_bytes(tmp_path, write):
    write(tmp_path / "a.lmj")
    write(tmp_path / "b.lmj")
    assert (tmp_path / "a.lmj").read_bytes() == (tmp_path / "b.lmj").read_bytes()


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, MemoryError])
def test_an_interrupted_job_leaves_nothing_and_spares_the_old_one(tmp_path, layer, write, error):
    path = tmp_path / "a.lmj"
    write(path)
    before = path.read_bytes()
    def interrupted():
        with JobWriter(path) as job:
            job.add_layer(layer(0))
            raise error

    with pytest.raises(error):
        interrupted()
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["a.lmj"]


def test_a_folder_that_is_not_there(tmp_path, write):
    with pytest.raises(JobError, match="cannot write"):
        write(tmp_path / "no" / "a.lmj")


def test_a_folder_in_the_jobs_place(tmp_path, write):
    with pytest.raises(JobError, match="is a folder"):
        write(tmp_path)


def test_a_disk_without_room(tmp_path, write):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (3000, before[1]))
    try:
        with pytest.raises(JobError, match="cannot write") as caught:
            write(tmp_path / "a.lmj")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "too large" in caught.value.where[0]
    assert os.listdir(tmp_path) == []


def _with(layer, **columns):
    lines = layer.lines.copy()
    for name, value in columns.items():
        lines[name][-1] = value
    return dataclasses.replace(layer, lines=lines)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda a: dataclasses.replace(a, index=1), "next"),
        (lambda a: dataclasses.replace(a, program=a.program[:-1]), "line table"),
        (lambda a: dataclasses.replace(a, program=(*a.program[:-1], "N5 $H")), "something else"),
        (lambda a: dataclasses.replace(a, program=(*a.program[:-1], "N5 G1 X1!")), "something"),
        (lambda a: dataclasses.replace(a, program=(*a.program[:-1], "N5 G1 X1\nN6 G1")), "table"),
        (lambda a: dataclasses.replace(a, program=(*a.program[:-1], "N6 G1 X1")), "own number"),
        (lambda a: dataclasses.replace(a, program=(*a.program[:-1], "N5 G1 X" + "1" * 70)), "long"),
        (lambda a: dataclasses.replace(a, flow_s=a.flow_s[[0, 2, 1]]), "do not rise"),
        (lambda a: dataclasses.replace(a, flow_s=a.flow_s[:1]), "two flow knots"),
        (lambda a: dataclasses.replace(a, flow_g_s=a.flow_g_s[:2]), "flow table"),
        (lambda a: dataclasses.replace(a, flow_g_s=-a.flow_g_s), "negative"),
        (lambda a: dataclasses.replace(a, flow_s=np.add(a.flow_s, [0, 0, 1])), "end together"),
        (lambda a: _with(a, x_mm=np.nan), "not a number"),
        (lambda a: _with(a, end_s=1.0), "backwards"),
        (lambda a: _with(a, kind=17), "no known kind"),
        (lambda a: _with(a, kind=LineKind.LEAD), "no bead"),
        (lambda a: _with(a, fractions=(0.5, 0.6)), "sum to 1"),
        (lambda a: _with(a, fractions=(1.5, -0.5)), "negative"),
        (lambda a: _with(a, path=7), "numbered"),
    ],
)
def test_a_layer_that_breaks_a_rule_is_a_planners_mistake(tmp_path, layer, spoil, reason):
    with pytest.raises(ValueError, match=reason), JobWriter(tmp_path / "a.lmj") as job:
        job.add_layer(spoil(layer(0)))
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda a: dataclasses.replace(a, flow_s=np.add(a.flow_s, [1, 0, 0])), "go on|backwards"),
        (lambda a: dataclasses.replace(a, flow_g_s=a.flow_g_s * 2), "go on"),
    ],
)
def test_layers_join_in_time_and_flow(tmp_path, layer, manifest, part_text, spoil, reason):
    with JobWriter(tmp_path / "a.lmj") as job:
        job.add_layer(layer(0))
        with pytest.raises(ValueError, match=reason):
            job.add_layer(spoil(layer(1)))
        job.add_layer(layer(1))
        job.finish(manifest(), part_text)


@pytest.mark.parametrize(
    ("first_path", "first_line", "reason"),
    [(7, 6, "paths are not numbered on from 1"), (1, 12, "lines are not numbered on")],
)
def test_packed_layers_join_in_paths_and_lines(
    tmp_path, layer, manifest, part_text, first_path, first_line, reason
):
    one = layer(1)
    paths = np.where(one.lines["path"] < 0, -1, first_path)
    lines = one.lines.copy()
    lines["path"] = paths
    program = tuple(f"N{first_line + at} G1 X{at}.000 Y0.000 F600 S0" for at in range(6))
    packed = pack_layer(dataclasses.replace(
        one, lines=lines, program=program, first_line=first_line), first_path)
    with JobWriter(tmp_path / "a.lmj") as job:
        job.add_layer(layer(0))
        with pytest.raises(ValueError, match=reason):
            job.add_packed_layer(packed)
        job.add_layer(layer(1))
        job.finish(manifest(), part_text)


def test_what_a_planner_must_not_forget(tmp_path, layer, manifest, part_text):
    path = tmp_path / "a.lmj"
    with pytest.raises(ValueError, match="was not finished"), JobWriter(path) as job:
        job.add_layer(layer(0))
    with pytest.raises(ValueError, match="at least one layer"), JobWriter(path) as job:
        job.finish(manifest(), part_text)
    with JobWriter(path) as job:
        job.add_layer(layer(0))
        with pytest.raises(ValueError, match="part_sha256"):
            job.finish(manifest(), part_text + "#")
        job.finish(manifest(), part_text)
    assert os.listdir(tmp_path) == ["a.lmj"]


@pytest.mark.parametrize(
    ("limit", "most", "what", "hint"),
    [("MAX_LAYERS", 1, "more than 1 layers", "layer_height_mm"),
     ("MAX_MEMBER_BYTES", 300, "layer 0 is too large for a job file", "wider bead")],
)
def test_a_job_larger_than_any_machine_reads(
    tmp_path, write, monkeypatch, limit, most, what, hint
):
    monkeypatch.setattr(f"lmctl.job.container.{limit}", most)
    with pytest.raises(JobError, match=what) as refused:
        write(tmp_path / "a.lmj")
    assert hint in refused.value.hint
    assert os.listdir(tmp_path) == []


def test_a_long_job_takes_no_more_memory_than_a_short_one(tmp_path, manifest, layer, part_text):
    def peak(n_layers):
        tracemalloc.start()
        with JobWriter(tmp_path / "a.lmj") as job:
            for index in range(n_layers):
                job.add_layer(layer(index, 500))
            job.finish(manifest(), part_text)
        with JobReader(tmp_path / "a.lmj") as job:
            for _ in job.iterate_layers():
                pass
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(2)  # what is loaded at first use is no job's memory
    assert peak(144) < 1.3 * peak(72)  # both are longer than what is digested at a time


def test_an_interrupt_while_the_file_is_opened_leaves_nothing(tmp_path, monkeypatch):
    """Ctrl-C may come between any two steps, so after the hidden file has been made, too."""
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("lmctl.job.writer.zipfile.ZipFile", interrupted)
    with pytest.raises(KeyboardInterrupt), JobWriter(tmp_path / "part.lmj"):
        pass
    assert list(tmp_path.iterdir()) == []
