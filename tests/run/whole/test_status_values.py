"""What the status of a run tells of its cell: values with origin and age, interlocks, re-entry."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.config.machine import load_profile
from lmctl.run.interlocks.rules import INTERLOCK_RULES
from tests.run.whole.conftest import EXAMPLES


@pytest.fixture
def looked(run, square_job):
    """Snapshots while it deposits, while it is held, and after it goes on."""
    shown = []

    def look(one):
        shown.append(one.executor.snapshot())

    ran = run(square_job, acts=[
        (1.0, look), (1.1, lambda one: one.executor.hold()), (3.0, look), (3.1, look),
        (3.2, lambda one: one.executor.resume())])
    return ran, shown


def test_values_are_those_of_the_last_report_with_its_age_and_origin(looked):
    ran, (depositing, *_) = looked
    samples = ran.records("samples")
    at_s = np.concatenate([record["at"] for record in samples])
    power = np.concatenate([record["s_word"] for record in samples]) * 3000.0 / 1000
    last = int(np.flatnonzero(at_s <= depositing["now_s"])[-1])
    assert depositing["power_W"] == pytest.approx(power[last])
    origin = depositing["origins"]["power_W"]
    assert origin["kind"] == "reported"
    assert origin["age_s"] == pytest.approx(depositing["now_s"] - at_s[last], abs=0.002)
    assert 0.0 <= origin["age_s"] < 0.4
    assert depositing["origins"]["set_g_min"] == {
        "kind": "commanded", "source": "set-points sent to the feeders", "age_s": None}
    assert depositing["carrier_L_min"] == [pytest.approx(4.0, abs=0.5)] * 2
    assert depositing["line"] < depositing["sent_line"] <= depositing["lines"]


def test_the_board_has_every_rule_and_says_which_the_cell_has_no_device_for(looked):
    _, (depositing, *_) = looked
    rows = {row["name"]: row["state"] for row in depositing["interlocks"]}
    assert list(rows) == [rule.name for rule in INTERLOCK_RULES]
    for rule in INTERLOCK_RULES:
        assert rows[rule.name] == ("not fitted" if rule.needs_safety_device else "ok")


def test_a_held_run_shows_where_it_would_go_on_and_then_does(looked):
    ran, (depositing, held, again) = looked
    assert depositing["reentry"] is None
    assert held["sent_line"] == held["line"]
    preview = held["reentry"]
    assert again["reentry"] == preview
    entry, = ran.records("entry")
    assert preview["layer"] == entry["layer"] + 1
    assert preview["beam_on_line"] == entry["beam_on_line"]
    assert preview["repeated_mm"] == entry["repeated_mm"]
    assert preview["run_up_mm"] >= 2.0 - 0.01
    approach = np.array(preview["approach_mm"])
    assert approach[-1, 2] < approach[:, 2].max()
    ran.check_safe()


def test_the_board_shows_an_open_door_and_what_to_do(run, tmp_path, job_file):
    safe, shown = load_profile(EXAMPLES / "cell-safe.toml"), []
    job_file(tmp_path / "job.lmj", safe)
    bench = (EXAMPLES / "bench-safe.toml").read_text()
    ran = run(tmp_path / "job.lmj", profile=safe,
              bench=[((EXAMPLES / "bench.toml").read_text(), bench)],
              acts=[(1.0, lambda one: one.bench.safety.set_door_open()),
                    (1.5, lambda one: shown.append(one.executor.snapshot())),
                    (1.6, lambda one: one.bench.safety.set_door_open(False)),
                    (3.0, lambda one: shown.append(one.executor.snapshot())),
                    (3.1, lambda one: one.executor.stop())])
    opened, closed = ({row["name"]: row for row in one["interlocks"]} for one in shown)
    assert opened["door"]["state"] == "tripped"
    assert "close it" in opened["door"]["hint"]
    assert closed["door"]["state"] == "ok"
    assert opened["chiller"]["state"] == "ok"
    assert shown[0]["shield_gas_L_min"] == pytest.approx(15.0, abs=1.0)
    ran.check_safe()
