"""Output folder of a camera that is what libpleno assumes: a thin main lens before thin lenses, each a pinhole.

All positions in closed form, by straight lines, in the vision frame: x right, y down, z forward, origin at the lens.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from plugins.formats.pretended import FACING, board_mm, turned, write_manifest, write_poses, write_rows, write_target

from pipeline.files.exr import Part, write_exr
from pipeline.files.tables import write_table
from pipeline.frames import apply, rigid

SIZE_PX, PIXEL_MM = (241, 201), 0.01
FOCAL_MM, LENS_TO_ARRAY_MM, ARRAY_TO_SENSOR_MM, F_NUMBER = 100.0, 123.0, 1.7, 7.0
TYPES_MM, PITCH_MM, TURN_RAD = (1.9, 2.1, 2.3), 0.21, 0.02
LENS_BEHIND_STOP_MM = 3.0
"""The main lens stands so far behind the stop, from which camera.json counts; its principal planes have z = -3 mm."""
FIELDS_MM = {1.9: (330.0, 380.0), 2.1: (400.0, 440.0), 2.3: (445.0, 480.0)}
"""Depth of field of each type, object distances from the lens."""
AXIS_PX = np.array([(n - 1) / 2 for n in SIZE_PX])
"""Image position of the optical axis."""
OFFSET_MM = np.array([0.213, -0.021])
"""So far that the microlens in the middle is not of type 0."""
RADIUS_PX = 9.5
"""Radius of a micro-image, smaller than half the pitch."""
REACH_PX = 12.5
"""Radius of a micro-image, and a little more: 0.21 mm / sqrt(3) on the sensor."""
HIT_PX = np.array([57.0, 112.0])
"""The pixel on whose centre point 0 is seen in frame 1, behind the microlens nearest to there."""


@dataclass(frozen=True)
class Array:
    """Microlenses: axial indices, types, vertices in the vision frame, centres of micro-images in px."""

    kl: np.ndarray
    types: np.ndarray
    vertex_mm: np.ndarray
    centre_px: np.ndarray


def pixels_of(sensor_mm: np.ndarray) -> np.ndarray:
    """Image positions of points of the sensor in the vision frame: the image stands on its head."""
    return -sensor_mm / PIXEL_MM + (np.array(SIZE_PX) - 1) / 2


def array_of(layout: str) -> Array:
    """Lattices as CONVENTIONS.md has them, in the sensor frame: the vision frame turned by 180 degrees about z."""
    half = np.sqrt(3) / 2
    a, b = {
        "hexagonal": ((1, 0), (0.5, half)),
        "hexagonal-columns": ((half, 0.5), (0, 1)),
        "square": ((1, 0), (0, 1)),
    }[layout]
    l, k = np.mgrid[-14:15, -14:15].reshape(2, -1)
    cos, sin = np.cos(TURN_RAD), np.sin(TURN_RAD)
    flat = PITCH_MM * (np.outer(k, a) + np.outer(l, b)) @ np.array([[cos, sin], [-sin, cos]]) + OFFSET_MM
    vertex = np.column_stack([-flat, np.full(len(k), -LENS_TO_ARRAY_MM)])
    ratio = (LENS_TO_ARRAY_MM + ARRAY_TO_SENSOR_MM) / LENS_TO_ARRAY_MM
    types = np.zeros(len(k), int) if layout == "square" else (k - l) % 3
    return Array(np.stack([k, l], 1), types, vertex, pixels_of(vertex[:, :2] * ratio))


def main_image(places_mm: np.ndarray) -> np.ndarray:
    """Images of points of the vision frame by the thin main lens, (n, 3)."""
    scale = -FOCAL_MM / (places_mm[:, 2:] - FOCAL_MM)
    return places_mm * scale


def seen_through(image_mm: np.ndarray, vertex_mm: np.ndarray) -> np.ndarray:
    """Image positions where the lines from images through vertices meet the sensor, (n, 2) [px]."""
    steps = ARRAY_TO_SENSOR_MM / (image_mm[..., 2] - vertex_mm[..., 2])
    return pixels_of((vertex_mm + (vertex_mm - image_mm) * steps[..., None])[..., :2])


def blur_px(image_mm: np.ndarray, focal_mm: np.ndarray) -> np.ndarray:
    """Signed radius of the cone that a microlens makes on the sensor, + where it ends before it: thin-lens equation."""
    before = image_mm[..., 2] + LENS_TO_ARRAY_MM
    behind = 1 / (1 / focal_mm - 1 / before)
    return PITCH_MM / 2 * (ARRAY_TO_SENSOR_MM / behind - 1) / PIXEL_MM


@dataclass(frozen=True)
class PlenopticScene:
    layout: str = "hexagonal"
    array: Array = field(init=False)
    poses: dict = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "array", array_of(self.layout))
        poses = {
            2: rigid(turned(0.2, -0.35, 0.1) @ FACING, np.array([0.4, 0.7, 420.0])),
            5: rigid(turned(-0.3, 0.25, -0.2) @ FACING, np.array([-0.5, 0.2, 460.0])),
        }
        object.__setattr__(self, "poses", {1: self._first_pose(), **poses})

    @property
    def focal_mm(self) -> tuple[float, ...]:
        return TYPES_MM[:1] if self.layout == "square" else TYPES_MM

    def _first_pose(self) -> np.ndarray:
        """Point 0 is seen in the middle of a pixel: back from there through the nearest vertex and the main lens."""
        nearest = np.linalg.norm(self.array.centre_px - HIT_PX, axis=1).argmin()
        vertex = self.array.vertex_mm[nearest]
        sensor = np.append(-(HIT_PX - (np.array(SIZE_PX) - 1) / 2) * PIXEL_MM, -LENS_TO_ARRAY_MM - ARRAY_TO_SENSOR_MM)
        z = 430.0
        image_z = -z * FOCAL_MM / (z - FOCAL_MM)
        image = vertex + (sensor - vertex) * (image_z - vertex[2]) / (sensor[2] - vertex[2])
        place = image / (-FOCAL_MM / (z - FOCAL_MM))
        return rigid(FACING, place - FACING @ board_mm(2.0)[0])

    def rows(self, frame: int) -> list[tuple]:
        """Point, k, l, type, x, y and rho of everything that lies in the image and near its micro-image."""
        found = []
        for point, place in enumerate(apply(self.poses[frame], board_mm(2.0))):
            image = main_image(place[None])
            pixels = seen_through(image, self.array.vertex_mm)
            near = np.linalg.norm(pixels - self.array.centre_px, axis=1) < REACH_PX
            inside = ((pixels > 0) & (pixels < np.array(SIZE_PX) - 1)).all(axis=1)
            for lens in np.flatnonzero(near & inside):
                kind = int(self.array.types[lens])
                rho = float(blur_px(image, np.array(self.focal_mm[kind]))[0])
                found.append((point, *self.array.kl[lens].tolist(), kind, *pixels[lens].tolist(), rho))
        return found


def slope_image(frame: int) -> np.ndarray:
    """Light that grows along x and y, so that its value anywhere between pixels is known."""
    y, x = np.mgrid[0 : SIZE_PX[1], 0 : SIZE_PX[0]]
    return x / 1000 + y / 100 + frame


def write_plenoptic_build(folder: Path, scene: PlenopticScene) -> Path:
    name = "Rig.Camera"
    place = folder / "cameras" / name
    place.mkdir(parents=True)
    (place / "camera.json").write_text(json.dumps(_record(scene)))
    array = scene.array
    columns = {"microlens_k": array.kl[:, 0], "microlens_l": array.kl[:, 1], "microlens_type": array.types}
    columns |= {"centre_x_px": array.centre_px[:, 0], "centre_y_px": array.centre_px[:, 1]}
    columns["radius_px"] = np.full(len(array.types), RADIUS_PX)
    write_table(place / "micro_images.csv", ["micro-images"], columns)
    for frame, pose in scene.poses.items():
        view = folder / f"frames/{frame:04d}/{name}"
        to_pinhole = rigid(np.eye(3), np.array([0.0, 0.0, -2.0]))
        write_poses(view, to_pinhole, {"Board": to_pinhole @ pose}, np.array([0.0, 0.0, 2.0 - LENS_BEHIND_STOP_MM]))
        point, k, l, kind, x, y, rho = zip(*scene.rows(frame), strict=True)
        lenses = {"microlens_k": k, "microlens_l": l, "microlens_type": kind, "rho_px": rho}
        write_rows(view, point, np.column_stack([x, y]), **lenses)
        write_exr(view / "image.exr", [Part(name="image", channels={"Y": slope_image(frame)})])
    write_target(folder, 2.0)
    write_manifest(folder)
    return folder


def _record(scene: PlenopticScene) -> dict:
    far = LENS_TO_ARRAY_MM + ARRAY_TO_SENSOR_MM
    plain = {"principal_distance_px": far / PIXEL_MM, "principal_point_px": [(n - 1) / 2 for n in SIZE_PX]}
    plain["residual_px"] = {"rms": 0.0, "max": 0.0}
    planes = [ARRAY_TO_SENSOR_MM, ARRAY_TO_SENSOR_MM]
    types = [
        {
            "focal_length_mm": f,
            "principal_planes_mm": planes,
            "depth_of_field_mm": [end - LENS_BEHIND_STOP_MM for end in FIELDS_MM[f]],
        }
        for f in scene.focal_mm
    ]
    return {
        "resolution": list(SIZE_PX),
        "pixel_pitch_mm": PIXEL_MM,
        "sensor_distance_mm": far + LENS_BEHIND_STOP_MM,
        "pinhole": {
            "centre_mm": [0.0, 0.0, 2.0 - LENS_BEHIND_STOP_MM],
            **plain,
            "with_distortion": {**plain, "distortion": [0.0] * 5},
        },
        "optical_axis_px": AXIS_PX.tolist(),
        "lens": {"efl_mm": FOCAL_MM, "f_number": F_NUMBER, "principal_planes_mm": [-LENS_BEHIND_STOP_MM] * 2},
        "mla": {"layout": scene.layout, "pitch_mm": PITCH_MM, "types": types, "distance_mm": ARRAY_TO_SENSOR_MM},
    }
