"""Refocusing an unfocused plenoptic camera: at which distance does the sum of shifted views become sharp, and where are
the viewpoints of its views?

Views are numbered by the pixel that they take from each micro-image, counted from its centre; shift S is how many
microlenses an image point moves from one view to the next. Rays answer without a model. Two formulas are beside them:
both have the principal planes of the lens; one knows its exit pupil (Michels, Mäckelmann, Koch 2024), the other takes
the pupil to be in the rear principal plane, as a thin lens has it.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from truth import Truth

from pipeline.camera.figures.first_order_figures import report
from pipeline.results.ready_camera import ReadyCamera

_Z_MM = (250.0, 350.0, 450.0, 600.0, 900.0, 2000.0)
_VIEWS_PX = (0.5, 2.0, 4.0)
"""Distances, and views whose rays are asked for them."""
_NEAR_MM = 0.7
"""Distance from the axis within which microlenses are asked [mm]: so near, curvature of field is nothing."""


@dataclass(frozen=True, slots=True)
class Bench:
    """First-order optics."""

    focal_mm: float
    front_z_mm: float  # vision z of the front principal plane
    pupil_z_mm: float  # vision z of the entrance pupil
    to_rear_mm: float  # from the microlenses to the rear principal plane
    to_pupil_mm: float  # from the microlenses to the exit pupil
    array_mm: float  # from the microlenses to the stop
    gap_mm: float
    pitch_mm: float
    pixel_mm: float

    def distance_mm(self, shift: np.ndarray | float, to_pupil_mm: float) -> np.ndarray:
        """Vision z that a shift of views makes sharp, of a camera whose exit pupil is so far from the microlenses.

        A line from pupil point u to microlens X passes the place z' before the microlenses at X + (u - X) z' / P; for
        one image point that is the same for all u, so that dX / du = - z' / (P - z'). From view to view u moves by
        pixel P / gap.
        """
        step_mm = self.pixel_mm * to_pupil_mm / self.gap_mm
        ratio = shift * self.pitch_mm / step_mm
        before_mm = ratio * to_pupil_mm / (1 + ratio)
        image_mm = self.to_rear_mm - before_mm
        return np.asarray(self.front_z_mm + image_mm * self.focal_mm / (image_mm - self.focal_mm))


def bench(truth: Truth) -> Bench:
    """First-order optics of a camera."""
    ready, rig = truth.ready, truth.rig
    lens = report(ready.camera)["lens"]
    array_mm = ready.camera.sensor_distance_mm - rig.gap_mm
    front, rear = lens["principal_planes_mm"]
    return Bench(
        focal_mm=lens["efl_mm"],
        front_z_mm=front,
        pupil_z_mm=lens["entrance_pupil"]["z_mm"],
        to_rear_mm=array_mm + rear,
        to_pupil_mm=array_mm + lens["exit_pupil"]["z_mm"],
        array_mm=array_mm,
        gap_mm=rig.gap_mm,
        pitch_mm=rig.pitch_mm,
        pixel_mm=rig.pixel_mm,
    )


def refocused(truth: Truth) -> dict[str, Any]:
    """Distances of refocusing by rays and formulas, and viewpoints."""
    optics, rows, views = bench(truth), [], []
    for view in _VIEWS_PX:
        for z_mm, shift in zip(_Z_MM, shifts(truth, view), strict=True):
            if shift is None:  # a dark view: its pixels lie beyond the image of the pupil
                continue
            pupil, thin = (float(optics.distance_mm(shift, p)) for p in (optics.to_pupil_mm, optics.to_rear_mm))
            rows.append({"view_px": view, "z_mm": z_mm, "shift": shift, "pupil_mm": pupil, "thin_mm": thin})
    for view in (0.0, 2.0, 4.0):
        place, rms = viewpoint_mm(truth.ready, truth.centre_px, (view, 0.0))
        if np.isfinite(rms):
            views.append({"view_px": view, "place_mm": place.tolist(), "rms_mm": rms})
    return {"rows": rows, "entrance_pupil_z_mm": optics.pupil_z_mm, "viewpoints": views}


def shifts(truth: Truth, view_px: float) -> list[float] | list[None]:
    """Microlenses per view that the image of a point at each distance moves: by rays of views at a distance from the
    middle one, behind microlenses near the axis; None of a dark view.

    Rays cross a plane at a X + b v; those of one point cross it there, so that X moves by - b / a per view.
    """
    near = np.hypot(*truth.vertex_mm.T) < _NEAR_MM
    views = view_px * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    places = (truth.centre_px[near][:, None] + views).reshape(-1, 2)
    microlens = -truth.vertex_mm[near] / truth.rig.pitch_mm  # as in the image: turned by 180 degrees
    terms = np.stack(
        [np.repeat(microlens, len(views), axis=0).ravel(), np.tile(views, (near.sum(), 1)).ravel()], axis=1
    )
    rays, moves = truth.ready.rays(*places.T, accuracy_px=1e-6), []
    if not np.isfinite(rays.direction).all():
        return [None] * len(_Z_MM)
    for z_mm in _Z_MM:
        a, b = np.linalg.lstsq(terms, rays.at_distance(z_mm)[:, :2].ravel(), rcond=None)[0]
        moves.append(float(-b / a))
    return moves


def asked(truth: Truth, answer: dict[str, Any]) -> dict[str, Any]:
    """The same questions for programs: first-order optics, pairs of shift and view, and views."""
    pairs = [(row["shift"], row["view_px"]) for row in answer["rows"]]
    return {
        "bench": asdict(bench(truth)),
        "refocused": pairs,
        "views": [one["view_px"] for one in answer["viewpoints"]],
    }


def coded_image(truth: Truth) -> np.ndarray:
    """An image whose pixels say where they lie against the centre of their micro-image, x and y [px], and 1, (h, w, 3).

    What a program that cuts views takes from it says which view it is.
    """
    width, height = truth.rig.size_px
    places = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    _, nearest = cKDTree(truth.centre_px).query(places)
    values = np.concatenate([places - truth.centre_px[nearest], np.ones((len(places), 1))], axis=1)
    return values.reshape(height, width, 3)


def viewpoint_mm(ready: ReadyCamera, centre_px: np.ndarray, view_px: Sequence[float]) -> tuple[np.ndarray, float]:
    """Point nearest to the rays of a view, vision frame (3,), and the rays' root mean square distance from it [mm]; NaN
    of a dark view."""
    size = np.array([ready.camera.sensor.width_px, ready.camera.sensor.height_px])
    inside = (np.abs(centre_px - (size - 1) / 2) < 0.45 * size).all(axis=1)
    chosen = centre_px[inside][::7] + view_px
    rays = ready.rays(*chosen.T, accuracy_px=1e-4)
    lit = np.isfinite(rays.direction).all(axis=1)
    if lit.sum() < 2:
        return np.full(3, np.nan), float("nan")
    along, origin = rays.direction[lit], rays.origin_mm[lit]
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    point = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, origin))
    off = np.einsum("nij,nj->ni", across, origin - point)
    return point, float(np.sqrt((off**2).sum(axis=1).mean()))
