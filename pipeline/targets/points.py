"""Target points: what the ground truth needs of a target, for every pattern and surface.

Each point has its own tangent plane. Points with a common plane (those of a board, or of a face of a cube) form one
`TangentPlane`, so that its position image is computed only once.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.frames import apply, inverse, rigid
from pipeline.records.shapes import Float64, Int64


@dataclass(frozen=True, slots=True)
class TangentPlane:
    """A plane, z its normal out of the front, and the points at which it touches the surface.

    The points are given by their indices and by positions in the frame of the plane.
    """

    target_from_plane: Float64[np.ndarray, "4 4"]
    members: Int64[np.ndarray, "k"]
    points_mm: Float64[np.ndarray, "k 3"]


@dataclass(frozen=True, slots=True)
class TargetPoints:
    """Points of a target in the order of their ids: the index is the id."""

    # on the surface, and on the nominal flat board of a warped one, target frame
    position_mm: Float64[np.ndarray, "n 3"]
    nominal_mm: Float64[np.ndarray, "n 3"]
    # columns: x and y along the surface, and the normal out of its front, target frame
    axes: Float64[np.ndarray, "n 3 3"]
    curvature_per_mm: Float64[np.ndarray, "n"]  # largest curvature of the surface there, without sign
    kinds: list[str]  # see `pattern.Marks`
    radius_mm: Float64[np.ndarray, "n"]  # of the disc around the point; NaN without a disc
    # index of the tangent plane of each point, and target_from_plane of all planes
    plane: Int64[np.ndarray, "n"]
    frames: Float64[np.ndarray, "p 4 4"]

    @property
    def plane_axes(self) -> np.ndarray:
        """Columns: x and y of the tangent plane of each point, and its normal, target frame, (n, 3, 3)."""
        return self.frames[self.plane][:, :3, :3]

    def planes(self) -> list[TangentPlane]:
        """The tangent planes, in the order of their numbers."""
        planes = []
        for number, frame in enumerate(self.frames):
            members = np.flatnonzero(self.plane == number)
            points_mm = apply(inverse(frame), self.position_mm[members])
            points_mm[:, 2] = 0.0
            planes.append(TangentPlane(frame, members, points_mm))
        return planes

    @staticmethod
    def joined(parts: list["TargetPoints"]) -> "TargetPoints":
        """Points of several parts, one after the other; planes are renumbered."""
        first = np.cumsum([0, *(len(part.frames) for part in parts)])
        arrays = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in ("position_mm", "nominal_mm", "axes", "curvature_per_mm", "radius_mm", "frames")
        }
        return TargetPoints(
            kinds=[kind for part in parts for kind in part.kinds],
            plane=np.concatenate([part.plane + offset for part, offset in zip(parts, first, strict=False)]),
            **arrays,
        )


def frames_at(position_mm: Float64[np.ndarray, "n 3"], axes: Float64[np.ndarray, "n 3 3"]) -> np.ndarray:
    """target_from_plane of a separate plane for every point, (n, 4, 4)."""
    return np.array([rigid(turn, origin) for turn, origin in zip(axes, position_mm, strict=True)]).reshape(-1, 4, 4)
