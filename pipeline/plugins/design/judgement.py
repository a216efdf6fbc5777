"""Judgement of a plenoptic camera by real rays: sharpness and resolution over depth, micro-images, views.

Distances are vision z [mm]. A view takes the pixel at the same offset from the centre of every micro-image; views move
by a number of microlenses per pixel, see `plugins.design.formulas`.
"""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.camera.micro_images.light import micro_light
from pipeline.camera.parts.camera import Camera
from pipeline.optics.first_order import first_order
from pipeline.plugins.design.formulas import refocused_mm
from pipeline.records.shapes import Float64
from pipeline.results.ready_camera import POINT, ReadyCamera

_ACCURACY_PX = 1e-4
"""Error that positions may have [px]: far less than is printed."""
_SHARES = np.linspace(-0.25, 1.25, 25)
"""Samples of the range for blur, uniform in 1 / z: a little beyond its ends, where real rays may end it."""
_LISTED_STEP, _LISTED_SLICE = 2, slice(4, 21)
"""Of these the ones that are listed: nine from end to end."""
_DEEPEST = 10.0
"""Farthest distance that is judged, over the nearest [1]: a range may end at infinity."""
_NEAR_AXIS = 4.0
"""Distance from the axis within which microlenses are used for views [pitches]: field curvature is negligible there."""
_FIELDS = np.linspace(0.0, 0.97, 6)
"""Relative field heights at which micro-images are judged [1]: at the last one no edge of the array is near."""
_VIEWS = (0.0, 0.15, 0.3)
"""Offsets of the views that are located, over the diameter of a micro-image [1]: central, and well inside its edge."""
_WIDENING = {"hexagonal": math.sqrt(10) / 3, "hexagonal-columns": math.sqrt(10) / 3, "square": 2 / math.sqrt(3)}
"""Diameter 2 sqrt(2 tr) of the disc with the second moments of a cell, over its width across flats [1], by which
circles of confusion are stated.
"""


@dataclass(frozen=True, slots=True)
class DepthRow:
    """Points on the axis at one distance."""

    z_mm: float
    micro_images: int  # of a point about the axis
    blur_px: tuple[float | None, ...]  # per type, across flats; negative before best focus; None: not seen
    lateral_mm: float | None  # object that one pixel spans, or its blur, of the type that sees it best
    depth_mm: float | None  # way along the axis that moves the outermost micro-images by one pixel to each other


@dataclass(frozen=True, slots=True)
class ViewRow:
    """Views of objects at one distance."""

    z_mm: float
    shift: float  # microlenses per pixel by which views move
    formula_mm: float  # the distance at which this shift is sharp by the formula with the exit pupil
    lateral_mm: float  # object that one microlens spans, or one pixel of it
    depth_mm: float  # way along the axis that moves outermost views by one microlens to each other


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """The centre of projection of a view."""

    view_px: float
    place_mm: tuple[float, float, float]  # nearest to all rays of the view, vision frame
    rms_mm: float  # distance of the rays from there


@dataclass(frozen=True, slots=True)
class FieldRow:
    """A micro-image at one distance from the axis."""

    from_axis_mm: float
    across_px: tuple[float, float]  # least and greatest diameter, of the light through the vertex
    gap_px: float  # from the widest of them to the next micro-image; negative: they overlap
    light: float  # area of the pupil that is seen, over that in the middle


@dataclass(frozen=True, slots=True)
class Judgement:
    """`depths` and `depth_of_field_mm` (per type; None: not met in the range) are empty for an unfocused camera."""

    depth_of_field_mm: tuple[tuple[float | None, float | None], ...]
    depths: tuple[DepthRow, ...]
    field: tuple[FieldRow, ...]
    views: tuple[ViewRow, ...]
    viewpoints: tuple[Viewpoint, ...]
    entrance_pupil_mm: float


