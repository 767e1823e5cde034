"""Part files to be edited."""

from __future__ import annotations

from pathlib import Path

import pytest

from lmctl.config.machine import load_profile
from lmctl.designer import DesignSession
from tests.part_files import block_file
from tests.run.whole.conftest import EXAMPLES

#: A graded block with comments, free space and a table that a person laid out.
BLEND = block_file((20, 12, 4), """
# which end is hard
weights = "constant"
[[composition.blend]]
weight = 0.25   # of the first
feature = { kind = "point", at_mm = [0, 0, 0] }
[composition.blend.profile]
kind = "linear"
near = { "316L" = 1, "WC-12Co" = 0 }
far = { "316L" = 0.2, "WC-12Co" = 0.8 }
over_mm = [0, 20]
[[composition.blend]]
weight = 0.75
feature = { kind = "plane", point_mm = [20, 0, 0], normal = [1, 0, 0] }
[composition.blend.profile]
kind = "table"
points = [
    { at_mm = 0, of = { "WC-12Co" = 1.0 } },       # the hard face
    { at_mm = 10, of = { "316L" = 1.0 } },
]
""")


@pytest.fixture
def part_path(tmp_path) -> Path:
    path = tmp_path / "part.toml"
    path.write_text(BLEND)
    return path


@pytest.fixture
def session(part_path) -> DesignSession:
    return DesignSession(part_path, load_profile(EXAMPLES / "cell.toml"))
