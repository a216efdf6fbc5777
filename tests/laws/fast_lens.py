"""The fast lens of the known biases: f/2, a board 20 mm out of focus, as tests of the methods use it."""

import numpy as np
from laws import rigs

from pipeline.camera.parts.camera import Camera, Sensor

NEAR_MM, FAR_MM, PIXEL_MM = 374.36, 494.36, 0.005


POINT_MM = np.array([7.0, 4.0])


def fast(stop_semi_mm: float) -> Camera:
    """The camera of the known biases."""
    sensor = Sensor(width_px=4000, height_px=3000, pitch_mm=PIXEL_MM)
    return rigs.bare(rigs.tronnier(stop_semi_mm), sensor, 131.81, (NEAR_MM, FAR_MM))
