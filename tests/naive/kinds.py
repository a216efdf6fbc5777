"""Arrays with microlenses of every model and place."""

import math

import numpy as np
from laws import rigs
from naive import slow_microlens

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.tracer import Tracer

GLASS = {"model": "refractive", "index": 1.52}


KINDS = {
    "square": {"layout": "square", "focal_lengths_mm": (2.1,)},
    "columns, three types": {"layout": "hexagonal-columns", "focal_lengths_mm": (1.9, 2.1, 2.3), "rotation_deg": 7.0},
    "stretched": {"cross_pitch_mm": 0.25, "focal_lengths_mm": (1.9, 2.1, 2.3)},
    "discs": {"aperture": "disc", "disc_diameter_mm": 0.16, "focal_lengths_mm": (2.1,)},
    "tilted": {"focal_lengths_mm": (2.1,), "tilt_x_deg": 4.0, "tilt_y_deg": -3.0},
    "two-plane": {"model": "two-plane", "index": 5.0, "thickness_mm": 0.1, "focal_lengths_mm": (1.9, 2.1, 2.3)},
    "convex to the lens": {**GLASS, "thickness_mm": 0.6, "front_radii_mm": (1.1,), "rear_radii_mm": (math.inf,)},
    "convex to the sensor": {**GLASS, "thickness_mm": 0.6, "front_radii_mm": (math.inf,), "rear_radii_mm": (-1.1,)},
    "biconvex conics, square, tilted discs": {
        **GLASS,
        "layout": "square",
        "thickness_mm": 0.1,
        "front_radii_mm": (2.0,),
        "rear_radii_mm": (-2.4,),
        "front_conics": (-0.8,),
        "rear_conics": (0.5,),
        "aperture": "disc",
        "disc_diameter_mm": 0.2,
        "tilt_x_deg": -2.0,
    },
    "biconvex cells": {**GLASS, "thickness_mm": 0.1, "front_radii_mm": (2.0,), "rear_radii_mm": (-2.4,)},
}


PIXELS = {
    "all": {},
    "cosine": {"acceptance": "cosine", "acceptance_power": 40.0},
    "cone": {"acceptance": "cone", "acceptance_half_angle_deg": 1.5, "acceptance_roll_off_deg": 1.0},
}


def camera_with(kind: str, stop_semi_mm: float = 5.0, pixels: str = "all") -> Camera:
    array = MicrolensArray(pitch_mm=0.2173, width_mm=12.0, height_mm=12.0, distance_mm=1.7, **KINDS[kind])
    return Camera(
        prescription=rigs.tronnier(stop_semi_mm),
        sensor=Sensor(width_px=9, height_px=7, pitch_mm=0.04, **PIXELS[pixels]),
        sensor_distance_mm=125.0,
        microlenses=array,
        near_mm=400.0,
        far_mm=470.0,
    )


def vertex_of(tracer: Tracer, row: int) -> np.ndarray:
    return slow_microlens.vertex(tracer.camera, int(tracer.lattice.k[row]), int(tracer.lattice.l[row]))
