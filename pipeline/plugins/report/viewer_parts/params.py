"""Parameters of the parts of a camera, for viewers."""

from dataclasses import dataclass

PARTS = "parts.usda"


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """The metadata of the stage that names the parts of a camera, for viewers."""

    meters_per_unit: float
    up_axis: str
