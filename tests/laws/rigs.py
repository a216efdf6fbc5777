"""Lenses, apertures, cameras and position images for proofs, built in code: no stage is read.

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
from pipeline.camera.parts.spectrum import Channel, SpectralNode
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.records import Acceptance
from pipeline.files.jsonfile import write_json
from pipeline.optics.prescription import Group, Prescription, Surface
from pipeline.products.cameras import FOCUSED
from pipeline.products.light import BundleLight
from pipeline.products.micro_images.make import micro_images
from pipeline.products.micro_images.params import MicroImageTables
from pipeline.products.rays.make import rays, rays_tile
from pipeline.products.rays.params import JoinedRays, RaysTile
from pipeline.products.truth.make import RayTiles
from pipeline.records.plain import to_plain
from pipeline.truth.grid.ray_grid import RayGrid

TRONNIER = (
    # Radius, thickness, index behind, semi-diameter as Smith prints them; the stop is the plane.
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


def reshaped(camera: Camera, surfaces: dict[int, dict], **lens: object) -> Camera:
    """A camera with other values of some surfaces of its lens, by their places, and of the lens itself."""
    old = camera.prescription
    new = tuple(dataclasses.replace(surface, **surfaces.get(i, {})) for i, surface in enumerate(old.surfaces))
    return dataclasses.replace(camera, prescription=dataclasses.replace(old, surfaces=new, **lens))


def displaced(camera: Camera) -> Camera:
    """The double Gauss of a camera, assembled far worse than any workshop does it: groups, a surface and the stop."""
    groups = (
        Group(name="front", first=0, count=2, decentre_mm=(0.8, -0.5), tilt_deg=(1.0, -2.0)),
        Group(name="rear", first=8, count=3, tilt_deg=(-1.5, 1.0), pivot_mm=2.0),
    )
    return reshaped(camera, {2: {"tilt_deg": (0.7, 0.4)}, 5: {"decentre_mm": (0.6, 0.3)}}, groups=groups)


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
    inputs["rays"] = {path.name: path for path in (folder / "rays").iterdir()}
    if camera.microlenses:
        micro_images(MicroImageTables(tiles=0), inputs, folder / "table")
        inputs["micro_images"] = {"micro_images.csv": folder / "table" / "micro_images.csv"}
    return RayTiles(inputs).window(slice(0, sensor.height_px), slice(0, sensor.width_px))


F_MM = 49.9


def thin(focal_mm: float = F_MM, semi_mm: float = 6.0) -> Prescription:
    return Prescription(surfaces=(Surface(focal_length_mm=focal_mm, semi_diameter_mm=semi_mm, is_stop=True),))


NEAR_MM, FAR_MM, PIXEL_MM = 374.36, 494.36, 0.005


POINT_MM = np.array([7.0, 4.0])


def fast(stop_semi_mm: float) -> Camera:
    sensor = Sensor(width_px=4000, height_px=3000, pitch_mm=PIXEL_MM)
    return bare(tronnier(stop_semi_mm), sensor, 131.81, (NEAR_MM, FAR_MM))


def acceptance_of(
    power: float = 0.0, half_deg: float = 0.0, roll_deg: float = 0.0, weight: str = "irradiance"
) -> Acceptance:
    return Acceptance(float(power), math.radians(half_deg), math.radians(roll_deg), weight == "area")


def behind_a_hole(array: MicrolensArray, size_px: int = 60, pitch_mm: float = 0.02, **pixels: object) -> Tracer:
    """Microlenses, and no main lens."""
    sensor = Sensor(width_px=size_px, height_px=size_px, pitch_mm=pitch_mm, **pixels)
    return Tracer(
        Camera(
            prescription=hole(500.0),
            sensor=sensor,
            sensor_distance_mm=20.0,
            microlenses=array,
            near_mm=100.0,
            far_mm=200.0,
        )
    )


HEXAGON = {"blades": 6, "aperture_rotation_deg": 30.0}
"""Six blades, turned by 30 deg; 10 mm across corners."""


def inside(shape: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Which points of the lens frame lie in an aperture of semi-diameter 5 mm, from angles instead of edges."""
    r, angle = np.hypot(x, y), np.degrees(np.arctan2(y, x))
    if shape == "ring":
        return (r >= 2.0) & (r <= 5.0)
    if shape == "rectangle":
        turned = np.radians(angle - 20.0)
        return (np.abs(r * np.cos(turned)) <= 4.0) & (np.abs(r * np.sin(turned)) <= 2.5) & (r <= 5.0)
    blades, corner = (6, 30.0) if shape == "hexagon" else (3, 0.0)
    from_middle = np.radians((angle - corner) % (360.0 / blades) - 180.0 / blades)
    return r * np.cos(from_middle) <= 5.0 * math.cos(math.pi / blades)


D_NM, F_NM, C_NM = 587.56, 486.13, 656.27
"""Wavelengths at which glasses are stated [nm]: the lines of helium and hydrogen."""
ABBE = {1.67: 47.2, 1.699: 30.1, 1.603: 38.0, 1.658: 57.3, 1.717: 47.9}
"""Abbe numbers of the glasses of the Tronnier double Gauss, by index."""


def index_at(index: float, wavelength_nm: float) -> float:
    """n = n_d + b (1 / lambda^2 - 1 / lambda_d^2), with b from the Abbe number."""
    if index == 1.0:
        return 1.0
    b = (index - 1) / ABBE[index] / (F_NM**-2 - C_NM**-2)
    return index + b * (wavelength_nm**-2 - D_NM**-2)


def node(camera: Camera, wavelength_nm: float, weight: float = 1.0) -> SpectralNode:
    """A wavelength with the indices of the camera's glasses there."""
    indices = tuple(index_at(surface.index, wavelength_nm) for surface in camera.prescription.surfaces)
    return SpectralNode(wavelength_nm=wavelength_nm, weight=weight, indices=indices)


def in_light(camera: Camera, light: dict[float, float]) -> Camera:
    """The camera in a light of some wavelengths [nm] with their shares."""
    nodes = tuple(node(camera, nm, share) for nm, share in light.items())
    mean = sum(nm * share for nm, share in light.items())
    return camera.in_light(Channel(name="", middle=node(camera, mean), nodes=nodes))


def at(camera: Camera, wavelength_nm: float) -> Camera:
    return camera.at(node(camera, wavelength_nm))
