"""Mistakes between the keys of a part file: each is told at its key, and what helps.

Many files here hold several mistakes: they come all at once.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from lmctl.config.bodies import MAX_BODIES
from lmctl.config.part_rules import load_part_file, parse_part_file
from lmctl.errors import ConfigError
from tests.part_files import block_file

BLOCK = block_file((9, 9, 4))
FLAT = 'profile = { kind = "constant", of = { "316L" = 1 } }\n'
GRADED = block_file((9, 9, 4), FLAT)
THIRD = '[[material]]\nname = "IN625"\n'
FACE = ('[[face]]\nname = "{name}"\nfeature = {{ kind = "plane", point_mm = [0, 0, 0], '
        "normal = [0, 0, 1] }}\n")
SCAN = '[substrate]\nkind = "scan"\nfile = "plate.xyz"\n'


def findings(text: str) -> dict[str, list[str]]:
    """The reasons that are given at each key."""
    with pytest.raises(ConfigError) as refused:
        parse_part_file(text, name="part.toml")
    assert "part.toml has" in refused.value.what
    found: dict[str, list[str]] = {}
    for one in refused.value.findings:
        found.setdefault(one.path, []).append(one.reason)
    return found


def assert_told(text: str, told: dict[str, tuple[str, ...]]) -> None:
    """Each key has a reason that states all the facts."""
    found = findings(text)
    for path, facts in told.items():
        reasons = found.get(path, [])
        assert any(all(fact in reason for fact in facts) for reason in reasons), (path, found)


def rule(keys: str, powders: str = '["316L", "WC-12Co"]') -> str:
    return f'[[alloy_rule]]\nname = "r"\nreason = "cracks"\npowders = {powders}\n{keys}\n'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (block_file((9, 9, 4), FLAT).replace("[[body]]", "".join(
            f'[[material]]\nname = "{name}"\n' for name in ("IN625", "IN718", "Ti-6Al-4V"))
            + "[[body]]") + rule("forbidden = [{ \"316L\" = [0, 1] }]"),
         {"alloy_rule": ("up to 4 materials", "has 5")}),
        (GRADED + rule('forbidden = [{ "316L" = [0.4, 0.2], "IN625" = [0, 1] }]\nway = "around"')
         + rule('forbidden = [{ "316L" = [0.7, 1], "WC-12Co" = [0.6, 1] }]',
                '["316L", "316L", "WC-12", "copper"]')
         + rule('through = ["bronze"]') + rule('polygon = [{ "316L" = 0.4 }]'),
         {"alloy_rule[1].way": ("third one is needed", 'way = "jump"'),
          "alloy_rule[1].forbidden[1].316L": ("from 0.4 down to 0.2", "lower fraction first"),
          "alloy_rule[1].forbidden[1]": ("'IN625' is not among the rule's powders",),
          "alloy_rule[2].name": ("'r' is there twice",),
          "alloy_rule[2].powders": ("'316L' is there twice",),
          "alloy_rule[2].forbidden[1]": ("sum to 1.3", "no mixture"),
          "alloy_rule[3].through": ("no material 'bronze'", "316L, WC-12Co"),
          "alloy_rule[3]": ("forbids nothing", "polygon or map_file"),
          "alloy_rule[4].polygon": ("1 corners", "three are the least"),
          "alloy_rule[4].polygon[1]": ("sum to 0.4, not to 1",)}),
        (GRADED + rule("", '["316L", "WC-12C"]'),
         {"alloy_rule[1].powders": ("no material 'WC-12C'", "did you mean 'WC-12Co'")}),
        (GRADED + rule('polygon = [{ "316L" = 1 }]'),
         {"alloy_rule[1].polygon": ("plane of three powders", "names 2")}),
    ],
)
def test_alloy_rules(text: str, told: dict[str, tuple[str, ...]]) -> None:
    assert_told(text, told)


@pytest.mark.parametrize(
    ("composition", "told"),
    [
        ("feature = { kind = \"surface\" }\n", {"composition.profile": ("which mixture",)}),
        (f'feature = {{ kind = "surface" }}\n[[composition.blend]]\n{FLAT}'
         f"[[composition.blend]]\nweight = 0.5\n{FLAT}",
         {"composition.feature": ("not used", "each part of the blend has its own"),
          "composition.blend[1].weight": ("is missing",)}),
        ('power = 2\nfeature = { kind = "surface" }\n[composition.sampled]\nfile = "p.3mf"\n'
         'properties = { copper = "Cu" }\n',
         {"composition.power": ("not used", "sampled in a file"),
          "composition.sampled.properties": ("no material 'copper'", "316L, WC-12Co")}),
        (f'feature = {{ kind = "surface", of = "rib" }}\n{FLAT}',
         {"composition.feature.of": ("no body 'rib'", "names are given to none")}),
    ],
)
def test_compositions(composition: str, told: dict[str, tuple[str, ...]]) -> None:
    assert_told(block_file((9, 9, 4), composition), told)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[[copy]]\nposition_mm = [0, 0]\ncount = [30, 30]\nspacing_mm = [20, 20]\n",
         {"copy[1]": ("900 copies", "at most 500")}),
        ("[[copy]]\nposition_mm = [0, 0]\ncount = [2, 1]\n",
         {"copy[1]": ("spacing_mm = [along x, along y]",)}),
        ("[[copy]]\nposition_mm = [0, 0]\nspacing_mm = [20, 20]\n",
         {"copy[1]": ("for a grid", "count = [along x, along y]")}),
        ('[[copy]]\nname = "a"\nposition_mm = [0, 0]\n[[copy]]\nname = "a"\nposition_mm = [20, 0]\n'
         '[process]\nheight_check_every = 2\ncopy_order = "part-by-part"\n' + SCAN,
         {"copy[2].name": ("'a' is there twice",),
          "copy": ("level plate", "the substrate is a scan"),
          "process.height_check_every": ("part by part", "deposit layer by layer")}),
        ("[process]\nheight_check_every = 2\n" + SCAN,
         {"process.height_check_every": ("level plate", "is a scan", "leave it out")}),
        ('[substrate]\nkind = "mesh"\nfile = "plate.stl"\nof = "rib"\n',
         {"substrate.of": ("no body is named 'rib'",),
          "substrate.units": ("is missing", '"mm", "cm", "m" or "inch"')}),
        ('[substrate]\nkind = "plane"\nradius_mm = 4\n',
         {"substrate": ("a plane needs point_mm", "a plane has no radius_mm")}),
        (SCAN + 'units = "mm"\nlayers = "parallel"\n',
         {"substrate": ("needs a plane or a cylinder", '"shifted" or "blended"')}),
        ('[substrate]\nkind = "plane"\npoint_mm = [0, 0, 0]\nnormal = [0, 0, 0]\n',
         {"substrate.normal": ("has no length", "points nowhere")}),
        ('[substrate]\nkind = "cylinder"\npoint_mm = [0, 0, 0]\nradius_mm = 9\naxis = [1, 0, 1]\n',
         {"substrate": ("axis is not level", "lay the bar down")}),
    ],
)
def test_copies_and_substrates(text: str, told: dict[str, tuple[str, ...]]) -> None:
    assert_told(BLOCK + text, told)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (BLOCK + "[process]\npower_range = [1.1, 1.3]\n", {"process": ("recipe's own power, 1",)}),
        (BLOCK + "[process]\nfirst_layer_power = 1.4\npower_per_layer = 0.9\nfinal_power = 0.5\n",
         {"process": ("first_layer_power = 1.4 and final_power = 0.5", "0.7 to 1.3",
                      "power_range")}),
        (BLOCK + "[process]\npower_per_layer = 0.9\nfinal_power = 1.1\n",
         {"process": ("final_power is above 1", "only lowers power")}),
        (BLOCK.replace('"316L"', '"my steel"\ndensity_g_cm3 = 7.8')
         + '[process]\ninterpass_max_C = 90\ncopy_order = "part-by-part"\n'
         + SCAN + 'temperature_C = 100\nmaterial = "slab"\n',
         {"process.interpass_max_C": ("90 °C", "100 °C", "no wait would be long enough"),
          "material[1].conductivity_W_m_K": ("is missing", "'my steel'",
                                             "process.interpass_max_C needs it"),
          "substrate.material": ("'slab'", "add a [[material]] table", "'steel'")}),
        (BLOCK + '[process]\ninterpass_max_C = 90\ncopy_order = "part-by-part"\n',
         {"process.interpass_max_C": ("layer by layer", 'copy_order = "part-by-part"')}),
        (BLOCK + "[process]\ninterpass_max_C = 90\n" + SCAN,
         {"process.interpass_max_C": ("level plate", "a shape of its own")}),
    ],
)
def test_heat(text: str, told: dict[str, tuple[str, ...]]) -> None:
    assert_told(text, told)


@pytest.mark.parametrize(
    ("points", "path", "facts"),
    [
        ("{ free_levels = 1, over_mm = [0, 4] }", "composition.profile.points",
         ("whole number from 2 to 500",)),
        ("{ free_levels = 3, over_mm = [4, 0] }", "composition.profile.points",
         ("over_mm = [from, to]", "rising")),
        ('{ free_levels = 3, over_mm = [0, 4], near = { "316L" = 1 } }',
         "composition.profile.points", ("needs the mixtures near and far",)),
        ("{ free = [0, 1], rest = true }", "composition.profile.points",
         ("free and rest at once",)),
        ("[{ at_mm = { free = [0, 4] }, of = { \"316L\" = 1 } }]",
         "composition.profile.points[1].at_mm", ("needs a start",)),
        ("[{ at_mm = { free = [4, 0], start = 1 }, of = { \"316L\" = 1 } }]",
         "composition.profile.points[1].at_mm", ("4 is not below 0",)),
        ("[{ at_mm = { free = 4, start = 1 }, of = { \"316L\" = 1 } }]",
         "composition.profile.points[1].at_mm", ("free = [least, greatest]",)),
        ("[{ at_mm = { free = [0, 4], start = 5 }, of = { \"316L\" = 1 } }]",
         "composition.profile.points[1].at_mm", ("between 0 and 4",)),
        ('[{ at_mm = { free = [0, 2], start = 1, name = "h" }, of = { "316L" = 1 } }, '
         '{ at_mm = { free = [2, 4], start = 3, name = "h" }, of = { "316L" = 1 } }]',
         "composition.profile.points[2].at_mm", ("two free numbers 'h'",)),
        ('[{ at_mm = { same_as = "h" }, of = { "316L" = 1 } }]',
         "composition.profile.points[1].at_mm", ("no free number 'h'", "there are none")),
    ],
)
def test_free_numbers(points: str, path: str, facts: tuple[str, ...]) -> None:
    profile = f'feature = {{ kind = "surface" }}\nprofile = {{ kind = "table", points = {points} }}'
    assert_told(block_file((9, 9, 4), profile), {path: facts})


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (FACE.format(name="top") * 2 + FACE.format(name="surface") + FACE.format(name="lid")
         + '[[load]]\non = "tpo"\npressure_MPa = 1\n',
         {"face[2].name": ("'top' is there twice",),
          "face[3].name": ("already names the whole surface",),
          "face[4].name": ("already names a body",),
          "load[1].on": ("no face 'tpo'", "did you mean 'top'", "faces are")}),
        ('[[face]]\nname = "far"\nfeature = { kind = "surface", of = "rib" }\n',
         {"face[1].feature.of": ("no body 'rib'", "names are lid")}),
        ('[simulation]\nmodel = "plane-stress"\nmatrix = "copper"\n'
         '[[load]]\non = "surface"\ntraction_MPa = [0, 0, 1]\n'
         '[[support]]\non = "surface"\nfix = ["z"]\n',
         {"load[1].traction_MPa": ("plane model", "nothing along z"),
          "simulation.matrix": ("no material 'copper'", "are 316L"),
          "support[1].fix": ("plane-stress", "has no z", "x, y")}),
        ('[simulation]\nmodel = "axisymmetric"\nsection_mm = 2\n'
         '[[load]]\non = "surface"\nforce_N = [0, 1, 0]\n',
         {"load[1].force_N": ("[radial, 0, axial]",),
          "simulation.section_mm": ("plane models only",)}),
        ('[[support]]\non = "surface"\n', {"support[1]": ("on which face", "fix =")}),
        ('[optimise]\nleast = "mass"\n[[optimise.limit]]\nquantity = "mass"\n'
         '[[optimise.limit]]\nquantity = "fraction"\nat_most = 0.5\n',
         {"optimise.limit[1]": ("give at_most or at_least",),
          "optimise.limit[2]": ("give material",)}),
        ('[optimise]\nleast = "mass"\n[[optimise.limit]]\nquantity = "mass"\nat_least = 5\n'
         '[[optimise.limit]]\nquantity = "mass"\nat_most = 4\n'
         '[[optimise.limit]]\nquantity = "fraction"\nmaterial = "316L"\nat_least = 0.7\n'
         '[[optimise.limit]]\nquantity = "fraction"\nmaterial = "IN625"\nat_least = 0.6\n'
         '[[optimise.forbidden]]\nmaterial = "copper"\nbetween = [0.1, 0.2]\n',
         {"optimise.limit": ("sum to 1.3", "above 1"),
          "optimise.limit[4].material": ("no material 'IN625'",),
          "optimise.forbidden[1].material": ("no material 'copper'", "316L")}),
    ],
)
def test_simulations(text: str, told: dict[str, tuple[str, ...]]) -> None:
    assert_told(BLOCK.replace("[[body]]", '[[body]]\nname = "lid"') + text, told)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (BLOCK.replace("[[material]]", 'combine = "union"\n[[material]]', 1),
         {"combine": ("nothing to combine", "one body")}),
        ('combine = "union"\n' + BLOCK.replace("[[body]]", '[[body]]\nname = "a"')
         + '[[body]]\nkind = "union"\nof = ["a", "a"]\n',
         {"combine": ("nothing to combine", "one body that no other is made of")}),
        (BLOCK.replace("[[body]]", '[[body]]\nname = "a"') + (
            '[[body]]\nname = "a"\nkind = "union"\nof = ["a"]\n'),
         {"body[2].name": ("'a' is there twice",)}),
        (BLOCK.replace("[[body]]", '[[body]]\nname = "b0"') + "".join(
            f'[[body]]\nname = "b{n}"\nkind = "union"\nof = ["b{n - 1}", "b{n - 1}"]\n'
            for n in range(1, 13)),
         {"body": ("13 deep", "in all", f"{MAX_BODIES:,} in all")}),
        (GRADED.replace("[composition]\n" + FLAT, "").replace(
            "[[body]]", '[[body]]\nname = "a"', 1)
         + '[composition]\nfeature = { kind = "surface", of = "a" }\n' + FLAT,
         {"body": ("which of them is the part?",)}),
        ('combine = "union"\n' + GRADED.partition("[composition]")[0]
         + 'composition = { profile = { kind = "constant", of = { "316L" = 1 } } }\n'
         '[[body]]\nkind = "sphere"\ncentre_mm = [0, 0, 0]\nradius_mm = 2\n',
         {"body[2].composition": ("is missing", "of what is it")}),
        ('combine = "union"\n' + BLOCK + '[[body]]\nname = "a"\nkind = "shell"\nof = "b"\n'
         '[[body]]\nname = "b"\nkind = "shell"\nof = "a"\n',
         {"body[2].of": ("circle", "'a' is made of 'b' is made of 'a'")}),
    ],
)
def test_bodies_of_bodies(text: str, told: dict[str, tuple[str, ...]]) -> None:
    assert_told(text, told)


def test_more_mistakes_than_anybody_reads_are_counted_and_the_first_are_shown() -> None:
    with pytest.raises(ConfigError) as refused:
        parse_part_file(
            'combine = "union"\n' + BLOCK + '[[body]]\nkind = "ball"\n' * 150, name="part.toml")
    assert "part.toml has 150 mistakes" in refused.value.what
    assert refused.value.where[0].startswith("body[2]: ")
    assert refused.value.where[100:] == ("and 50 more",)


@pytest.mark.parametrize(
    ("path", "facts"),
    [
        ("/dev/zero", ("/dev/zero is too large", "at most 1,000,000 bytes")),
        ("p" * 300 + ".toml", ("cannot read", "File name too long")),
    ],
)
def test_what_can_be_named_and_not_read(path: str, facts: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError) as refused:
        load_part_file(Path(path))
    assert all(fact in refused.value.render() for fact in facts)


def test_a_file_of_thousands_of_tables_is_none_of_ours() -> None:
    with pytest.raises(ConfigError, match=r"2,002 tables; at most 2,000"):
        parse_part_file(BLOCK + '[[body]]\nkind = "box"\n' * 2000, name="part.toml")
