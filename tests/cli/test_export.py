"""`lmctl export`: other controllers get the same motion, beam and powder as the planned machine."""

from __future__ import annotations

import csv
import io
import re
import shutil
from dataclasses import dataclass, field

import numpy as np
import pytest

from lmctl.exchange.dialect import SHIPPED, load_dialect, parse_dialect
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind

WORD = re.compile(r"([A-Z])(-?[0-9.]+)")


@pytest.fixture(autouse=True)
def copied(recovered_part, tmp_path):
    shutil.copytree(recovered_part, tmp_path, dirs_exist_ok=True)


@pytest.fixture
def job(tmp_path):
    with JobReader(tmp_path / "part.lmj") as reader:
        yield reader


@dataclass
class Controller:
    """What a LinuxCNC does with a program, as far as these programs go: modal words, outputs.

    moves : target, feed [mm/min], beam, power and hopper set-points of each move
    """

    moves: list = field(default_factory=list)
    waits: list = field(default_factory=list)
    outputs: dict = field(default_factory=dict)
    bits: dict = field(default_factory=dict)
    log: list = field(default_factory=list)

    def run(self, text):
        at, feed, ended = dict.fromkeys("XYZ", 0.0), 0.0, False
        for line in text.splitlines():
            if line == "%" or line.startswith("("):
                assert "(" not in line[1:]
                assert line == "%" or line.endswith(")")
                continue
            assert not ended
            words = WORD.findall(line)
            values = dict(words)
            code = words[0][0] + words[0][1]
            if code == "G1":
                at |= {axis: float(values[axis]) for axis in "XYZ" if axis in values}
                feed = float(values.get("F", feed))
                self.moves.append((tuple(at.values()), feed, self.bits.get(0, False),
                                   dict(self.outputs)))
                self.log.append(("move", len(self.moves) - 1))
            elif code == "G4":
                self.waits.append(float(values["P"]))
                self.log.append(("wait", self.waits[-1], dict(self.outputs)))
            elif code in ("M67", "M68"):
                self.outputs[int(values["E"])] = float(values["Q"])
            elif code in ("M62", "M63", "M64", "M65"):
                self.bits[int(values["P"])] = code in ("M62", "M64")
                self.log.append((code, int(values["P"])))
            elif code == "M2":
                ended = True
            else:
                assert code in ("G21", "G64"), line
        assert ended
        return self


def exported(tmp_path, lmctl, form, *options):
    done = lmctl("export", "part.lmj", "--to", form, "-o", "out.txt", *options)
    assert done.code == 0, done.talk
    return (tmp_path / "out.txt").read_text("utf-8")


def test_motion_and_beam_are_those_of_the_plan(tmp_path, lmctl, job):
    ran = Controller().run(exported(tmp_path, lmctl, "linuxcnc"))
    lines = np.concatenate([layer.lines for layer in job.iterate_layers()])
    moving = lines[~np.isin(lines["kind"], [LineKind.SETUP, LineKind.DWELL])]
    assert len(ran.moves) == len(moving)
    places = np.array([place for place, *_ in ran.moves])
    planned = np.column_stack([moving[axis] for axis in ("x_mm", "y_mm", "z_mm")])
    assert np.abs(places - planned).max() < 0.0006
    assert places[-1] == pytest.approx(planned[-1], abs=0.0006)
    assert [feed for _, feed, *_ in ran.moves] == pytest.approx(60 * moving["speed_mm_s"], abs=0.06)
    beads = moving["kind"] == LineKind.BEAD
    assert [beam for _, _, beam, _ in ran.moves] == beads.tolist()
    power = np.array([outputs.get(0, 0.0) for *_, outputs in ran.moves])
    assert power[beads] == pytest.approx(moving["power_W"][beads], abs=0.6)
    assert ran.bits == {0: False, 1: False, 2: False}
    assert {ran.outputs[hopper] for hopper in (1, 2)} == {0.0}


def test_powder_at_the_nozzle_is_what_the_plan_wants(tmp_path, lmctl, job):
    """Through each hopper's dead time and lag, in steps of 5 ms."""
    ran = Controller().run(exported(tmp_path, lmctl, "linuxcnc"))
    layers = list(job.iterate_layers())
    rows = np.concatenate([layer.lines for layer in layers])
    rows = rows[rows["kind"] != LineKind.SETUP]
    lead_s = max(hopper.dead_time_s for hopper in job.manifest.hoppers)
    # Set-points against program time: moves take what the plan gives them, waits what they say.
    times, orders, s = [-1e3], [None], -lead_s
    first_move = next(at for at, entry in enumerate(ran.log) if entry[0] == "move")
    before = [entry for entry in ran.log[:first_move] if entry[0] == "wait"]
    orders[0] = before[1][2]  # behind the wait for gas comes that for powder
    for _, lasting_s, outputs in before[2:]:
        times.append(s)
        orders.append(outputs)
        s += lasting_s
    assert s >= -1e-9
    begins = np.append(0.0, rows["end_s"][:-1])
    moving = rows["kind"] != LineKind.DWELL
    for (*_, outputs), begin_s in zip(ran.moves, begins[moving], strict=True):
        times.append(begin_s)
        orders.append(outputs)
    flow_s = np.concatenate([layer.flow_s for layer in layers])
    grid = np.arange(0.0, rows["end_s"][-1], 0.005)
    for at, hopper in enumerate(job.manifest.hoppers):
        held = np.array([one.get(at + 1, 0.0) for one in orders])
        wanted = 60.0 * np.concatenate([layer.flow_g_s[:, at] for layer in layers])
        flow = np.empty(len(grid))
        now = wanted[0]
        fed = held[np.searchsorted(times, grid - hopper.dead_time_s, side="right") - 1]
        for i, rate in enumerate(fed):
            now += (rate - now) * (1.0 - np.exp(-0.005 / hopper.lag_s))
            flow[i] = now
        goal = np.interp(grid, flow_s, wanted)
        beam = np.zeros(len(grid), dtype=bool)
        for begin_s, row in zip(begins, rows, strict=True):
            if row["kind"] == LineKind.BEAD:
                beam |= (grid >= begin_s) & (grid < row["end_s"])
        error = np.abs(flow - goal)[beam]
        assert np.percentile(error, 95) < 0.03 * goal.max()
        assert error.max() < 0.08 * goal.max()


