"""The camera models of the contestants, written from their papers and sources: where do they image a point?

Each is a `truth.Model`: points of its own frame through microlenses of the true array, by number.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

_SAME_PX = 2.0
"""Distance within which two centres are those of one micro-image [px]: a tenth of a pitch."""


@dataclass(frozen=True, slots=True)
class Projective:
    """The model of Bok et al. 2017 and Nousias et al. 2017: corner - centre = (f X - Z (centre - c)) / (K1 Z + K2).

    X is (x, y) of the point and Z its distance; f and c are a focal length and a principal point in pixels, K1 and K2
    [mm] stand for the distances of lens, array and sensor. Centres are those that they were given.
    """

    k1: float
    k2_mm: float
    focal_px: np.ndarray
    principal_px: np.ndarray
    centre_px: np.ndarray

    def project(self, points_mm: np.ndarray, microlens: np.ndarray) -> np.ndarray:
        """Positions (n, 2) of points (n, 3) through microlenses (n,) [px]."""
        centre, depth = self.centre_px[microlens], points_mm[:, 2:]
        off = self.focal_px * points_mm[:, :2] - depth * (centre - self.principal_px)
        return np.asarray(centre + off / (self.k1 * depth + self.k2_mm))


def projective(values: np.ndarray, centre_px: np.ndarray) -> Projective:
    """The model of K1, K2, fx, fy, cx, cy."""
    return Projective(values[0], values[1], values[2:4], values[4:6], centre_px)


def projective_of_thin_lens(thin: np.ndarray, origin_px: np.ndarray, pixel_mm: float) -> dict[str, float]:
    """Parameters of the same model that say what a thin lens does, (F, D, d, ...): from similar triangles."""
    focal, to_array, gap = thin[:3]
    to_sensor = to_array + gap
    return {
        "K1": -to_sensor * (to_array - focal) / (gap * focal),
        "K2_mm": to_sensor * to_array / gap,
        "fx_px": to_sensor / pixel_mm,
        "fy_px": to_sensor / pixel_mm,
        "cx_px": float(origin_px[0]),
        "cy_px": float(origin_px[1]),
    }


@dataclass(frozen=True, slots=True)
class ThinLensMesh:
    """libpleno's: a thin lens with distortion before a mesh of pinholes and a sensor, both with poses.

    `node_mm` (m, 3) are the pinholes in the camera's frame, which looks along z with the lens in its origin;
    `sensor_from_camera` (4, 4). A pixel is last - x / scale of the sensor's own x. pleno/geometry of libpleno 48db282.
    """

    focal_mm: float
    radial: np.ndarray
    tangential: np.ndarray
    node_mm: np.ndarray
    sensor_from_camera: np.ndarray
    scale_mm: float
    last_px: np.ndarray

    def project(self, points_mm: np.ndarray, microlens: np.ndarray) -> np.ndarray:
        """Positions (n, 2) of points (n, 3) through microlenses (n,) [px]."""
        image = points_mm * (-self.focal_mm / (np.abs(points_mm[:, 2:]) - self.focal_mm))
        x, y = image[:, 0], image[:, 1]
        r2 = x * x + y * y
        stretch = r2 * (self.radial[0] + r2 * (self.radial[1] + r2 * self.radial[2]))
        b0, b1 = self.tangential[:2]
        shift = [b0 * (r2 + 2 * x * x) + 2 * b1 * x * y, b1 * (r2 + 2 * y * y) + 2 * b0 * x * y]
        image[:, :2] += image[:, :2] * stretch[:, None] + np.stack(shift, axis=1)
        turn, origin = self.sensor_from_camera[:3, :3], self.sensor_from_camera[:3, 3]
        node = self.node_mm[microlens] @ turn.T + origin
        image = image @ turn.T + origin
        hit = node + (image - node) * (node[:, 2:] / (node[:, 2:] - image[:, 2:]))
        return np.asarray(self.last_px - hit[:, :2] / self.scale_mm)


def libpleno(camera: dict[str, Any], index: np.ndarray, rows: np.ndarray) -> ThinLensMesh:
    """The model of an intrinsics.js, of a square lattice or a hexagonal one in rows: numbers (k, l) of micro-images
    (c, 2), rows of the true microlenses in them."""
    mesh, sensor = camera["mla"]["mesh"], camera["sensor"]
    array, (pitch_x, pitch_y) = _pose(mesh["pose"]), np.array(mesh["pitch"][0], float)
    column, row = (np.array([mesh["width"], mesh["height"]], int) - 1 - index).T
    is_hexagonal = int(mesh["geometry"]) == 1
    x = pitch_x * (column + is_hexagonal * 0.5 * (row % 2 == 0))
    y = pitch_y * row * (np.sqrt(0.75) if is_hexagonal else 1.0)
    nodes = np.stack([x, y, np.zeros(len(x))], axis=1) @ array[:3, :3].T + array[:3, 3]
    nodes = np.where((rows >= 0)[:, None], nodes[rows], np.nan)
    return ThinLensMesh(
        float(camera["main_lens"]["f"]),
        np.array(camera["distortions"]["radial"][0], float),
        np.array(camera["distortions"]["tangential"][0], float),
        nodes,
        np.linalg.inv(_pose(sensor["pose"])),
        float(sensor["scale"]),
        np.array([sensor["width"], sensor["height"]], float) - 1,
    )


def libpleno_values(camera: dict[str, Any]) -> dict[str, float]:
    """The numbers of an intrinsics.js that say most."""
    return {
        "focal_mm": float(camera["main_lens"]["f"]),
        "main_lens_mm": float(camera["D"]),
        "sensor_mm": float(camera["d"]),
    } | {f"f{n}_mm": float(value) for n, value in enumerate(np.ravel(camera["mla"]["focal_lengths"]))}


def libpleno_types(count: int, index: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Which of so many types the true microlenses are to libpleno, by its rule for hexagonal rows
    (processing/tools/lens.h), which counts from the first micro-image; -1 where it knows none."""
    k, l = index.T
    kind = (l % (count - 1) + k) % count if count > 1 else np.zeros(len(index), int)
    return np.where(rows >= 0, kind[rows], -1)


def camera_from_board(pose: dict[str, Any]) -> np.ndarray:
    """A pose of libpleno, which takes the camera's frame to the board's, the other way round, (4, 4)."""
    return np.asarray(np.linalg.inv(_pose(pose)))


def _pose(pose: dict[str, Any]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.array(pose["rotation"], float).T, np.array(pose["translation"][0], float)
    return matrix


def rows_at(centre_px: np.ndarray, places_px: np.ndarray) -> np.ndarray:
    """Row of the micro-image of `places_px` (m, 2) at each true centre (n, 2); -1 where it has none."""
    distance, rows = cKDTree(places_px).query(centre_px, distance_upper_bound=_SAME_PX)
    return np.where(np.isfinite(distance), rows, -1)
