"""Tangent planes at target points, vision frame, as kernels read them: rows point, first axis, second axis, normal."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.motion import Motion, Shutter
from pipeline.records.shapes import Float64, Int64

_GAUSS = 0.5 / 3**0.5
"""Distance of the two Gauss nodes from the middle of an interval, over its length [1]."""
_INSTANT = Shutter()
"""The shutter of a frame that is exposed at the instant of its time code."""


@dataclass(frozen=True, slots=True)
class PlanePair:
    """Two planes of each bundle, at the two nodes of a Gauss rule in a stretch of its exposure."""

    near: Float64[np.ndarray, "n 4 3"]
    far: Float64[np.ndarray, "n 4 3"]

    @staticmethod
    def twice(planes: Float64[np.ndarray, "n 4 3"]) -> "PlanePair":
        """A pair of equal planes."""
        return PlanePair(planes, planes)

    @property
    def both(self) -> np.ndarray:
        """The planes in the layout of kernels, (n, 2, 4, 3)."""
        return np.stack([self.near, self.far], axis=1)

    def only(self, rows: Int64[np.ndarray, "m"] | slice) -> "PlanePair":
        """The pairs of these bundles."""
        return PlanePair(self.near[rows], self.far[rows])


@dataclass(frozen=True, slots=True)
class Exposed:
    """Planes over an exposure: a weighted mean over stretches, within each of which a motion is smooth.

    A still target has one stretch, of weight 1.
    """

    stretches: tuple[PlanePair, ...]
    weights: Float64[np.ndarray, "n s"]

    @staticmethod
    def still(planes: Float64[np.ndarray, "n 4 3"]) -> "Exposed":
        """Planes of points that do not move."""
        return Exposed((PlanePair.twice(planes),), np.ones((len(planes), 1)))

    @property
    def first(self) -> PlanePair:
        """The planes of the first stretch."""
        return self.stretches[0]

    def only(self, rows: Int64[np.ndarray, "m"] | slice) -> "Exposed":
        """The planes of these bundles."""
        return Exposed(tuple(pair.only(rows) for pair in self.stretches), self.weights[rows])

    @staticmethod
    def joined(parts: Sequence["Exposed"]) -> "Exposed":
        """The planes of all parts; stretches that some rows lack have weight 0."""
        # Repeat the last stretch of the parts with fewer of them.
        count = max((len(part.stretches) for part in parts), default=1)
        padded = [(*part.stretches, *[part.stretches[-1]] * (count - len(part.stretches))) for part in parts]
        # Begin with arrays of no rows, so that no parts at all make planes without rows.
        no_planes = np.zeros((0, 4, 3))
        stretches = []
        for number in range(count):
            near = np.concatenate([no_planes, *(part[number].near for part in padded)])
            far = np.concatenate([no_planes, *(part[number].far for part in padded)])
            stretches.append(PlanePair(near, far))
        weights = [np.zeros((0, count))]
        weights += [np.pad(part.weights, ((0, 0), (0, count - part.weights.shape[1]))) for part in parts]
        return Exposed(tuple(stretches), np.concatenate(weights))


@dataclass(frozen=True, slots=True)
class Planes:
    """Tangent planes (p, 4, 3) of points during the exposure of image positions.

    In the vision frame or, if there is a motion vision_from_target, in the target frame.
    """

    of_points: Float64[np.ndarray, "p 4 3"]
    motion: Motion | None = None
    shutter: Shutter = _INSTANT
    size_px: tuple[int, int] = (1, 1)  # of the image

    @property
    def moves(self) -> bool:
        """Whether they move relative to the camera."""
        return self.motion is not None

    def middle_s(self, x_px: Float64[np.ndarray, "n 2"]) -> np.ndarray:
        """Middle of the exposure at image positions, (n,) [s]."""
        return self.shutter.middle_s(x_px, self.size_px)

    def at(self, point: Int64[np.ndarray, "n"], times_s: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Planes (n, 4, 3) of points at times."""
        if self.motion is None:
            return self.of_points[point]
        pose = self.motion.at(times_s)
        planes: np.ndarray = np.einsum("nij,nkj->nki", pose[:, :3, :3], self.of_points[point])
        planes[:, 0] += pose[:, :3, 3]
        return planes

    def middle(self, point: Int64[np.ndarray, "n"], x_px: Float64[np.ndarray, "n 2"]) -> np.ndarray:
        """Planes (n, 4, 3) of points in the middle of the exposure at image positions; NaN for moving ones at NaN."""
        return self.at(point, self.middle_s(x_px))

    def exposed(self, point: Int64[np.ndarray, "n"], x_px: Float64[np.ndarray, "n 2"]) -> Exposed:
        """Planes of points over the exposure at image positions, in stretches between the kinks of their motion.

        NaN for moving planes at NaN positions.
        """
        if self.motion is None:
            return Exposed.still(self.of_points[point])
        middle = self.middle_s(x_px)
        exposure_s = self.shutter.exposure_s
        first = middle - exposure_s / 2
        end = middle + exposure_s / 2
        # Cut the exposure of each position, (n,), at the kinks within any of them; a kink outside cuts at an end.
        kinks = np.array([[time for time in self.motion.edges_s if ((first < time) & (time < end)).any()]])
        cuts = np.sort(np.clip(kinks, first[:, None], end[:, None]), axis=1)
        edges = np.concatenate([first[:, None], cuts, end[:, None]], axis=1)
        # Take the planes at the two Gauss nodes of each stretch, and weigh it by its length.
        length = np.diff(edges, axis=1)
        middles = (edges[:, 1:] + edges[:, :-1]) / 2
        nodes = zip((middles - _GAUSS * length).T, (middles + _GAUSS * length).T, strict=True)
        pairs = tuple(PlanePair(self.at(point, early), self.at(point, late)) for early, late in nodes)
        return Exposed(pairs, length / exposure_s if cuts.shape[1] else np.ones((len(x_px), 1)))


def tangent_planes(
    vision_from_target: Float64[np.ndarray, "4 4"],
    points_mm: Float64[np.ndarray, "p 3"],
    axes: Float64[np.ndarray, "p 3 3"] | None = None,
) -> np.ndarray:
    """Tangent planes for the kernels, (p, 4, 3), at points of a target; without `axes` those of a flat target."""
    planes = np.empty((len(points_mm), 4, 3))
    planes[:, 0] = points_mm @ vision_from_target[:3, :3].T + vision_from_target[:3, 3]
    rotation = vision_from_target[:3, :3]
    planes[:, 1:] = rotation.T if axes is None else (rotation @ axes).transpose(0, 2, 1)
    return planes


def faces_camera(planes: Float64[np.ndarray, "n 4 3"]) -> np.ndarray:
    """Whether the front of each plane (p, 4, 3) faces the centre of the aperture stop, (p,) bool."""
    return np.einsum("pi,pi->p", planes[:, 0], planes[:, 3]) < 0


def axes_across(normals: Float64[np.ndarray, "n 3"]) -> np.ndarray:
    """Axes of planes by rows, (n, 3, 3): first, second, and the unit normal; `normals` may have any length."""
    normal = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    second = np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.5, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]))
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([np.cross(second, normal), second, normal], axis=1)


def plane_name(target: str, number: int, planes: int) -> str:
    """Name of the position image of a tangent plane: that of the target, with a number if there are several."""
    return target if planes == 1 else f"{target}.{number}"
