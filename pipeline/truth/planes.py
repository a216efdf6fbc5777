"""Tangent planes at target points, vision frame, as kernels read them: rows point, first axis, second axis, normal."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.motion import Motion, Shutter
from pipeline.records.shapes import Float64, Int64

_GAUSS = 0.5 / 3**0.5
"""Distance of Gauss's two nodes from the middle of an interval, over its length [1]."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """Planes at both nodes of Gauss's rule in each stretch of an exposure, and the share of each stretch: the mean over
    the exposure is the weighted mean over all. A motion is smooth in a stretch.
    """

    planes: Float64[np.ndarray, "n s 2 4 3"]
    share: Float64[np.ndarray, "n s"]

    @staticmethod
    def still(planes: Float64[np.ndarray, "n 4 3"]) -> "Pairs":
        """Planes that do not move."""
        return Pairs(np.stack([planes, planes], axis=1)[:, None], np.ones((len(planes), 1)))

    def only(self, rows: Int64[np.ndarray, "m"] | slice) -> "Pairs":
        """Those of some rows."""
        return Pairs(self.planes[rows], self.share[rows])

    @staticmethod
    def joined(parts: Sequence["Pairs"]) -> "Pairs":
        """Those of all parts; stretches that some rows lack have no share."""
        most = max((part.share.shape[1] for part in parts), default=1)
        lacking = [most - part.share.shape[1] for part in parts]
        planes = [
            np.pad(part.planes, ((0, 0), (0, count), (0, 0), (0, 0), (0, 0)), mode="edge")
            for part, count in zip(parts, lacking, strict=True)
        ]
        share = [np.pad(part.share, ((0, 0), (0, count))) for part, count in zip(parts, lacking, strict=True)]
        none = np.zeros((0, most, 2, 4, 3)), np.zeros((0, most))
        return Pairs(np.concatenate([none[0], *planes]), np.concatenate([none[1], *share]))


@dataclass(frozen=True, slots=True)
class StillPlanes:
    """Planes (p, 4, 3) that do not move."""

    planes: Float64[np.ndarray, "p 4 3"]

    def at(self, point: Int64[np.ndarray, "n"], times_s: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Planes (n, 4, 3) of points at times."""
        return self.planes[point]

    def pairs(self, point: Int64[np.ndarray, "n"], x_px: Float64[np.ndarray, "n 2"]) -> Pairs:
        """Planes of points over the exposure at image positions, which may be NaN."""
        return Pairs.still(self.planes[point])

    def instants(self, point: Int64[np.ndarray, "n"], x_px: Float64[np.ndarray, "n 2"]) -> Pairs:
        """Planes of points as in the middle of the exposure alone."""
        return Pairs.still(self.planes[point])


@dataclass(frozen=True, slots=True)
class MovingPlanes:
    """Planes (p, 4, 3) of a target, in its own frame, that move before the camera, vision_from_target."""

    of_target: Float64[np.ndarray, "p 4 3"]
    motion: Motion
    shutter: Shutter
    size_px: tuple[int, int]  # of the image

    def middle(self, point: Int64[np.ndarray, "n"], x_px: Float64[np.ndarray, "n 2"]) -> np.ndarray:
        """Planes (n, 4, 3) of points in the middle of the exposure at image positions; NaN where the position is."""
        return self.at(point, self.shutter.middle_s(x_px, self.size_px))

    def pairs(self, point: Int64[np.ndarray, "n"], x_px: Float64[np.ndarray, "n 2"]) -> Pairs:
        """As of still planes, with stretches between the times at which the motion bends; NaN where the position is."""
        middle, exposure_s = self.shutter.middle_s(x_px, self.size_px), self.shutter.exposure_s
        first, end = middle - exposure_s / 2, middle + exposure_s / 2
        bends = np.array([[time for time in self.motion.edges_s if ((first < time) & (time < end)).any()]])
        ends = np.sort(np.clip(bends, first[:, None], end[:, None]), axis=1)
        edges = np.concatenate([first[:, None], ends, end[:, None]], axis=1)
        length = np.diff(edges, axis=1)
        share = length / exposure_s if ends.shape[1] else np.ones((len(x_px), 1))
        middles, half = (edges[:, 1:] + edges[:, :-1]) / 2, _GAUSS * length
        times = np.stack([middles - half, middles + half], axis=2)
        planes = self.at(np.repeat(point, 2 * share.shape[1]), times.ravel())
        return Pairs(planes.reshape(*times.shape, 4, 3), share)

    def instants(self, point: Int64[np.ndarray, "n"], x_px: Float64[np.ndarray, "n 2"]) -> Pairs:
        """As of still planes."""
        return self.stills(point, self.shutter.middle_s(x_px, self.size_px))

    def stills(self, point: Int64[np.ndarray, "n"], times_s: Float64[np.ndarray, "n"]) -> Pairs:
        """Planes of points as at times alone."""
        return Pairs.still(self.at(point, times_s))

    def at(self, point: Int64[np.ndarray, "n"], times_s: Float64[np.ndarray, "n"]) -> np.ndarray:
        """As of still planes."""
        pose = self.motion.at(times_s)
        planes: np.ndarray = np.einsum("nij,nkj->nki", pose[:, :3, :3], self.of_target[point])
        planes[:, 0] += pose[:, :3, 3]
        return planes


def tangent_planes(
    vision_from_target: Float64[np.ndarray, "4 4"],
    points_mm: Float64[np.ndarray, "p 3"],
    axes: Float64[np.ndarray, "p 3 3"] | None = None,
) -> np.ndarray:
    """Tangent planes for the kernels, (p, 4, 3), at points of a target; by default those of a flat one."""
    planes = np.empty((len(points_mm), 4, 3))
    planes[:, 0] = points_mm @ vision_from_target[:3, :3].T + vision_from_target[:3, 3]
    turn = vision_from_target[:3, :3]
    planes[:, 1:] = turn.T if axes is None else (turn @ axes).transpose(0, 2, 1)
    return planes


Planes = StillPlanes | MovingPlanes
"""Tangent planes of points, as they are while an image position is exposed."""


def faces_camera(planes: Float64[np.ndarray, "n 4 3"]) -> np.ndarray:
    """Whether the front of each plane (p, 4, 3) faces the centre of the aperture stop, (p,) bool."""
    return np.einsum("pi,pi->p", planes[:, 0], planes[:, 3]) < 0


def axes_across(normals: Float64[np.ndarray, "n 3"]) -> np.ndarray:
    """Axes of planes by rows, (n, 3, 3): first, second, and the direction of the normals, which are of any length."""
    normal = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    second = np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.5, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]))
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([np.cross(second, normal), second, normal], axis=1)


def plane_name(target: str, number: int, planes: int) -> str:
    """Name of the position image of a tangent plane: that of the target, with a number if it has several."""
    return target if planes == 1 else f"{target}.{number}"
