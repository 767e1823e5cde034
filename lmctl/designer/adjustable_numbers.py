"""The numbers of a part file that its designer offers: of bodies, features, profiles, mixtures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from lmctl.array_types import FloatArray
from lmctl.designer.part_document import KeyPath

#: Keys of bodies and features that say how something is computed, not where it is.
_LEFT_OUT = {"pitch_mm", "allowance_mm"}

#: Numbers of an axis's own, by the last key: least and greatest of the slider.
_RANGES = {"angle_deg": (0.0, 180.0), "k": (0.1, 10.0), "a": (0.1, 10.0), "power": (0.5, 10.0)}

#: Steps of a slider from its least value to its greatest.
_SLIDER_STEPS = 500


@dataclass(frozen=True)
class AdjustableNumber:
    """One number that may be moved.

    path : its place in the part file; group, label : for people
    unit : "mm", "°" or ""; low, high, step : of its slider; it may be typed beyond them
    """

    path: KeyPath
    group: str
    label: str
    unit: str
    value: float
    low: float
    high: float
    step: float


def adjustable_numbers(
    data: dict[str, Any], materials: list[str], box_mm: tuple[FloatArray, FloatArray]
) -> list[AdjustableNumber]:
    """All of them, in the order of the file.

    data : of the part file, plain; materials : their names; box_mm : around the part
    """
    walk = _Walk(materials, box_mm)
    found = list(walk.composition(data.get("composition"), ("composition",), "part"))
    for number, body in enumerate(data.get("body", ())):
        name = f"body {body.get('name', number + 1)} ({body.get('kind', '?')})"
        for key, value in body.items():
            if key == "composition":
                found += walk.composition(value, ("body", number, key), name)
            elif key not in _LEFT_OUT:
                found += walk.numbers(value, ("body", number, key), name, key)
    return found


class _Walk:
    """Goes through plain data. box_mm : what the sliders of places reach over"""

    def __init__(self, materials: list[str], box_mm: tuple[FloatArray, FloatArray]) -> None:
        self._materials = materials
        self._low, self._high = box_mm
        self._size_mm = max(float((self._high - self._low).max()), 1.0)

    def composition(self, value: Any, path: KeyPath, of: str) -> Iterator[AdjustableNumber]:
        """Numbers of one composition: its own feature and profile, or those of a blend."""
        if not isinstance(value, dict):
            return
        yield from self._graded(value, path, f"{of}: composition")
        if "power" in value:
            yield from self.numbers(value["power"], (*path, "power"), f"{of}: composition", "power")
        for number, part in enumerate(value.get("blend", ())):
            group = f"{of}: blend {number + 1}"
            if "weight" in part:
                yield from self._share(part["weight"], (*path, "blend", number, "weight"), group,
                                       "weight")
            yield from self._graded(part, (*path, "blend", number), group)

    def numbers(self, value: Any, path: KeyPath, group: str, label: str
                ) -> Iterator[AdjustableNumber]:
        """A number, or the numbers of an array of them at any depth."""
        if isinstance(value, list):
            axes = _axis_names(value, path)
            for number, one in enumerate(value):
                name = axes[number] if axes else str(number + 1)
                yield from self.numbers(one, (*path, number), group, f"{label} {name}")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            low, high = self._range(path, float(value))
            yield AdjustableNumber(path, group, label, _unit(path), float(value), low, high,
                                   (high - low) / _SLIDER_STEPS)

    def _graded(self, value: dict[str, Any], path: KeyPath, group: str
                ) -> Iterator[AdjustableNumber]:
        feature, profile = value.get("feature"), value.get("profile")
        if isinstance(feature, dict):
            for key, one in feature.items():
                yield from self.numbers(one, (*path, "feature", key), group,
                                        f"{feature.get('kind', 'feature')} {key}")
        if isinstance(profile, dict):
            yield from self._profile(profile, (*path, "profile"), group)

    def _profile(self, profile: dict[str, Any], path: KeyPath, group: str
                 ) -> Iterator[AdjustableNumber]:
        for key, one in profile.items():
            if key in ("near", "far", "of"):
                yield from self._mixture(one, (*path, key), group, key)
            elif key in ("points", "steps") and isinstance(one, list):
                for number, point in enumerate(one):
                    name = f"{key[:-1]} {number + 1}"
                    for part, value in point.items():
                        at = (*path, key, number, part)
                        if part == "of":
                            yield from self._mixture(value, at, group, name)
                        else:
                            yield from self.numbers(value, at, group, f"{name} {part}")
            else:
                yield from self.numbers(one, (*path, key), group, key)

    def _mixture(self, value: Any, path: KeyPath, group: str, label: str
                 ) -> Iterator[AdjustableNumber]:
        if not isinstance(value, dict) or len(self._materials) < 2:
            return
        if any(isinstance(share, dict) for share in value.values()):
            return  # free numbers, which `lmctl optimise` chooses
        for name in self._materials:
            yield from self._share(value.get(name, 0.0), (*path, name), group, f"{label} {name}")

    def _share(self, value: Any, path: KeyPath, group: str, label: str
               ) -> Iterator[AdjustableNumber]:
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield AdjustableNumber(path, group, label, "", float(value), 0.0, 1.0, 0.002)

    def _range(self, path: KeyPath, value: float) -> tuple[float, float]:
        key = next(str(one) for one in reversed(path) if isinstance(one, str))
        if key in _RANGES:
            low, high = _RANGES[key]
        elif key.endswith("radius_mm") or key == "thickness_mm":
            low, high = self._size_mm / 1000.0, self._size_mm
        elif key.endswith("_mm") and isinstance(path[-1], int) and key != "over_mm":
            axis = path[-1] % 3
            low = float(self._low[axis]) - 0.25 * self._size_mm
            high = float(self._high[axis]) + 0.25 * self._size_mm
        elif key.endswith("_mm"):
            low, high = -0.25 * self._size_mm, 1.25 * self._size_mm
        else:
            reach = max(abs(value), 1.0)
            low, high = -reach, reach
        return min(low, value), max(high, value)


def _axis_names(values: list[Any], path: KeyPath) -> str | None:
    """Names of an array's numbers, where it is a place or direction; None for other arrays."""
    if not values or isinstance(values[0], list):
        return None
    is_corner = len(path) > 1 and isinstance(path[-1], int)
    return {3: "xyz", 2: "xy" if is_corner else None}.get(len(values))


def _unit(path: KeyPath) -> str:
    key = next(str(one) for one in reversed(path) if isinstance(one, str))
    return "mm" if key.endswith("_mm") else "°" if key.endswith("_deg") else ""
