"""What the first layer is deposited on: `[substrate]` of a part file.

Without the table a part is deposited on a flat plate of unknown alloy.
"""

from __future__ import annotations

from typing import Literal

from lmctl.config.quantities import Name
from lmctl.config.toml_file import ConfigModel


class SubstrateSettings(ConfigModel):
    """The surface under the first layer.

    kind : "plate" is flat and level under the part's lowest point
    material : its alloy; None where it is not known
    """

    kind: Literal["plate"] = "plate"
    material: Name | None = None
