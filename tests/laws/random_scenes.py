"""Random cameras, targets and poses, each from its number alone."""

import dataclasses
import math

import numpy as np
from laws import rigs

from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import parallel_planes
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.frames import rigid
from pipeline.targets.patterns.checkerboard import Checkerboard, Deltille
from pipeline.targets.patterns.circles import CircleGrid
from pipeline.targets.surfaces import Cylinder, Flat, Stairs, Warped
from pipeline.targets.target import Target

GLASS = {"model": "refractive", "index": 1.52, "thickness_mm": 0.6, "front_radii_mm": (1.1,)}
MODELS = (
    {"focal_lengths_mm": (1.9, 2.1, 2.3)},
    {"focal_lengths_mm": (2.1,)},
    {"model": "two-plane", "index": 5.0, "thickness_mm": 0.1, "focal_lengths_mm": (1.9, 2.1, 2.3)},
    {**GLASS, "rear_radii_mm": (math.inf,)},
)


def random_camera(rng: np.random.Generator) -> Camera:
    """The double Gauss, every third time badly assembled, with or without microlenses of any kind."""
    plenoptic = rng.random() < 0.6
    camera = _plenoptic(rng) if plenoptic else rigs.conventional(rng.uniform(2.0, 12.0), 64, 48, 0.075)
    return rigs.displaced(camera) if rng.random() < 1 / 3 else camera


def _plenoptic(rng: np.random.Generator) -> Camera:
    tilt = rng.uniform(-1.0, 1.0, 2) * (rng.random() < 0.5)
    array = MicrolensArray(
        pitch_mm=0.2173,
        width_mm=3.0,
        height_mm=3.0,
        distance_mm=1.7,
        layout=str(rng.choice(["hexagonal", "hexagonal-columns"])),
        rotation_deg=rng.uniform(-20, 20),
        tilt_x_deg=tilt[0],
        tilt_y_deg=tilt[1],
        **MODELS[rng.integers(len(MODELS))],
    )
    offset_x_mm, offset_y_mm = rng.uniform(-0.1, 0.1, 2)
    sensor = Sensor(width_px=88, height_px=64, pitch_mm=0.01, offset_x_mm=offset_x_mm, offset_y_mm=offset_y_mm)
    camera = Camera(
        prescription=rigs.tronnier(rng.uniform(3.0, 5.0)), sensor=sensor, sensor_distance_mm=125.0, microlenses=array
    )
    return focused(dataclasses.replace(camera, near_mm=380.0, far_mm=480.0))


def random_target(rng: np.random.Generator) -> Target:
    """A few points of three patterns, flat or not."""
    step_mm = rng.uniform(0.7, 1.1)
    pattern = [
        Checkerboard(columns=3, rows=2, square_mm=step_mm),
        CircleGrid(columns=3, rows=2, spacing_mm=step_mm, diameter_mm=step_mm / 2),
        Deltille(columns=3, rows=2, edge_mm=step_mm),
    ][rng.integers(3)]
    surface = [Flat(), Flat(), Cylinder(radius_mm=25.0), Warped(deflection_mm=(0.3, -0.2))][rng.integers(4)]
    if isinstance(pattern, Checkerboard) and rng.random() < 0.3:
        surface = Stairs(steps=2, depth_mm=1.0)
    return Target(pattern, surface)


def random_pose(rng: np.random.Generator, rig: Rig) -> np.ndarray:
    """vision_from_target: about where the middle of the image looks, turned by up to 40 degrees about any axis."""
    axis, turn = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(0, 40.0))
    c, s = np.cos(axis), np.sin(axis)
    across = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])
    distance_mm = rng.uniform(405.0, 460.0)
    place = np.array([*_looked_at(rig, distance_mm) + rng.uniform(-0.5, 0.5, 2), distance_mm])
    return rigid(across @ about_x @ across.T @ np.diag([1.0, -1.0, -1.0]), place)


def _looked_at(rig: Rig, distance_mm: float) -> np.ndarray:
    """Mean hit of the middle of the image: displaced lenses look aside."""
    sensor = rig.tracer.camera.sensor
    place = rig.tracer.positions_mm(np.array([sensor.width_px / 2]), np.array([sensor.height_px / 2]))
    lens = np.array([NO_MICROLENS])
    if rig.images is not None:
        lens = rig.images.owner(place)
        place = rig.images.centre_mm[lens]
    planes = parallel_planes(distance_mm, distance_mm + 1)
    return rig.tracer.moments(place, lens, planes, 1024, np.zeros((1, 2)))[0, :2]
