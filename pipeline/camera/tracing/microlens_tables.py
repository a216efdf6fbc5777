"""A camera's microlenses and pixels as the arrays that kernels read.

The main lens is sampled through the aperture of a microlens: directions at the sensor are named by aim points in the
plane at the height `AIM` above it. Of a plain microlens (thin, parallel to the sensor) that is its own plane, and all
is exact. Of others a linear map from sensor and aim point to the rear vertex plane of the main lens bounds the
sampling, with a margin measured on real rays; every ray is clipped exactly where it meets the aperture.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.lattice import Lattice, cell, tilt
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.parts.microlens_faces import append_edges, face_table
from pipeline.camera.parts.polygon import regular
from pipeline.camera.pupil.chief_ray import chief_slopes
from pipeline.camera.pupil.outlines import Outlines
from pipeline.camera.tracing import microlens_kernels
from pipeline.camera.tracing.acceptance import BY_AREA, HALF_ANGLE, POWER, ROLL_OFF
from pipeline.camera.tracing.records import CameraArrays, Mosaic, Optics
from pipeline.camera.tracing.sampling_bounds import outlines_at
from pipeline.errors import PipelineError
from pipeline.optics.table import COEFFICIENTS, INDEX_RATIO, SEMI_DIAMETER_SQUARED, VERTEX
from pipeline.records.shapes import Float64

_DISC_SIDES = 24
"""Sides of the polygon around a disc: 0.6 percent larger in area, rays that are lost."""
_OUTSIDE = 1 + 1e-6
"""Sides of a polygon around a disc keep off it: what blocks a ray next to the edge is then the disc everywhere."""
_RIM = 48
"""Points around an aperture: a multiple of 4 and 6, so that corners of a cell are among them."""
_TRIALS = 4096
"""Random rays of a microlens that measure the margin of the linear map; `_SAFETY` covers what they miss."""
_SAFETY = 1.2
"""Margin over the largest error of the linear map among the trials [1]: others may be a little larger."""
_MODELS = {"two-plane": microlens_kernels.TWO_PLANE, "refractive": microlens_kernels.REFRACTIVE}


@dataclass(frozen=True, slots=True)
class Microlenses:
    """Microlenses for the kernels.

    Attributes
    ----------
    lenses : (m, columns) float64
    aperture : (c, 2) float64
        Polygon around the aperture.
    mosaic : Mosaic
    reach : (m, 2) float64
        Reach of the linear map from the sensor to the rear vertex plane: per sensor point, per aim point.
    """

    lenses: Float64[np.ndarray, "m columns"]
    aperture: Float64[np.ndarray, "c 2"]
    mosaic: Mosaic
    reach: Float64[np.ndarray, "m 2"]


def is_plain(array: MicrolensArray | None) -> bool:
    """Whether microlenses are thin and parallel to the sensor."""
    return array is None or (array.model == "thin" and not array.is_tilted)


def element_tables(array: MicrolensArray) -> np.ndarray:
    """Both faces, or the plane, of each type for the packet tracer, (types, surfaces, columns).

    Raises
    ------
    CameraError
        A face ends before the aperture does.
    """
    outline, radius = cell(array), None if array.disc_diameter_mm is None else array.disc_diameter_mm / 2
    if array.model == "thin":
        plane = np.zeros(COEFFICIENTS)
        plane[INDEX_RATIO] = 1.0
        row = append_edges(plane, outline if radius is None else None)
        row[SEMI_DIAMETER_SQUARED] = np.inf if radius is None else radius**2
        return np.tile(row, (len(array.focal_lengths_mm), 1, 1))
    try:
        flat = array.model == "two-plane"
        return np.stack([face_table(faces, outline, radius, flat) for faces in array.faces])
    except PipelineError as error:
        raise CameraError(f"a microlens: {error.what}", hint="choose a longer radius or smaller discs") from None


def microlenses(
    camera: Camera,
    table: Float64[np.ndarray, "surfaces columns"],
    stop_row: int,
    lattice: Lattice | None,
    vertices: Float64[np.ndarray, "n 2"],
    bounds: Outlines,
) -> Microlenses:
    """Arrays of a camera whose surfaces, lattice and outlines are known."""
    array, detail = camera.microlenses, _detail(camera)
    if array is None or lattice is None:
        nothing = Mosaic(detail, np.zeros((1, 1, 1)), np.zeros((1, microlens_kernels.BENDS)), np.zeros((1, 1, 3)))
        return Microlenses(np.zeros((0, microlens_kernels.PLAIN_COLUMNS)), np.zeros((0, 2)), nothing, np.zeros((0, 2)))
    focal = np.array(array.focal_lengths_mm)[lattice.type]
    lenses = np.column_stack([vertices, focal])
    bends = np.zeros((len(array.focal_lengths_mm), microlens_kernels.BENDS))
    for row, faces in zip(bends, array.faces, strict=False):
        row[:] = -1 / faces.front_radius_mm, faces.index, faces.aperture_is_in_front
    mosaic = Mosaic(detail, element_tables(array), bends, _rims(array))
    radius = array.disc_diameter_mm
    aperture = cell(array) if radius is None else regular(_DISC_SIDES, _OUTSIDE * radius / 2, 0.0)
    if is_plain(array):
        behind, ahead = array.distance_mm, table[0, VERTEX] + camera.sensor_distance_mm - array.distance_mm
        by_aim = 1.0 + ahead / behind - ahead / focal - bounds.drift
        return Microlenses(lenses, aperture, mosaic, np.column_stack([np.full(len(focal), -ahead / behind), by_aim]))
    placed = _Placed(camera, array, lattice, table, stop_row, bounds)
    lenses = placed.lenses(lenses, aperture, mosaic)
    return Microlenses(lenses, aperture, mosaic, lenses[:, [microlens_kernels.BY_START, microlens_kernels.BY_AIM]])


def _detail(camera: Camera) -> np.ndarray:
    sensor, array, detail = camera.sensor, camera.microlenses, np.zeros(microlens_kernels.TURN + 9)
    detail[BY_AREA] = camera.weight == "area"
    if sensor.acceptance == "cosine":
        detail[POWER] = sensor.acceptance_power
    elif sensor.acceptance == "cone":
        detail[HALF_ANGLE] = np.deg2rad(sensor.acceptance_half_angle_deg)
        detail[ROLL_OFF] = np.deg2rad(sensor.acceptance_roll_off_deg)
    if array is not None:
        detail[microlens_kernels.DISC] = (array.disc_diameter_mm or 0.0) / 2
        detail[microlens_kernels.MODEL] = (
            microlens_kernels.PLAIN if is_plain(array) else _MODELS.get(array.model, microlens_kernels.THIN)
        )
        half_turn = np.diag([-1.0, -1.0, 1.0])
        detail[microlens_kernels.TURN :] = (half_turn @ tilt(array) @ half_turn).T.ravel()
    return detail


def _rims(array: MicrolensArray) -> np.ndarray:
    """Points along the edge of each type's aperture, on the face that has it, (types, _RIM, 3)."""
    if array.disc_diameter_mm is None:
        corners = cell(array)
        share = np.arange(_RIM // len(corners)) / (_RIM // len(corners))
        edge = np.roll(corners, -1, axis=0) - corners
        rim = (corners[:, None] + share[:, None] * edge[:, None]).reshape(-1, 2)
    else:
        # A polygon of the disc's area: their weights differ by the curvature of cos^4 across a sixtieth of a radius.
        turn = 2 * np.pi / _RIM
        rim = regular(_RIM, array.disc_diameter_mm / 2 * np.sqrt(turn / np.sin(turn)) * np.cos(turn / 2), 0.0)
    return on_apertures(array, rim)


def on_apertures(array: MicrolensArray, points_mm: Float64[np.ndarray, "n 2"]) -> np.ndarray:
    """Points (n, 2) across the axis of a microlens on the face of each type that has the aperture, (types, n, 3)."""
    height = np.hypot(*points_mm.T)
    if array.model == "refractive":
        z = [faces.aperture_z_mm(height) for faces in array.faces]
    else:
        z = [np.full(len(height), array.reach_mm - array.distance_mm)] * len(array.focal_lengths_mm)
    return np.stack([np.column_stack([points_mm, along]) for along in z])


class _Placed:
    """The linear maps of microlenses that are not plain."""

    def __init__(
        self,
        camera: Camera,
        array: MicrolensArray,
        lattice: Lattice,
        table: np.ndarray,
        stop_row: int,
        bounds: Outlines,
    ) -> None:
        self.array, self.lattice, self.bounds = array, lattice, bounds
        self.table, self.stop_row = table, stop_row
        self.sensor_mm = -camera.sensor_distance_mm
        self.film_mm = self.sensor_mm + array.distance_mm

    def lenses(self, plain: np.ndarray, aperture: np.ndarray, mosaic: Mosaic) -> np.ndarray:
        """Rows for the kernels, from those of plain microlenses."""
        array, kind = self.array, self.lattice.type
        rows = np.zeros((len(plain), microlens_kernels.COLUMNS))
        rows[:, : plain.shape[1]] = plain
        rows[:, microlens_kernels.KIND], rows[:, microlens_kernels.Z] = kind, self.film_mm + self.lattice.z_mm
        gap = array.distance_mm + self.lattice.z_mm
        slab = [faces.thickness_mm / faces.index * faces.aperture_is_in_front for faces in array.faces]
        rows[:, microlens_kernels.AIM] = gap + (np.array(slab)[kind] if slab else 0.0)
        base = self._on_film(plain[:, :2])
        rows[:, [microlens_kernels.OUTLINE_X, microlens_kernels.OUTLINE_Y]] = base
        drift = self.bounds.drift
        rows[:, [microlens_kernels.BASE_X, microlens_kernels.BASE_Y]] = plain[:, :2] - drift * (plain[:, :2] - base)
        (at_rear_s, at_film_s), (at_rear_a, at_film_a) = self._maps(rows)
        rows[:, microlens_kernels.BY_START] = at_rear_s - drift * at_film_s
        rows[:, microlens_kernels.BY_AIM] = at_rear_a - drift * at_film_a
        self._measure(rows, aperture, mosaic)
        return rows

    def _on_film(self, vertices: np.ndarray) -> np.ndarray:
        """Crossings of the chief rays through vertices of tilted arrays with the plane of the untilted one."""
        if not self.array.is_tilted:
            return vertices
        points = np.column_stack([vertices, self.film_mm + self.lattice.z_mm])
        return vertices - self.lattice.z_mm[:, None] * chief_slopes(self.table, self.stop_row, points)

    def _maps(self, rows: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Paraxial crossings with the rear vertex and the film plane per unit of the sensor's and of the aim point."""
        array, kind = self.array, self.lattice.type
        planes = np.array(array.principal_mm)[kind] - array.distance_mm
        above, ahead = self.lattice.z_mm, self.table[0, VERTEX] - rows[:, microlens_kernels.Z]
        found = []
        for start, slope in ((1.0, -1.0 / rows[:, microlens_kernels.AIM]), (0.0, 1.0 / rows[:, microlens_kernels.AIM])):
            at_principal = start + slope * (array.distance_mm + above + planes[:, 0])
            out = slope - at_principal / rows[:, microlens_kernels.FOCAL]
            at_vertex = at_principal - out * planes[:, 1]
            found.append((at_vertex + out * ahead, at_vertex - out * above))
        return found[0], found[1]

    def _measure(self, rows: np.ndarray, aperture: np.ndarray, mosaic: Mosaic) -> None:
        """Set inflation and margin from real rays of the lenses of each type that stand lowest, highest, in between."""
        around, camera = self._sensor_reach(rows, aperture), self._arrays(rows, aperture, mosaic)
        rng = np.random.default_rng(0)
        inflation = margin = 0.0
        for kind in np.unique(self.lattice.type):
            own = np.flatnonzero(self.lattice.type == kind)
            order = own[np.argsort(self.lattice.z_mm[own], kind="stable")]
            for microlens in dict.fromkeys((order[0], order[len(order) // 2], order[-1])):
                angle, far = rng.uniform(0, 2 * np.pi, _TRIALS), around * np.sqrt(rng.uniform(0, 1, _TRIALS))
                starts = rows[microlens, :2] + far[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
                points = mosaic.rims[kind][rng.integers(0, _RIM, _TRIALS)]
                which = np.full(_TRIALS, microlens)
                aims = np.empty((_TRIALS, 2))
                microlens_kernels.aims_for(camera, which, starts, points, aims)
                inflation = max(inflation, _excess(aims - rows[microlens, :2], aperture))
                inner = rows[microlens, :2] + np.sqrt(rng.uniform(0, 1, (_TRIALS, 1))) * (aims - rows[microlens, :2])
                margin = max(margin, self._error(camera, which, starts, inner))
        rows[:, microlens_kernels.INFLATION] = _SAFETY * inflation + 1e-9
        rows[:, microlens_kernels.MARGIN] = _SAFETY * margin + 1e-9

    def _arrays(self, rows: np.ndarray, aperture: np.ndarray, mosaic: Mosaic) -> CameraArrays:
        """The camera for the kernels, as `Tracer.arrays`."""
        rear_mm = float(self.table[0, VERTEX])
        optics = Optics(self.sensor_mm, self.film_mm, rear_mm, self.bounds.step_mm, self.bounds.drift)
        return CameraArrays(optics, self.table, self.bounds.vertices_mm, rows, aperture, mosaic)

    def _sensor_reach(self, rows: np.ndarray, aperture: np.ndarray) -> float:
        """Largest distance from below its vertex at which light of a microlens meets the sensor, to first order."""
        polygons = np.empty((len(rows), self.bounds.vertices_mm.shape[2], 2))
        outline_points = np.ascontiguousarray(rows[:, [microlens_kernels.OUTLINE_X, microlens_kernels.OUTLINE_Y]])
        outlines_at(self.bounds.step_mm, self.bounds.vertices_mm, outline_points, polygons)
        across = polygons - rows[:, None, [microlens_kernels.BASE_X, microlens_kernels.BASE_Y]]
        by_start, by_aim = rows[:, microlens_kernels.BY_START], rows[:, microlens_kernels.BY_AIM]
        corner = np.hypot(*aperture.T).max()
        return float(1.05 * ((np.hypot(*across.T).max(axis=0) + corner * np.abs(by_aim)) / np.abs(by_start)).max())

    def _error(self, camera: CameraArrays, which: np.ndarray, starts: np.ndarray, aims: np.ndarray) -> float:
        """Largest distance between where real rays meet the rear vertex plane and where the linear map has them."""
        position, direction, passes = np.empty((_TRIALS, 3)), np.empty((_TRIALS, 3)), np.empty(_TRIALS)
        microlens_kernels.rays_before(camera, which, starts, aims, position, direction, passes)
        slope, row = direction[:, :2] / direction[:, 2:], camera.lenses[which[0]]
        at_rear = position[:, :2] + slope * (self.table[0, VERTEX] - position[:, 2:])
        at_film = position[:, :2] + slope * (self.film_mm - position[:, 2:])
        linear = row[[microlens_kernels.BASE_X, microlens_kernels.BASE_Y]] + row[microlens_kernels.BY_START] * (
            starts - row[:2]
        )
        linear += row[microlens_kernels.BY_AIM] * (aims - row[:2])
        base = row[[microlens_kernels.OUTLINE_X, microlens_kernels.OUTLINE_Y]]
        off = at_rear - self.bounds.drift * (at_film - base) - linear
        return float(np.hypot(*off.T)[passes > 0].max(initial=0.0))


def _excess(points: np.ndarray, polygon: np.ndarray) -> float:
    """By what share a polygon about the origin must grow to hold points."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    return float(((points @ normal.T) / np.sum(normal * polygon, axis=1)).max() - 1)
