"""What a part file or a profile may contradict itself in, each told in its own words."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import pytest

from lmctl.config.machine import load_profile
from lmctl.config.part_rules import load_part_file
from lmctl.errors import ConfigError

CELL = (Path(str(files("lmctl.examples"))) / "cell.toml").read_text()
HEAD = 'name = "p"\n[[material]]\nname = "316L"\n[[material]]\nname = "WC-12Co"\n'
BOX = '[[body]]\nkind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [9, 9, 4]\n'
NAMED = BOX.replace("[[body]]\n", '[[body]]\nname = "b"\n')
ONE = '{ "316L" = 1 }'


def profile_of(feature: str, rest: str) -> str:
    return f"[composition]\nfeature = {feature}\n{rest}\n"


AXIS = '{ kind = "axis", point_mm = [0, 0, 0], direction = [0, 0, 1] }'
FLAT = f'profile = {{ kind = "constant", of = {ONE} }}'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('[[body]]\nkind = "cone"\nbase_mm = [0,0,0]\ntop_mm = [0,0,4]\nbase_radius_mm = 0\n'
         "top_radius_mm = 0\n", "base_radius_mm and top_radius_mm are both 0"),
        ('[[body]]\nkind = "torus"\ncentre_mm = [0,0,0]\nradius_mm = 2\ntube_radius_mm = 3\n',
         "tube_radius_mm must be below radius_mm"),
        (BOX + profile_of('{ kind = "segment", start_mm = [1,1,1], end_mm = [1,1,1] }', FLAT),
         "start_mm and end_mm are the same point"),
        (BOX + profile_of('{ kind = "polyline", points_mm = [[1,1,1],[1,1,1]] }', FLAT),
         "points 1 and 2 are the same"),
        (NAMED + profile_of('{ kind = "face", of = "b" }', FLAT), "say which face: either at_mm"),
        (BOX + profile_of(AXIS, 'profile = { kind = "steps", steps = [\n'
                          f'{{ over_mm = [0, 2], of = {ONE} }}, {{ over_mm = [3, 4], of = {ONE} }}'
                          '] }'), "step 2 leaves a gap after step 1: it begins at 3 mm"),
        (BOX + profile_of(AXIS, f'profile = {{ kind = "normalised", near = {ONE}, far = {ONE} }}'),
         "only a surface has a largest depth to be normalised by"),
        (BOX + f"[composition]\n{FLAT}\n[[composition.blend]]\n{FLAT}\nweight = 1\n",
         "is given beside a profile"),
        (BOX + f"[composition]\n[[composition.blend]]\n{FLAT}\nweight = 0\n"
         f"[[composition.blend]]\n{FLAT}\nweight = 0\n", "the weights sum to 0"),
        (BOX + f"[composition]\n[[composition.blend]]\n{FLAT}\nweight = 0.5\n"
         f"[[composition.blend]]\n{FLAT}\nweight = 0.4\n", "the weights sum to 0.9, not to 1"),
        (BOX + '[composition]\nweights = "inverse-distance"\n'
         f"[[composition.blend]]\n{FLAT}\nweight = 0.5\n[[composition.blend]]\n{FLAT}\n",
         "weights go by inverse distance"),
        (BOX + '[composition]\nweights = "inverse-distance"\n[[composition.blend]]\n'
         'feature = { kind = "coordinate", along = "x" }\n'
         f"{FLAT}\n[[composition.blend]]\n{FLAT}\n",
         "a coordinate is no distance to weigh by"),
        (BOX + profile_of('{ kind = "surface", of = "quux" }', FLAT), "there is no body 'quux'"),
        (BOX + '[process]\n[[process.region]]\nstrategy = "hatch"\n', "states neither body nor"),
        (BOX + '[process]\n[[process.region]]\nstrategy = "hatch"\nlayers = [4, 2]\n',
         "layers go from the lower number to the higher"),
        (BOX + '[process]\n[[process.region]]\nstrategy = "hatch"\nbody = "quux"\n',
         "no body is named 'quux'"),
        (NAMED + '[process]\nstrategy = "iso-3d"\n[[process.region]]\nstrategy = "hatch"\n'
         'body = "b"\n', 'beside strategy = "iso-3d" no body can have another'),
        (BOX + '[[support]]\nrigid_motion = true\non = "surface"\n', "rigid_motion stands alone"),
        (BOX + '[optimise]\n[[optimise.forbidden]]\nmaterial = "316L"\nbetween = [0.5, 0.2]\n',
         "between must rise"),
        (BOX + '[optimise]\n[[optimise.limit]]\nquantity = "mass"\nat_least = 2\nat_most = 1\n',
         "at_least 2 is above at_most 1"),
        (BOX + '[optimise]\n[[optimise.limit]]\nquantity = "xx"\nat_least = 2\n',
         "at_least is for fraction, mass and cost"),
        ('[[body]]\nname = "a"\nkind = "shell"\nof = "b"\n[[body]]\nname = "b"\nkind = "shell"\n'
         'of = "a"\n', "runs in a circle"),
        (BOX + '[substrate]\nkind = "plate"\nlayers = "parallel"\n',
         "layers on a plate are level"),
        (BOX + '[substrate]\nkind = "plane"\npoint_mm = [0,0,0]\nnormal = [0,0,-1]\n',
         "normal does not point up"),
        (BOX + f"[composition]\n{FLAT}\n" + NAMED.replace(
            'name = "b"\n', f'composition.profile = {{ kind = "constant", of = {ONE} }}\n'),
         "the part has a composition for all of it"),
    ],
)
def test_a_part_file(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "part.toml").write_text(HEAD + text)
    with pytest.raises(ConfigError) as refused:
        load_part_file(tmp_path / "part.toml")
    assert told in refused.value.render()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('name = "F2"', 'name = "F1"', "two feeders are called 'F1'"),
        ('name = "B"', 'name = "A"', "two hoppers are called 'A'"),
        ('feeder = "F2"', 'feeder = "F1"', "two hoppers are on feeder 'F1' channel 1"),
        ("min_flow_g_min = 0.8", "min_flow_g_min = 61", "min_flow_g_min is not below"),
        ("[scale] ", "[calibration]\nwarn_after_days = 100\n[scale] ",
         "warn_after_days must be at most refuse_after_days, 90"),
        ("watchdog_s = 4", "watchdog_s = 4\ntimeout_s = 2",
         "feeder[1]: timeout_s must be at most a quarter of watchdog_s, 1 s"),
        ("watchdog_s = 4", "watchdog_s = 4\nfunction_codes = [3, 4]",
         "feeder[1].function_codes: a device cannot be driven without 16"),
        ("z = [0, 200]", "z = [200, 0]",
         "motion.travel_mm.z: the first value must be below the second, not [200.0, 0.0]"),
        ("[scale] ", "[safety]\nendpoint = 'modbus-tcp://127.0.0.1:5023'\ntimeout_s = 2\n[scale] ",
         "safety: timeout_s must be at most period_s, 0.1 s"),
        ('name = "F1"', 'name = "F1\\u001b"', "feeder[1].name: holds a control character"),
        ('name = "F1"', 'name = "F1"\nmap = "' + "m" * 300 + '"', "mmm: File name too long"),
    ],
)
def test_a_profile(old: str, new: str, told: str, tmp_path: Path) -> None:
    assert old in CELL
    (tmp_path / "cell.toml").write_text(CELL.replace(old, new, 1))
    with pytest.raises(ConfigError) as refused:
        load_profile(tmp_path / "cell.toml")
    assert told in refused.value.render()
