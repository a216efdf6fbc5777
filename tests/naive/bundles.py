"""Poses, and the differences of means in units of their error."""

import numpy as np
from laws import rigs

POSES = rigs.facing(410.0, 20.0, 3.0, 1.0), rigs.facing(470.0, -35.0, -2.0, 4.0)


RAYS, GROUPS = 5_000, 16


def deviations(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Differences of column means over their standard error, each from its own repetitions."""
    error = np.sqrt((one.var(axis=0, ddof=1) + other.var(axis=0, ddof=1)) / GROUPS)
    return (one.mean(axis=0) - other.mean(axis=0)) / error
