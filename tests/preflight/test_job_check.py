"""A job is refused on a machine it was not planned for, and by each limit it breaks."""

from dataclasses import replace

import pytest

from lmctl.errors import JobError
from lmctl.job.schema import JobHopper
from lmctl.preflight.job_check import check_job


def spoilt(profile, **changes):
    data = profile.model_dump()
    for dotted, value in changes.items():
        place, key = data, dotted.split("__")
        for step in key[:-1]:
            place = place[int(step) if step.isdigit() else step]
        place[key[-1]] = value
    return type(profile).model_validate(data)


def refusal(manifest, profile):
    with pytest.raises(JobError) as caught:
        check_job(manifest, profile)
    assert caught.value.hint
    return caught.value.render()


def test_a_job_that_fits(manifest, profile):
    check_job(manifest, profile)


@pytest.mark.parametrize(
    "changes",
    [{"motion__endpoint": "tcp://127.0.0.1:9"}, {"feeder__0__endpoint": "modbus-tcp://127.0.0.1:9"},
     {"hopper__0__dead_time_s": 4.5}, {"hopper__1__lag_s": 0.3}],
)
def test_what_a_run_may_learn_anew_is_no_matter(manifest, profile, changes):
    check_job(manifest, spoilt(profile, **changes))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"name": "other cell"}, "not for 'other cell'"),
        ({"laser__s_max": 255}, "S word of full power: 255, planned with 1000"),
        ({"laser__max_power_W": 2000.0}, "full power in W: 2000"),
        ({"motion__send_horizon_s": 0.5}, "send horizon in s: 0.5"),
        ({"hopper__0__material": "IN625"}, "hopper A holds IN625, not 316L"),
        ({"hopper__1__max_flow_g_min": 20.0}, "at most 20 g/min, not 60"),
        ({"hopper__0__name": "C"}, "there is no hopper A"),
        ({"motion__acceleration_mm_s2": (100, 100, 100)}, "dynamics"),
    ],
)
def test_a_job_planned_for_another_profile(manifest, profile, changes, said):
    text = refusal(manifest, spoilt(profile, **changes))
    assert "planned for 'bench cell'" in text
    assert said in text


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"bounds_mm": ((-1.0, 10, 0.8), (200, 190, 20))}, "x: reaches -1.0 to 200.0 mm"),
        ({"bounds_mm": ((10, 10, 0.8), (200, 301.0, 20))}, "y: reaches 10.0 to 301.0"),
        ({"bounds_mm": ((10, 10, 0.8), (200, 190, 200.5))}, "z: reaches 0.8 to 200.5"),
        ({"totals": {"longest_line_s": 0.3}}, "longest line lasts 0.300 s"),
        ({"totals": {"peak_flow_g_min": {"B": 61.0}}}, "hopper B would deliver 61.0"),
        ({"totals": {"peak_power_W": 3100.0}}, "wants 3100 W"),
        ({"hoppers": (JobHopper("A", "IN625", 3, 1, 60),)}, "no hopper A with IN625"),
    ],
)
def test_a_job_beyond_the_machine(manifest, profile, changes, said):
    assert said in refusal(replace(manifest, **changes), profile)


def test_all_reasons_come_at_once(manifest, profile):
    text = refusal(replace(manifest, bounds_mm=((-1.0, -2.0, 0.8), (9, 9, 9)),
                           totals={"longest_line_s": 9.0}), profile)
    assert "x: reaches" in text
    assert "y: reaches" in text
    assert "longest line" in text
