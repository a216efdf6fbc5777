"""The only unit arithmetic: stage units and millimetres, degrees and radians."""

import math

DEGREE_RAD = math.pi / 180.0
"""One degree [rad]."""


def mm_per_unit(meters_per_unit: float) -> float:
    """Millimetres in one unit of a stage whose `metersPerUnit` is given."""
    return meters_per_unit * 1000.0
