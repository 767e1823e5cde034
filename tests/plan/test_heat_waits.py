"""Limits of temperature in a plan: waits, least layer times, power by layer, and refusals."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.errors import ConfigError, PlanError
from lmctl.job.schema import LayerHeat, LineKind
from lmctl.plan.execution import stage_workers
from lmctl.plan.heat import heat_findings
from tests.plan.test_part_temperature import block

LIMITED = block(high="12, 8, 4", limit=250)
FREE = LIMITED.replace("interpass_max_C = 250", "")


def bead_starts_s(layers):
    """When the first bead of each layer begins."""
    return [layer.lines["end_s"][np.argmax(layer.lines["kind"] == LineKind.BEAD) - 1]
            for layer in layers]


def path_lengths_mm(layers):
    """Of each path's bead."""
    found = []
    for layer in layers:
        lines = layer.lines
        place = np.column_stack([lines["x_mm"], lines["y_mm"]]).astype(float)
        step = np.concatenate([[0.0], np.hypot(*np.diff(place, axis=0).T)])
        bead = lines["kind"] == LineKind.BEAD
        found += [step[bead & (lines["path"] == path)].sum()
                  for path in np.unique(lines["path"][bead])]
    return found


def test_a_limit_is_kept_by_waits_at_the_purge_position(plan, profile):
    free, free_layers = plan(FREE)
    limited, layers = plan(LIMITED)
    hot, _ = plan(LIMITED.replace("= 250", "= 3000"))
    assert free.heat == ()
    assert max(layer.interpass_C for layer in hot.heat) > 300
    # within a fiftieth of the rise that the limit allows
    assert max(layer.interpass_C for layer in limited.heat) <= 250 + (250 - 20) / 50
    said = limited.totals["predicted_heat"]
    assert said["wait_s"] > 5
    assert said["wait_s"] == pytest.approx(sum(layer.wait_s for layer in limited.heat), abs=0.1)
    longer_s = limited.totals["duration_s"] - free.totals["duration_s"]
    assert said["wait_s"] * 0.99 <= longer_s <= said["wait_s"] + 3 * (1 + said["cuts"])
    # long waits: powder falls on the purge position
    for layer in layers:
        waits = np.flatnonzero((layer.lines["kind"] == LineKind.DWELL)
                               & (np.diff(layer.lines["end_s"], prepend=layer.flow_s[0]) > 0.2))
        for line in waits:
            row = layer.lines[line]
            if limited.heat[layer.index].wait_s > 20:
                assert (row["x_mm"], row["y_mm"], row["z_mm"]) == profile.motion.purge_mm
    # the same bead, however often it is interrupted
    assert limited.totals["path_length_mm"] == pytest.approx(
        free.totals["path_length_mm"], abs=0.05)
    assert limited.totals["deposited_volume_mm3"] == pytest.approx(
        free.totals["deposited_volume_mm3"], rel=1e-4)
    assert sum(layer.lines["power_W"].max() > 0 for layer in free_layers) == len(free_layers)


@pytest.mark.parametrize("seed", range(10))
def test_a_limit_is_kept_whatever_the_shape(plan, seed):
    """Long straight tracks have to be interrupted between their ends, and what a piece of path
    leaves too hot has to cool before the next one."""
    random = np.random.default_rng(seed)
    high = [random.choice(choices) for choices in ((8, 12, 20, 30, 60), (3, 4, 8, 12, 20), (4, 6))]
    limit, strategy = random.choice((150, 200, 250, 400)), random.choice(("offset", "hatch"))
    manifest, layers = plan(block(high=", ".join(map(str, high)), limit=limit,
                                  process=f'strategy = "{strategy}"'))
    assert max(layer.interpass_C for layer in manifest.heat) <= limit + (limit - 20) / 50
    assert manifest.totals["predicted_heat"]["wait_s"] > 0
    # no piece of a path is shorter than two beads, but where the whole path is
    _, free = plan(block(high=", ".join(map(str, high)), process=f'strategy = "{strategy}"'))
    assert min(path_lengths_mm(layers)) >= min(2 * 2.0 - 0.01, *path_lengths_mm(free))


def test_a_limit_that_is_never_reached_changes_no_line(plan):
    _, free = plan(FREE)
    manifest, limited = plan(LIMITED.replace("= 250", "= 3000"))
    assert manifest.totals["predicted_heat"]["wait_s"] == 0
    for one, other in zip(free, limited, strict=True):
        assert one.program == other.program


