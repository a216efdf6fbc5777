"""Boards turned about several axes, and a bundle before them."""

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.frames import rigid


def turned(*angles_deg: float) -> np.ndarray:
    """A target that looks at the camera, turned about x, then y, then z of the vision frame."""
    turn = Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix()
    return rigid(turn @ np.diag([1.0, -1.0, -1.0]), np.array([3.0, -2.0, 440.0]))


OBLIQUE = {"vertical": (0, 35, 0), "horizontal": (35, 0, 0), "both": (25, -30, 0), "both, rolled": (-30, 20, 70)}
"""Axes about which targets are turned [deg]."""


MEAN = np.array([2.0, -1.0, 5.0, 3.0])