def test_gas_stays_on_around_powder(tmp_path, lmctl):
    ran = Controller().run(exported(tmp_path, lmctl, "linuxcnc"))
    order = [entry for entry in ran.log if entry[0] in ("M64", "M65")]
    assert order == [("M64", 1), ("M64", 2), ("M65", 2), ("M65", 1)]
    last = ran.log.index(("M65", 2))
    assert [entry[0] for entry in ran.log[last:]] == ["M65", "wait", "M65"]


@pytest.mark.parametrize("form", SHIPPED)
def test_every_form_moves_alike_and_a_name_cannot_end_a_comment(tmp_path, lmctl, form):
    (tmp_path / "part.toml").write_text(
        (tmp_path / "part.toml").read_text().replace("block <b>&</b>", "a) M64 P0 ;% ü"))
    assert lmctl("plan", "part.toml", "-o", "part.lmj").code == 0
    text = exported(tmp_path, lmctl, form)
    assert text.isascii()
    assert sum(line.startswith("G1 ") for line in text.splitlines()) == sum(
        line.startswith("G1 ") for line in exported(tmp_path, lmctl, "plain").splitlines())
    named = [line for line in text.splitlines() if "M64 P0" in line]
    comment = load_dialect(form).comment.partition("{")[0]
    assert len(named) == 1
    assert named[0].startswith(comment)
    assert ")" not in named[0][:-1]


def test_a_dialect_of_ones_own(tmp_path, lmctl):
    text = (tmp_path / "mine.toml")
    text.write_text("".join([
        'description = "mine"\nextension = ".nc"\ncomment = "; {text}"\nhead = ["START {job}"]\n',
        'tail = ["END"]\ndwell = "WAIT {seconds:.2f}"\nmotion = "LIN"\nx = "X={mm:.2f}"\n',
        'y = "Y={mm:.2f}"\nz = "Z={mm:.2f}"\nfeed = "V={mm_min:.0f}"\n',
        'beam_power = "P={share:.3f}"\nbeam_on = "ON"\nbeam_off = "OFF"\n',
        'flow = "FEED {hopper} {g_min:.1f}"\n']))
    done = lmctl("export", "part.lmj", "--to", "mine.toml")
    assert done.code == 0, done.talk
    lines = (tmp_path / "part.nc").read_text().splitlines()
    assert re.fullmatch("START [0-9a-f]{64}", lines[0])
    assert lines[-1] == "END"
    assert any(re.fullmatch(r"LIN X=[0-9.]+ Y=[0-9.]+( V=\d+)?", line) for line in lines)
    assert lines.count("ON") == lines.count("OFF") > 0


def test_all_mistakes_of_a_dialect_are_reported_at_once(refused, tmp_path):
    good = {name: value for name, value in load_dialect("plain").model_dump().items() if value}
    bad = good | {"x": "X{inch}", "dwell": "G4 P{seconds:q}", "beam_on": "M3 {W",
                  "head": ["{secret}"]}
    (tmp_path / "bad.toml").write_text("\n".join(
        f"{key} = {list(value) if isinstance(value, tuple) else value!r}"
        for key, value in bad.items()))
    told = refused("export", "part.lmj", "--to", "bad.toml", code=3, hint=False)
    assert "4 mistakes" in told
    for words in ("{inch}", "{seconds:q}", "{W", "{secret}"):
        assert words in told
    assert parse_dialect("\n".join(
        f"{key} = {list(value) if isinstance(value, tuple) else value!r}"
        for key, value in good.items()), name="good.toml").motion == "G1"


def test_layers_as_csv_add_up_to_the_plan(tmp_path, lmctl, job):
    rows = list(csv.DictReader(io.StringIO(exported(tmp_path, lmctl, "csv"))))
    totals = job.manifest.totals
    assert [row["layer"] for row in rows] == ["1", "2"]
    for name, total in (("path_mm", totals["path_length_mm"]), ("beam_s", totals["laser_on_s"]),
                        ("duration_s", totals["duration_s"])):
        assert sum(float(row[name]) for row in rows) == pytest.approx(total, rel=1e-3)
    for hopper in job.manifest.hoppers:
        assert sum(float(row[f"powder_{hopper.name}_g"]) for row in rows) == pytest.approx(
            totals["powder_g"][hopper.material], rel=1e-3)
    assert float(rows[0]["designed_316L_fraction"]) == pytest.approx(
        job.manifest.mixtures[0].designed[0])


@pytest.mark.parametrize(("arguments", "told"), [
    (["part.lmj", "--to", "fanuc"], "there is no form 'fanuc'"),
    (["part.lmj", "--to", "plain", "-o", "no/where"], "there is no folder no"),
    (["none.lmj", "--to", "plain"], "none.lmj"),
])
def test_what_cannot_be_exported_is_refused(refused, arguments, told):
    assert told in refused("export", *arguments, code=2, hint=False)


def test_a_job_of_some_layers_is_refused(lmctl, refused):
    assert lmctl("plan", "part.toml", "--layers", "1-1", "-o", "some.lmj").code == 0
    assert "some layers only" in refused("export", "some.lmj", "--to", "plain", code=2)