def test_the_job_is_the_same_whatever_the_number_of_processes(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(stage_workers, "_WORTH_PROCESSES_S", -1.0)
    plan(LIMITED, jobs=1)
    alone = (tmp_path / "part.lmj").read_bytes()
    plan(LIMITED, jobs=2)
    assert (tmp_path / "part.lmj").read_bytes() == alone


def test_layers_take_their_least_time(plan):
    _, layers = plan(FREE.replace("[process]", "[process]\nleast_layer_time_s = 40"))
    assert np.diff(bead_starts_s(layers)) == pytest.approx(40.0, abs=0.05)
    _, layers = plan(FREE.replace("[process]", "[process]\nleast_layer_time_s = 1"))
    _, free = plan(FREE)
    assert bead_starts_s(layers) == bead_starts_s(free)


def test_power_by_layer(plan):
    _, layers = plan(FREE.replace("[process]", """[process]
first_layer_power = 1.2
power_per_layer = 0.9
final_power = 0.85"""))
    power = [layer.lines["power_W"].max() for layer in layers]
    assert power == pytest.approx([960, 800, 720, 680, 680], rel=1e-3)


def test_some_layers_alone_have_no_prediction(plan):
    manifest, _ = plan(LIMITED, layers=(2, 3))
    assert manifest.heat == ()
    assert any("not predicted" in found["text"] for found in manifest.verdict)


def findings(text):
    from lmctl.config.part_rules import parse_part_file

    with pytest.raises(ConfigError) as caught:
        parse_part_file(text, name="part.toml")
    return {found.path: found.reason for found in caught.value.findings}


def test_every_missing_constant_is_named_at_once():
    found = findings(LIMITED.replace('[[material]]\nname = "316L"', """[[material]]
name = "NiCrBSi"
[[material]]
name = "unobtainium"
density_g_cm3 = 5
[composition]
feature = { kind = "axis", point_mm = [0, 0, 0], direction = [0, 0, 1] }
profile = { kind = "constant", of = { "NiCrBSi" = 1 } }""").replace(
        "[substrate]", '[substrate]\nmaterial = "kryptonite"'))
    assert set(found) == {
        "material[1].conductivity_W_m_K", "material[1].heat_capacity_J_kg_K",
        "material[2].conductivity_W_m_K", "material[2].heat_capacity_J_kg_K",
        "material[2].absorptivity", "substrate.material"}
    assert "density_g_cm3" in found["substrate.material"]


def test_a_limit_below_the_plates_temperature_is_refused():
    found = findings(LIMITED.replace("[substrate]", "[substrate]\ntemperature_C = 300"))
    assert set(found) == {"process.interpass_max_C"}
    assert "250 °C is not above the plate's temperature, 300 °C" in found["process.interpass_max_C"]


def test_energy_per_volume_stays_in_its_range():
    found = findings(FREE.replace("[process]", """[process]
first_layer_power = 1.5
power_per_layer = 0.95
final_power = 0.5"""))
    assert list(found) == ["process"]
    assert "first_layer_power = 1.5 and final_power = 0.5" in found["process"]


def test_a_limit_that_no_wait_keeps_is_refused_with_the_place(plan):
    """An insulated plate only grows warmer: it must not wait for ever."""
    insulated = block(high="12, 2, 4", limit=26, plate="contact_W_m2_K = 0\nthickness_mm = 1",
                      process="surface_loss_W_m2_K = 0")
    with pytest.raises(PlanError) as caught:
        plan(insulated)
    said = str(caught.value)
    assert re.search(r"the interpass limit of 26 °C cannot be kept by waiting: in layer \d+, at "
                     r"x 1[45]\d\.\d, y 1[45]\d\.\d, the beam comes back to (2[6-9]|[34]\d) °C",
                     said)
    assert caught.value.where == ("process.interpass_max_C",)
    assert "substrate.contact_W_m2_K" in caught.value.hint


def test_a_limit_exceeded_is_said_with_place_and_what_to_change():
    layers = [LayerHeat(layer=number, interpass_C=reached_C, x_mm=147.5, y_mm=150.7, wait_s=4.0,
                        cuts=0, power_factor=1.0)
              for number, reached_C in enumerate((380.0, 473.0, 455.0))]
    heat = SimpleNamespace(layers=layers, limit_C=400.0, tolerance_K=7.6)
    found = heat_findings(heat, ProcessSettings(interpass_max_C=400), is_excerpt=False)
    assert [one["level"] for one in found] == ["warning"]
    for part in ("400 °C cannot be kept by waiting", "473 °C in layer 2 at x 147.5, y 150.7",
                 "2 layers, the first is layer 2", "power_W", "interpass_max_C to 480"):
        assert part in found[0]["text"]
