"""Fault files: what they may say, and every mistake at once."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.faults.kinds import FAULT_KINDS, Fault, find_mistakes
from simulators.faults.plan import (
    MAX_BYTES,
    MAX_FAULTS,
    AtLevel,
    AtLine,
    AtTime,
    FaultPlan,
    FaultPlanError,
    PlannedFault,
)

GOOD = """
[[fault]]
kind = "disc_stalls"
device = "F1"
channel = 1
noticed = false
at_s = 30
for_s = 5.5

[[fault]]
kind = "door"
at_line = 120

[[fault]]
kind = "bytes_flipped"
device = "F2"
direction = "to_host"
bit = 3
at_level_g = { feeder = "F2", grams = 50 }
"""


def mistakes(text, bench_config):
    with pytest.raises(FaultPlanError) as caught:
        FaultPlan.parse(text, bench_config)
    return caught.value.mistakes


def test_a_plan_is_read(bench_config):
    plan = FaultPlan.parse(GOOD, bench_config)
    assert plan.faults == (
        PlannedFault(Fault.create("disc_stalls", "F1", 1, noticed=False), AtTime(30.0), 5.5),
        PlannedFault(Fault.create("door"), AtLine(120)),
        PlannedFault(Fault.create("bytes_flipped", "F2", direction="to_host", bit=3),
                     AtLevel("F2", 1, 50.0)),
    )


def test_defaults_are_filled_in():
    fault = Fault.create("hose_clogs", "F1")
    assert fault.channel == 1
    assert fault.values == {"share": 0.3, "mbar": 900, "rise_s": 0.0, "noticed": True}
    assert Fault.create("link_closed").device == "motion"
    assert Fault.create("hose_clogs", "F1", 1, share=0.3) == fault
    assert hash(fault)
    assert str(Fault.create("hose_clogs", "F1", share=0.5)) == "hose_clogs of F1/1 (share 0.5)"


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('kind = "disc_stals"\ndevice="F1"\nat_s = 1',
         "fault[1].kind: there is no fault 'disc_stals'; 'disc_stalls'?"),
        ("at_s = 1", "fault[1].kind: is missing"),
        ("kind = 3\nat_s = 1", "fault[1].kind: must be text"),
        ('kind = "door"', "fault[1]: needs one of at_s, at_line, at_level_g"),
        ('kind = "door"\nat_s = 1\nat_line = 2',
         "fault[1]: needs one of at_s, at_line, at_level_g"),
        ('kind = "door"\nat_s = -1', "fault[1].at_s: must be at least 0"),
        ('kind = "door"\nat_s = nan', "fault[1].at_s: must be finite"),
        ('kind = "door"\nat_s = 1e8', "fault[1].at_s: must be at most 1e+07"),
        ('kind = "door"\nat_s = "soon"', "fault[1].at_s: must be a number"),
        ('kind = "door"\nat_line = 1.5',
         "fault[1].at_line: must be a whole number from 0 to 9999999"),
        ('kind = "door"\nat_s = 1\nfor_s = 0', "fault[1].for_s: must be above 0"),
        ('kind = "panel_hold"\nat_s = 1\nfor_s = 2',
         "fault[1].for_s: panel_hold is over as soon as it has happened"),
        ('kind = "door"\nat_s = 1\ncolour = "red"', "fault[1].colour: door has no such parameter"),
        ('kind = "door"\ndevice = "F1"\nat_s = 1', "fault[1].device: door strikes the whole cell"),
        ('kind = "door"\nchannel = 2\nat_s = 1', "fault[1].channel: door strikes the whole cell"),
        ('kind = "disc_stalls"\nat_s = 1',
         "fault[1].device: is missing: the name of a hopper of a feeder"),
        ('kind = "disc_stalls"\ndevice = "F9"\nat_s = 1',
         "fault[1].device: there is no 'F9' for it in the bench; it has F1, F2"),
        ('kind = "disc_stalls"\ndevice = "F1"\nchannel = 4\nat_s = 1',
         "fault[1].channel: feeder 'F1' has no hopper 4"),
        ('kind = "disc_stalls"\ndevice = "F1"\nchannel = 5\nat_s = 1',
         "fault[1].channel: must be a whole number from 1 to 4"),
        ('kind = "disc_stalls"\ndevice = "F1"\nnoticed = 1\nat_s = 1',
         "fault[1].noticed: must be true or false"),
        ('kind = "hopper_level"\ndevice = "F1"\nat_s = 1',
         "fault[1].grams: is missing: powder left"),
        ('kind = "bytes_lost"\ncount = 0\nat_s = 1', "fault[1].count: must be from 1 to 1e+06"),
        ('kind = "bytes_lost"\ncount = 1.0\nat_s = 1', "fault[1].count: must be a whole number"),
        ('kind = "bytes_lost"\ndirection = "up"\nat_s = 1',
         "fault[1].direction: must be 'to_device' or 'to_host'"),
        ('kind = "bytes_lost"\ndirection = ["to_host"]\nat_s = 1',
         "fault[1].direction: must be 'to_device' or 'to_host'"),
        ('kind = "bytes_lost"\ndevice = "F9"\nat_s = 1',
         "fault[1].device: there is no 'F9' for it in the bench; it has motion, safety, F1, F2"),
        ('kind = "replies_slow"\ndevice = "motion"\nat_s = 1',
         "fault[1].device: there is no 'motion' for it in the bench; it has safety, F1, F2"),
        ('kind = "replies_slow"\ndevice = "F1"\nlate_s = inf\nat_s = 1',
         "fault[1].late_s: must be from 0.001 to 60"),
        ('kind = "door"\nat_level_g = 5', "fault[1].at_level_g: must be a table"),
        ('kind = "door"\nat_level_g = { feeder = "F1", channel = 2, grams = 5 }',
         "fault[1].at_level_g.channel: feeder 'F1' has no hopper 2"),
        ('kind = "door"\nat_level_g = { feeder = "F9", grams = 5 }',
         "fault[1].at_level_g.feeder: there is no 'F9' for it in the bench; it has F1, F2"),
        ('kind = "door"\nat_level_g = { feeder = "F1", grams = 5, kg = 1 }',
         "fault[1].at_level_g.kg: there is no such key"),
    ],
)
def test_a_mistake_is_named_with_its_key(table, said, bench_config):
    assert said in mistakes(f"[[fault]]\n{table}\n", bench_config)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "there is no [[fault]] in it"),
        ("[[fault]", "not valid TOML"),
        ("fault = 3", "fault: must be an array of tables"),
        ("[fault]\nkind = 'door'", "fault: must be an array of tables"),
        (GOOD + "\n[extra]\n", "extra: there is no such key"),
        ("[[fault]]\nkind='door'\nat_s=1\n" * (MAX_FAULTS + 1), "at most 1000 faults"),
        ("a=" + "[" * 5000, "not valid TOML"),
    ],
)
def test_files_that_are_no_plan(text, said, bench_config):
    assert said in "\n".join(mistakes(text, bench_config))


def test_all_mistakes_come_at_once(bench_config):
    text = GOOD.replace("at_s = 30", "at_s = -30").replace("bit = 3", "bit = 30").replace(
        '"door"', '"dor"')
    assert len(mistakes(text, bench_config)) == 3


def test_a_bench_without_safety_device_has_none_of_its_faults(bench_config):
    (said,) = mistakes('[[fault]]\nkind = "oxygen_high"\nat_s = 1\n',
                       replace(bench_config, safety=None))
    assert said == "fault[1].kind: the bench has no safety device for oxygen_high"


def test_loading_from_files(tmp_path, bench_config):
    path = tmp_path / "faults.toml"
    path.write_text(GOOD, encoding="utf-8")
    assert FaultPlan.load(path, bench_config) == FaultPlan.parse(GOOD, bench_config)
    for data, said in ((b"\xff\xfe", "UTF-8"), (b"#" * (MAX_BYTES + 1), "larger than")):
        path.write_bytes(data)
        with pytest.raises(FaultPlanError, match=said):
            FaultPlan.load(path, bench_config)
    with pytest.raises(OSError, match="No such file"):
        FaultPlan.load(tmp_path / "nothing", bench_config)


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)


@given(
    kind=st.sampled_from(sorted(FAULT_KINDS)) | st.text(max_size=8),
    device=st.sampled_from(["", "F1", "motion", "?"]),
    channel=st.integers(-1, 9),
    values=st.dictionaries(st.sampled_from(sorted(
        {p.name for kind in FAULT_KINDS.values() for p in kind.parameters})), scalars, max_size=3),
)
def test_a_fault_is_made_whole_or_refused_in_words(kind, device, channel, values):
    mistakes = find_mistakes(kind, device, channel, values)
    assert all(": " in one for one in mistakes)
    if not mistakes:
        fault = Fault.create(kind, device, channel, **values)
        assert set(fault.values) == {p.name for p in fault.kind.parameters}