def judged(ready: ReadyCamera, range_mm: tuple[float, float]) -> Judgement:
    """Judge a plenoptic camera over a range of distances."""
    array = ready.camera.microlenses
    assert array is not None
    near = range_mm[0]
    far = min(range_mm[1], _DEEPEST * near)
    first = -float(ready.camera.prescription.vertices_from_stop_mm[0])
    z_mm = 1 / (1 / near + _SHARES * (1 / far - 1 / near))
    is_unfocused = array.is_unfocused(ready.camera.sensor.pitch_mm)
    depths, ends = ([], ()) if is_unfocused else _over_depth(ready, z_mm[z_mm > first])
    listed = z_mm[_LISTED_SLICE][::_LISTED_STEP]
    return Judgement(
        depth_of_field_mm=ends,
        depths=tuple(row for row in depths if row.z_mm in listed),
        field=tuple(_over_field(ready)),
        views=tuple(_views(ready, listed)),
        viewpoints=tuple(_viewpoint(ready, share * array.pitch_mm / ready.camera.sensor.pitch_mm) for share in _VIEWS),
        entrance_pupil_mm=first_order(ready.camera.prescription).entrance_pupil.z_mm,
    )


def _over_depth(
    ready: ReadyCamera, z_mm: Float64[np.ndarray, "n"]
) -> tuple[list[DepthRow], tuple[tuple[float | None, float | None], ...]]:
    """Rows, and per type the range within which points blur to the circle of confusion.

    Points lie on the ray of the micro-image centre of the middle microlens of each type, which sees them whatever their
    distance; that of type 0 is close to the axis.
    """
    camera = ready.camera
    x_mm, y_mm, cells = zip(*ready.rig.middles, strict=True)
    assert camera.microlenses is not None
    rays = ready.rays(*ready.rig.tracer.pixels_at(np.column_stack([x_mm, y_mm])).T, accuracy_px=_ACCURACY_PX)
    points_mm = np.stack([rays.at_distance(z) for z in z_mm], axis=1)
    projections = [ready.project(along, accuracy_px=_ACCURACY_PX, derivatives=[POINT]) for along in points_mm]
    blur_px, px_per_mm = np.full((2, len(z_mm), len(cells)), np.nan)
    for kind, (rows, cell) in enumerate(zip(projections, cells, strict=True)):
        is_central = (rows.microlens == ready.rig.axial[cell]).all(axis=1)
        blur_px[rows.point[is_central], kind] = 2 * rows.rho_px[is_central] / _WIDENING[camera.microlenses.layout]
        px_per_mm[rows.point[is_central], kind] = np.linalg.norm(rows.derivatives[POINT][is_central, :, 0], axis=1)
    lateral_mm = np.maximum(1.0, np.abs(blur_px)) / px_per_mm
    listed = []
    for i, z in enumerate(z_mm.tolist()):
        # Disparity per mm of depth: the largest difference of two micro-images of a point
        rates = projections[0].derivatives[POINT][projections[0].point == i, :, 2]
        fastest = np.linalg.norm(rates[:, None] - rates, axis=-1).max(initial=0.0)
        listed.append(
            DepthRow(
                z_mm=z,
                micro_images=len(rates),
                blur_px=tuple(blur if math.isfinite(blur) else None for blur in blur_px[i].tolist()),
                lateral_mm=float(np.nanmin(lateral_mm[i])) if np.isfinite(lateral_mm[i]).any() else None,
                depth_mm=float(1 / fastest) if fastest > 0 else None,
            )
        )
    confusion = camera.circle_of_confusion_px
    return listed, tuple(
        (_z_of_blur(camera, z_mm, blur, -confusion), _z_of_blur(camera, z_mm, blur, confusion)) for blur in blur_px.T
    )


def _z_of_blur(camera: Camera, z_mm: np.ndarray, blur_px: np.ndarray, level_px: float) -> float | None:
    """Distance at which a blur that grows with distance takes a value; None: not in this interval.

    Between the samples blur is linear in the vergence at the array, as it is near the axis.
    """
    lens = first_order(camera.prescription)
    is_finite = np.isfinite(blur_px)
    array = camera.microlenses
    assert array is not None
    array_mm = array.distance_mm - camera.sensor_distance_mm
    blur = blur_px[is_finite]
    vergence = [1 / (array_mm - lens.image_mm(z)) for z in z_mm[is_finite]]
    if not len(blur) or not blur.min() <= level_px <= blur.max():
        return None
    return lens.object_mm(array_mm - 1 / float(np.interp(level_px, blur, vergence)))


