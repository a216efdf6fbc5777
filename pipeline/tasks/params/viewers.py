"""Parameters of the tasks `parts` and `sheet`, which make what USD viewers show besides dataset.usda."""

from dataclasses import dataclass
from typing import Any

PARTS, SHEET = "parts.usda", "sheet.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """The metadata of the stage that names the parts of a camera."""

    meters_per_unit: float
    up_axis: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A target, as `target_from_plain` reads it."""

    target: dict[str, Any]
