"""Plausibility warnings: valid values that suggest a unit error."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.boundary import halved
from pipeline.camera.focusing.focus_request import matched_stop_mm, widest_stop_mm
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.lattice import lattice
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.pupil.chief_ray import TOO_WIDE, chief_heights
from pipeline.camera.pupil.from_stop import pupil_fan
from pipeline.camera.tracer import Tracer
from pipeline.frames import apply, inverse
from pipeline.optics.first_order import first_order
from pipeline.optics.rays import GRID, dot, front_grid, traced
from pipeline.optics.table import motion_of, unbounded
from pipeline.optics.windows import parted

_PITCHES_MM = (2e-4, 0.5)
"""Pixel pitches that raise no warning [mm]: wider than half a wavelength of light, narrower than half a millimetre."""
_WEAK_F_NUMBER = 100.0
"""F-number beyond which a microlens bends light by less than its own diffraction does."""
_TOO_WIDE, _TOO_SMALL, _OVERLAP, _GAPS = 1.25, 0.95, 1.05, 0.55
"""Ratios beyond which a warning is due: stop over the beam that the lens passes, array over sensor, micro-image over
the pitch of micro-images. These may leave gaps: those of a real Raytrix R12 at F/4 are 0.59 of the pitch wide."""
_CIRCULAR = 0.5
"""Least radius of a wide field's image circle over the distance of the corner [1]. Such a circle may lie within the
sensor: that of 21.6 mm of the Nikkor ends half way on 24 x 36 mm."""
_ZOOMS = 5
"""Number of grids, each 4 / `GRID` as wide as the one before: meshes of the last are some 1e-7 of the surface's
radius."""
_HALVINGS = 12
"""Bisections towards a dark corner: to 1/4096 of its distance, and the message has four digits."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """A plausibility warning: a stable code, a message and a remedy."""

    code: str
    part: str  # camera, stop, sensor, image, windows, microlenses or focal_lengths
    message: str
    hint: str


def doubts(camera: Camera) -> Iterator[Doubt]:
    """List the warnings about a focused camera.

    Raises CameraError: no chief ray leaves from the corner of the sensor or array, so the camera cannot be traced.
    """
    yield from pixel_doubts(camera.sensor)
    yield from _stop(camera)
    if camera.microlenses:
        yield from _microlenses(camera, camera.microlenses)
    yield from _image_circle(camera)


def pixel_doubts(sensor: Sensor) -> Iterator[Doubt]:
    """List the warnings about a sensor alone."""
    pitch, (width, height) = sensor.pitch_mm, sensor.size_mm
    if not _PITCHES_MM[0] <= pitch <= _PITCHES_MM[1]:
        message = f"pixels of {pitch:g} mm make a sensor of {width:.4g} x {height:.4g} mm"
        yield Doubt("pixel-pitch", "sensor", message, "lengths are millimetres: 20 µm are 0.02")


def _stop(camera: Camera) -> Iterator[Doubt]:
    """Warn of a stop so wide that other surfaces limit the light."""
    lens = first_order(camera.prescription)
    stop_mm = 2 * camera.prescription.stop.semi_diameter_mm
    ahead_mm = camera.microlenses.principal_mm[0][1] if camera.microlenses else 0.0
    widest_mm = widest_stop_mm(camera.prescription, camera.sensor_distance_mm - ahead_mm)
    if stop_mm > _TOO_WIDE * widest_mm:
        message = (
            f"the stop is {stop_mm:.4g} mm wide, F/{lens.f_number:.3g}, and the lens around it lets through"
            f" {widest_mm:.4g} mm, F/{lens.f_number * stop_mm / widest_mm:.3g}"
        )
        hint = "edges of other surfaces cut the light before the stop does: is plen:semiDiameter half of its diameter?"
        yield Doubt("wide-stop", "stop", message, hint)


def _microlenses(camera: Camera, array: MicrolensArray) -> Iterator[Doubt]:
    """Warn of microlenses whose pitch, focal length, extent or micro-images do not suit the sensor."""
    lens = first_order(camera.prescription)
    width, height = camera.sensor.size_mm
    behind, ahead = array.principal_mm[0]
    to_array = lens.exit_pupil.z_mm + camera.sensor_distance_mm - ahead
    if array.pitch_mm > min(width, height) / 2:
        message = f"microlenses {array.pitch_mm:g} mm apart stand before a sensor of {width:.4g} x {height:.4g} mm"
        yield Doubt("microlens-pitch", "microlenses", message, "lengths are millimetres: 100 µm are 0.1")
    weakest = max(array.focal_lengths_mm)
    if weakest > _WEAK_F_NUMBER * array.aperture_mm:
        message = (
            f"a microlens of f = {weakest:.4g} mm and {array.aperture_mm:.4g} mm wide is F/"
            f"{weakest / array.aperture_mm:.0f}: it bends next to nothing"
        )
        yield Doubt("weak-microlens", "focal_lengths", message, "lengths are millimetres: 900 µm are 0.9")
    yield from _dark_sides(camera.sensor, array, 1 + array.distance_mm / to_array)
    # Width and distance of micro-images, by similar triangles from the exit pupil through microlens vertices.
    width_mm = lens.exit_pupil.diameter_mm * behind / to_array
    distance_mm = array.nearest_mm * (1 + behind / to_array)
    for code, applies, effect, remedy in (
        ("overlap", width_mm > _OVERLAP * distance_mm, "they overlap", "stop down"),
        ("gaps", width_mm < _GAPS * distance_mm, "dark gaps lie between them", "open the stop"),
    ):
        if applies:
            pitch = camera.sensor.pitch_mm
            stop = matched_stop_mm(lens, array, camera.sensor_distance_mm)
            message = (
                f"micro-images are {width_mm / pitch:.4g} px wide and {distance_mm / pitch:.4g} px apart: {effect}"
            )
            hint = f'a stop of {stop:.4g} mm matches: write plen:camera:stopMatch = "microlenses", or {remedy}'
            yield Doubt(code, "camera", message, hint)


def _dark_sides(sensor: Sensor, array: MicrolensArray, spread: float) -> Iterator[Doubt]:
    """Warn if micro-images, `spread` times as far from the axis as their microlenses, leave the sensor partly dark."""
    grid = lattice(array)
    sizes = sensor.size_mm
    if not len(grid.k):
        return
    # Extent along x and y from the first to the last micro-image, as far as it lies on the sensor.
    covered = [
        np.clip(spread * axis.max() + array.pitch_mm / 2, -size / 2, size / 2)
        - np.clip(spread * axis.min() - array.pitch_mm / 2, -size / 2, size / 2)
        for axis, size in zip((grid.x_mm, grid.y_mm), sizes, strict=True)
    ]
    if covered[0] < _TOO_SMALL * sizes[0] or covered[1] < _TOO_SMALL * sizes[1]:
        share = covered[0] * covered[1] / (sizes[0] * sizes[1])
        message = (
            f"micro-images cover {covered[0]:.3g} x {covered[1]:.3g} mm of the sensor's {sizes[0]:.3g} x"
            f" {sizes[1]:.3g} mm: {1 - share:.0%} of the image stays dark"
        )
        hint = "enlarge the array or move it: plen:width, plen:height, offsets"
        yield Doubt("small-array", "microlenses", message, hint)


def _image_circle(camera: Camera) -> Iterator[Doubt]:
    """Check that light reaches the farthest corner of the sensor, and chief rays everything that is traced."""
    tracer = Tracer(camera)
    corner = camera.sensor.farthest_corner_mm
    corner_mm = math.hypot(*corner)
    is_wide = pupil_fan(camera.prescription).is_wide
    expected = corner * (_CIRCULAR if is_wide else 1)
    if not math.isfinite(corner_mm) or (_is_lit(tracer, expected) and not camera.microlenses):
        return
    # A chief ray must exist for the farthest corner, or the farthest microlens.
    farthest = "the farthest corner"
    traced_mm = corner_mm
    if camera.microlenses:
        farthest = "the farthest microlens"
        traced_mm = float(np.hypot(*tracer.vertices_mm.T).max(initial=0.0))
    if camera.is_centred and (camera.microlenses or not is_wide):
        crossing = chief_heights(tracer.table, tracer.stop_row, tracer.film_z_mm, np.array([traced_mm]))
        if np.isnan(crossing[0]):
            raise CameraError(
                f"no ray from {traced_mm:.4g} mm off the axis, {farthest}, reaches the centre of the aperture stop",
                hint=TOO_WIDE,
            )
    # Search for the rim of the light on the line from the axis to a dark corner.
    if not _is_lit(tracer, expected):
        lit, _ = halved(
            lambda share: np.array([_is_lit(tracer, share[0] * corner)]), np.zeros(1), np.ones(1), _HALVINGS
        )
        rim_mm = lit[0] * corner_mm
        message = f"a corner lies {corner_mm:.4g} mm off the axis, and no light comes farther out than {rim_mm:.4g} mm"
        message = message if lit[0] > 0 else "no light comes to the middle of the sensor"
        hint = "the image circle of the lens is smaller than the sensor: take a smaller sensor, or another lens"
        part = "image"
        windows, lens = parted(camera.prescription)
        if windows and _is_lit(Tracer(replace(camera, prescription=lens, spectrum=())), corner):
            part, hint = "windows", "its windows block it: make them wider, bring them nearer, or turn them less"
        yield Doubt("image-circle", part, message, hint)


def _is_lit(tracer: Tracer, point_mm: np.ndarray) -> bool:
    """Whether any ray from a point of the film leaves the lens."""
    # Aim at a grid over the rear surface. The stop may be narrower than a mesh: refine the grid about the ray that
    # passes all other surfaces and comes nearest to the centre of the stop.
    table = tracer.table
    without_stop = table.copy()
    without_stop[tracer.stop_row] = unbounded(table[tracer.stop_row :][:1])[0]
    grid = front_grid(table, GRID)
    start = np.array([*point_mm, tracer.film_z_mm])
    for _ in range(_ZOOMS):
        starts = np.tile(start, (len(grid), 1))
        direction = _unit(grid - start)
        if traced(table, starts, direction).passes.any():
            return True
        passes = traced(without_stop, starts, direction).passes
        if not passes.any():
            return False
        on_stop = traced(without_stop[: tracer.stop_row + 1], starts[passes], direction[passes]).position
        from_centre = np.hypot(*apply(inverse(motion_of(table[tracer.stop_row])), on_stop)[:, :2].T)
        middle = grid[passes][np.argmin(from_centre)]
        grid = middle + (grid - grid.mean(axis=0)) * (4 / GRID)
    return False


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) at length 1."""
    unit: np.ndarray = vectors / np.sqrt(dot(vectors, vectors))[:, None]
    return unit
