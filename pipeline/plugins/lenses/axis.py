"""Surfaces of a file about one axis, in an order in which light can meet them.

Lens-design programs place each surface behind the one before, in a frame that may be decentred and tilted, and insert
dummy surfaces without power to inspect the light.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.frames import inverse, rigid
from pipeline.optics.prescription import PrescriptionError, least_gap_mm
from pipeline.optics.printed import Lost, PrintedLens, PrintedSurface, surface_of
from pipeline.plugins.lenses.text import UnreadableLens

_TOUCH_MM = 1e-9
"""Overlap of surfaces that counts as touching [mm], as in `pipeline check`."""
_POINT_MM = 1e-9
"""Semi-diameter of a surface that states none."""
_DIGITS = 10
"""Decimals of millimetres and degrees beyond which a chain of rotations leaves rounding errors."""


def is_possible(surfaces: Sequence[PrintedSurface]) -> bool:
    """Whether no surface reaches beyond its sphere, or across the next one, within the clear apertures."""
    try:
        shapes = [surface_of(replace(s, semi_diameter_mm=s.semi_diameter_mm or _POINT_MM)) for s in surfaces]
    except PrescriptionError:
        return False
    return all(least_gap_mm(front, behind) >= -_TOUCH_MM for front, behind in pairwise(shapes))


def frame(x_mm: float, y_mm: float, z_mm: float, *turns_deg: float) -> np.ndarray:
    """The frame at a point of another, turned about x, then its new y and its newest z, right-handed, (4, 4)."""
    from scipy.spatial.transform import Rotation  # few files turn anything

    turn = Rotation.from_euler("XYZ", turns_deg or (0.0, 0.0, 0.0), degrees=True)
    return rigid(turn.as_matrix(), np.array([x_mm, y_mm, z_mm]))


def _point_and_turns(pose: np.ndarray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The point [mm] and the turns [degrees] of a frame, as `frame` takes them."""
    from scipy.spatial.transform import Rotation

    turns_deg = Rotation.from_matrix(pose[:3, :3]).as_euler("XYZ", degrees=True)
    point_mm, turns_deg = (tuple((np.round(values, _DIGITS) + 0.0).tolist()) for values in (pose[:3, 3], turns_deg))
    return point_mm, turns_deg  # + 0.0 turns -0.0 into 0.0


def about_one_axis(path: str | Path, lens: PrintedLens, frames: Sequence[np.ndarray]) -> PrintedLens:
    """The lens with decentres and tilts against the axis that most of its surfaces share, and remarks on these.

    A roll about its own axis matters only to a surface that is a cylinder, or whose aperture has widths.

    `frames`: (4, 4) [mm], of each surface and last of the image plane, in any common frame.
    """

    def shares_axis(one: np.ndarray, other: np.ndarray) -> bool:
        """Whether the z axis of a frame lies on that of another."""
        relative = inverse(one) @ other
        return not np.round([*relative[:2, 3], *relative[:2, 2]], _DIGITS).any()

    common = max(frames[:-1], key=lambda candidate: sum(shares_axis(candidate, other) for other in frames[:-1]))
    placements = [_point_and_turns(inverse(common) @ pose) for pose in frames]
    surfaces = []
    for i, surface in enumerate(lens.surfaces):
        (x, y, z), (*tilt_deg, roll_deg) = placements[i]
        if surface.is_cylinder and roll_deg % 180:
            raise UnreadableLens(path, f"surface {i + 1} is a cylinder, turned about the axis by {roll_deg:g} degrees")
        turned_deg = surface.aperture_rotation_deg + (roll_deg if surface.half_widths_mm else 0.0)
        gap_mm = round(placements[i + 1][0][2] - z, _DIGITS)
        placed = replace(surface, thickness_mm=gap_mm, decentre_mm=(x, y), tilt_deg=(tilt_deg[0], tilt_deg[1]))
        surfaces.append(replace(placed, aperture_rotation_deg=turned_deg))
    off_axis_count = sum(any((*surface.decentre_mm, *surface.tilt_deg)) for surface in surfaces)
    lost = list[Lost]()
    if off_axis_count:
        effect = "focal length and pupils are those of the lens with all in line"
        lost.append(Lost(f"decentred or tilted surfaces: {off_axis_count}; {effect}"))
    (x, y, _), (about_x, about_y, _) = placements[-1]
    if any((x, y, about_x, about_y)):
        statement = (
            f"the image plane is {x:g}, {y:g} mm off the axis, turned by {about_x:g} and {about_y:g} degrees about x, y"
        )
        lost.append(Lost(f"{statement}: the camera says where the sensor is"))
    return replace(lens, surfaces=tuple(surfaces), lost=(*lens.lost, *lost))


def in_order(lens: PrintedLens, is_sized: bool) -> PrintedLens:
    """The lens without the dummy surfaces that stand behind or across their neighbours or have no width.

    `is_sized`: whether the file has a beam from which semi-diameters are computed.
    """
    surfaces = list(lens.surfaces)
    lost = list[Lost]()

    def is_idle(i: int) -> bool:
        """Whether a surface can be left out: it bends nothing, is no stop, and has no width or overlaps a neighbour."""
        surface = surfaces[i]
        near = surfaces[max(i - 1, 0) : i + 2]
        bends = surface.index != (surfaces[i - 1].index if i else 1.0) or surface.focal_length_mm is not None
        is_lost = surface.semi_diameter_mm is None and not is_sized
        goes_back = any(neighbour.thickness_mm < 0 for neighbour in near[:-1]) or not is_possible(near)
        return not bends and not surface.is_stop and (is_lost or goes_back)

    while (i := next(filter(is_idle, range(len(surfaces))), None)) is not None:
        behind_mm = surfaces.pop(i).thickness_mm
        if i:  # the surface before it goes on to the next one
            surfaces[i - 1] = replace(surfaces[i - 1], thickness_mm=surfaces[i - 1].thickness_mm + behind_mm)
    if count := len(lens.surfaces) - len(surfaces):
        lost.append(Lost(f"surfaces that bend nothing, and stand in another's way or have no width: {count} left out"))
    if surfaces and surfaces[-1].thickness_mm < 0:
        lost.append(Lost(f"the image lies {-surfaces[-1].thickness_mm:g} mm before the last surface"))
        surfaces[-1] = replace(surfaces[-1], thickness_mm=0.0)
    return replace(lens, surfaces=tuple(surfaces), lost=(*lens.lost, *lost)) if lost else lens
