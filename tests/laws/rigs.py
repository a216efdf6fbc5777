"""Lenses, cameras and position images for proofs, built in code: no stage is read.

The Tronnier double Gauss 100 mm f/2 is US patent 2,673,491, as printed in Smith, Modern Lens Design, p. 312; radii,
indices n_d and apertures as in the scene collection of pbrt-v4.
"""

import dataclasses
import math
from pathlib import Path

import numpy as np

from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.parts.camera import Camera, Sampling, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.files.jsonfile import write_json
from pipeline.optics.prescription import Group, Prescription, Surface
from pipeline.records.plain import to_plain
from pipeline.tasks.artefacts.cameras import FOCUSED
from pipeline.tasks.micro_images import micro_images
from pipeline.tasks.params.cameras import BundleLight, JoinedRays, MicroImageTables, RaysTile
from pipeline.tasks.rays import rays, rays_tile
from pipeline.tasks.truth import RayFile
from pipeline.truth.grid.ray_grid import RayGrid

TRONNIER = (
    # radius, thickness, index behind, semi-diameter; the stop is the plane
    (58.95, 7.52, 1.67, 25.2),
    (169.66, 0.24, 1.0, 25.2),
    (38.55, 8.05, 1.67, 23.0),
    (81.54, 6.55, 1.699, 23.0),
    (25.5, 11.41, 1.0, 18.0),
    (math.inf, 9.0, 1.0, 17.1),
    (-28.99, 2.36, 1.603, 17.0),
    (81.54, 12.13, 1.658, 20.0),
    (-40.77, 0.38, 1.0, 20.0),
    (874.13, 6.44, 1.717, 20.0),
    (-79.46, 72.228, 1.0, 20.0),
)


def tronnier(stop_semi_mm: float = 17.1) -> Prescription:
    """The double Gauss with its stop closed to a semi-diameter."""
    return Prescription(
        surfaces=tuple(
            Surface(
                radius_mm=radius,
                thickness_mm=thickness,
                index=index,
                semi_diameter_mm=stop_semi_mm if math.isinf(radius) else semi,
                is_stop=math.isinf(radius),
            )
            for radius, thickness, index, semi in TRONNIER
        )
    )


def displaced(camera: Camera) -> Camera:
    """The double Gauss of a camera, assembled far worse than any workshop does it: groups, a surface and the stop."""
    surfaces = list(camera.prescription.surfaces)
    surfaces[2] = dataclasses.replace(surfaces[2], tilt_deg=(0.7, 0.4))
    surfaces[5] = dataclasses.replace(surfaces[5], decentre_mm=(0.6, 0.3))
    groups = (
        Group(name="front", first=0, count=2, decentre_mm=(0.8, -0.5), tilt_deg=(1.0, -2.0)),
        Group(name="rear", first=8, count=3, tilt_deg=(-1.5, 1.0), pivot_mm=2.0),
    )
    return dataclasses.replace(camera, prescription=Prescription(surfaces=tuple(surfaces), groups=groups))


def hole(semi_mm: float) -> Prescription:
    """No lens: a stop alone."""
    return Prescription(surfaces=(Surface(semi_diameter_mm=semi_mm, is_stop=True),))


def bare(prescription: Prescription, sensor: Sensor, distance_mm: float, near_far_mm: tuple[float, float]) -> Camera:
    """A conventional camera with authored near and far planes."""
    near, far = near_far_mm
    return Camera(prescription=prescription, sensor=sensor, sensor_distance_mm=distance_mm, near_mm=near, far_mm=far)


def conventional(stop_semi_mm: float = 4.5, width_px: int = 96, height_px: int = 72, pitch_mm: float = 0.05) -> Camera:
    """The double Gauss before few coarse pixels, focused at 434 mm."""
    sensor = Sensor(width_px=width_px, height_px=height_px, pitch_mm=pitch_mm)
    return focused(Camera(prescription=tronnier(stop_semi_mm), sensor=sensor, sensor_distance_mm=131.81))


def michels_array(extent_mm: float = 21.73) -> MicrolensArray:
    """The microlenses of Michels, Petersen and Koch 2019, or the centre of them."""
    return MicrolensArray(
        pitch_mm=0.2173,
        focal_lengths_mm=(1.9, 2.1, 2.3),
        width_mm=extent_mm,
        height_mm=extent_mm,
        distance_mm=1.7,
    )


def plenoptic(extent_mm: float = 21.73, width_px: int = 128, height_px: int = 96, pitch_mm: float = 0.01) -> Camera:
    """The plenoptic camera of that paper: stop 10 mm, array 123.3 mm behind it, here with few pixels."""
    return focused(
        Camera(
            prescription=tronnier(5.0),
            sensor=Sensor(width_px=width_px, height_px=height_px, pitch_mm=pitch_mm),
            sensor_distance_mm=125.0,
            microlenses=michels_array(extent_mm),
        )
    )


def facing(distance_mm: float, tilt_deg: float = 0.0, x_mm: float = 0.0, y_mm: float = 0.0) -> np.ndarray:
    """vision_from_target of a target that looks at the camera, then turned about the vertical axis."""
    angle = math.radians(tilt_deg)
    turn = np.array([[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]])
    pose = np.eye(4)
    pose[:3, :3] = turn @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = x_mm, y_mm, distance_mm
    return pose


def sharp_grid(
    near: np.ndarray, far: np.ndarray, supersampling: int, planes_mm: tuple[float, float], square_steps: float = 0.0
) -> RayGrid:
    """Position images of one lit cell without blur, from J_near and J_far (K h, K w, 2)."""
    height, width = near.shape[:2]
    return RayGrid(
        supersampling=supersampling,
        near_mm=planes_mm[0],
        far_mm=planes_mm[1],
        near=near,
        far=far,
        covariance=np.zeros((height // supersampling, width // supersampling, 10)),
        hit_fraction=np.ones((height, width)),
        error_px=np.zeros((height, width, 2)),
        cell=np.zeros((height, width), np.int64),
        microlenses=np.zeros((1, 3), np.int64),
        centres_px=None,
        square_steps=square_steps,
    )


def ray_grid(
    folder: Path, camera: Camera, supersampling: int, samples: int, seed: int = 1, footprint: str = "point"
) -> RayGrid:
    """Position images of a camera, made by the tasks of a build and read back from their files."""
    sensor = camera.sensor
    sampling = Sampling(supersampling=supersampling, samples=samples, seed=seed)
    for name in ("camera", "tile", "rays", "table"):
        (folder / name).mkdir(parents=True)
    write_json(folder / "camera" / FOCUSED, to_plain(camera))
    inputs = {"camera": {FOCUSED: folder / "camera" / FOCUSED}}
    square_px = 1 / supersampling if footprint == "pixel" else 0.0
    whole = RaysTile(first_row=0, end_row=sensor.height_px, sampling=sampling, square_px=square_px)
    rays_tile(whole, inputs, folder / "tile")
    inputs["tile0"] = {f"{name}.npy": folder / "tile" / f"{name}.npy" for name in ("bundles", "cells", "covariance")}
    light = BundleLight(weight="irradiance", footprint=footprint, wavelength_nm=587.56)
    rays(JoinedRays(tiles=1, sampling=sampling, light=light), inputs, folder / "rays")
    inputs["rays"] = {"rays.exr": folder / "rays" / "rays.exr"}
    if camera.microlenses:
        micro_images(MicroImageTables(tiles=0), inputs, folder / "table")
        inputs["micro_images"] = {"micro_images.csv": folder / "table" / "micro_images.csv"}
    return RayFile(inputs).window(slice(0, sensor.height_px), slice(0, sensor.width_px))