def _over_field(ready: ReadyCamera) -> list[FieldRow]:
    """Micro-images from the middle to the edge: diameters, gaps, and the light that they receive."""
    tracer, images = ready.rig.tracer, ready.rig.images
    assert images is not None
    pitch_mm = tracer.camera.sensor.pitch_mm
    centres = images.centre_mm
    positions_mm = _FIELDS[:, None] * tracer.camera.sensor.farthest_corner_mm
    rows = np.unique(images.nearby.nearest(positions_mm)[1][:, 0])
    light = micro_light(tracer, images, rows=rows)
    radius_mm = light.pupil_mm
    diameter_px = (radius_mm + np.roll(radius_mm, radius_mm.shape[1] // 2, axis=1)) / pitch_mm
    spacing_px = images.nearby.nearest(centres[light.rows], 2)[0][:, 1] / pitch_mm
    from_axis = np.hypot(*centres[light.rows].T)
    central_mm2 = light.pupil_area_mm2[np.argmin(from_axis)]
    listed = [
        FieldRow(
            from_axis_mm=float(from_axis[i]),
            across_px=(float(diameter_px[i].min()), float(diameter_px[i].max())),
            gap_px=float(spacing_px[i] - diameter_px[i].max()),
            light=float(light.pupil_area_mm2[i] / central_mm2),
        )
        for i in np.argsort(from_axis)
    ]
    return [row for row in listed if math.isfinite(row.gap_px)]


def _views(ready: ReadyCamera, z_mm: np.ndarray) -> list[ViewRow]:
    """Rays of the views a quarter of a micro-image off centre, behind microlenses near the axis, as a linear function a
    X + b v of microlens and view: the rays of one point move by X = -b / a per view.
    """
    camera = ready.camera
    images = ready.rig.images
    array = camera.microlenses
    assert array is not None and images is not None
    vertex_mm = ready.rig.tracer.vertices_mm
    rows = np.flatnonzero(np.hypot(*vertex_mm.T) < _NEAR_AXIS * array.pitch_mm)
    diameter_px = array.pitch_mm / camera.sensor.pitch_mm
    views = diameter_px / 4 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    positions_px = (ready.rig.tracer.pixels_at(images.centre_mm[rows])[:, None] + views).reshape(-1, 2)
    microlens = np.repeat(-vertex_mm[rows] / array.pitch_mm, len(views), axis=0)  # turned by 180 degrees, as the image
    rays = ready.rays(*positions_px.T, accuracy_px=_ACCURACY_PX)
    lit = np.isfinite(rays.direction).all(axis=1)
    terms = np.stack([microlens[lit].ravel(), np.tile(views, (len(rows), 1))[lit].ravel()], axis=1)
    ends = np.stack([rays.at_distance(z)[lit, :2].ravel() for z in z_mm[[0, -1]]], axis=1)
    start, end = np.linalg.lstsq(terms, ends, rcond=None)[0].T
    slope = (end - start) / (z_mm[-1] - z_mm[0])  # rays are straight: a and b are linear in z
    a, b = start[:, None] + slope[:, None] * (z_mm - z_mm[0])
    rate = np.abs(slope[1] * a - slope[0] * b) / a**2  # of b / a over z
    lens = first_order(camera.prescription)
    lateral_mm = np.maximum(abs(a), abs(b))
    depth_mm = 1 / (rate * diameter_px)
    columns = zip(z_mm.tolist(), (-b / a).tolist(), lateral_mm.tolist(), depth_mm.tolist(), strict=True)
    return [ViewRow(z, shift, refocused_mm(lens, camera, shift), *figures) for z, shift, *figures in columns]


def _viewpoint(ready: ReadyCamera, view_px: float) -> Viewpoint:
    """The point nearest to the rays of a view, from a sample of about 200 micro-images."""
    images = ready.rig.images
    size = np.array(ready.size_px)
    assert images is not None
    centre_px = ready.rig.tracer.pixels_at(images.centre_mm)
    inside = (np.abs(centre_px - (size - 1) / 2) < 0.45 * size).all(axis=1)
    sample = centre_px[inside][:: max(1, int(inside.sum()) // 200)]
    rays = ready.rays(sample[:, 0] + view_px, sample[:, 1], accuracy_px=_ACCURACY_PX)
    point = rays.nearest_point_mm
    x, y, z = point.tolist()
    off_mm = np.linalg.norm(np.cross(rays.direction, rays.origin_mm - point), axis=1)
    return Viewpoint(view_px, (x, y, z), float(np.sqrt(np.nanmean(off_mm**2))))
