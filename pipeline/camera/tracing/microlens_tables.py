"""A camera's microlenses and pixels as the arrays that kernels read.

The main lens is sampled through the aperture of a microlens: directions at the sensor are given by aim points in the
plane at the height `AIM` above it. For a plain microlens (thin, parallel to the sensor) that is its own plane, and
everything is exact. For others a linear map from sensor and aim point to the rear vertex plane of the main lens bounds
the sampling, with a margin measured on real rays; every ray is clipped exactly where it meets the aperture.
"""

import numpy as np

from pipeline.camera.boundary import unit_vectors
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.lattice import Lattice, cell, tilt
from pipeline.camera.parts.microlens_array import MicrolensArray, append_edges, face_table
from pipeline.camera.parts.polygon import regular, rim_of
from pipeline.camera.pupil.chief_ray import chief_slopes
from pipeline.camera.pupil.outlines import Outlines
from pipeline.camera.tracing import microlens_kernels as column
from pipeline.camera.tracing.microlens_kernels import PLAIN, REFRACTIVE, THIN, TWO_PLANE, aims_for, rays_before
from pipeline.camera.tracing.records import Acceptance, CameraArrays, Elements, Optics
from pipeline.camera.tracing.sampling_bounds import outlines_around
from pipeline.errors import PipelineError
from pipeline.optics.table import COEFFICIENTS, INDEX_RATIO, SEMI_DIAMETER_SQUARED, VERTEX
from pipeline.records.shapes import Float64

_DISC_SIDES = 24
"""Sides of the polygon around a disc: 0.6 percent larger in area, which costs rays."""
_OUTSIDE = 1 + 1e-6
"""Inradius of the polygon around a disc over its radius [1]: rays next to the edge are then blocked by the disc."""
_RIM = 48
"""Points around an aperture: a multiple of 4 and 6, so that corners of a cell are among them."""
_TRIALS = 4096
"""Random rays of a microlens that measure the margin of the linear map; `_SAFETY` covers the others."""
_SAFETY = 1.2
"""Margin over the largest error of the linear map among the trials [1]: others may be slightly larger."""
_MODELS = {"thin": THIN, "two-plane": TWO_PLANE, "refractive": REFRACTIVE}
_HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""Vision frame from the sensor frame."""


def element_tables(array: MicrolensArray) -> np.ndarray:
    """Both faces, or the plane, of each type, (types, surfaces, columns); CameraError: one ends before the aperture."""
    outline = cell(array)
    radius = None if array.disc_diameter_mm is None else array.disc_diameter_mm / 2
    if array.model == "thin":
        # A plane that bends no ray: the kernel of thin microlenses does.
        plane = np.zeros(COEFFICIENTS)
        plane[INDEX_RATIO] = 1.0
        row = append_edges(plane, outline if radius is None else None)
        row[SEMI_DIAMETER_SQUARED] = (1 + 1e-12) * np.sum(outline**2, axis=1).max() if radius is None else radius**2
        return np.tile(row, (len(array.focal_lengths_mm), 1, 1))
    try:
        flat = array.model == "two-plane"
        return np.stack([face_table(faces, outline, radius, flat) for faces in array.faces])
    except PipelineError as error:
        raise CameraError(f"a microlens: {error.message}", hint="choose a longer radius or smaller discs") from None


def camera_arrays(
    camera: Camera,
    table: Float64[np.ndarray, "surfaces columns"],
    stop_row: int,
    lattice: Lattice | None,
    vertices: Float64[np.ndarray, "n 2"],
    bounds: Outlines,
) -> CameraArrays:
    """A camera for the kernels, from its surfaces, lattice and outlines.

    `table`, `vertices`, `bounds`: vision frame [mm].
    """
    array = camera.microlenses
    rear_z_mm = float(table[0, VERTEX])
    sensor_z_mm = -float(camera.sensor_distance_mm)  # for a whole number, kernels would be compiled once more
    sampling_z_mm = sensor_z_mm + array.distance_mm if array else rear_z_mm
    optics = Optics(
        sensor_z_mm=sensor_z_mm,
        sampling_z_mm=sampling_z_mm,
        rear_z_mm=rear_z_mm,
        step_mm=bounds.step_mm,
        drift=bounds.drift,
    )
    rows = np.zeros((len(vertices), column.COLUMNS))
    if array is None:
        aperture = np.zeros((0, 2))
        elements = Elements(
            model=PLAIN,
            disc_mm=0.0,
            turn=np.eye(3),
            faces=np.zeros((1, 1, 1)),
            bends=np.zeros((1, column.BENDS)),
            rims=np.zeros((1, 1, 3)),
        )
    else:
        diameter = array.disc_diameter_mm
        aperture = cell(array) if diameter is None else regular(_DISC_SIDES, _OUTSIDE * diameter / 2, first_deg=0.0)
        elements = _elements(array)
    arrays = CameraArrays(optics, _acceptance(camera), table, bounds.vertices_mm, rows, aperture, elements)
    if array is not None and lattice is not None:
        rows[:, :2] = vertices
        rows[:, column.KIND] = lattice.type
        rows[:, column.FOCAL] = np.array(array.focal_lengths_mm)[lattice.type]
        rows[:, column.Z] = sampling_z_mm + lattice.z_mm
        if array.is_plain:  # the linear maps are exact
            rows[:, column.AIM] = sampling_z_mm - sensor_z_mm
            rows[:, [column.OUTLINE_X, column.OUTLINE_Y]] = rows[:, [column.BASE_X, column.BASE_Y]] = rows[:, :2]
            behind = array.distance_mm
            ahead = rear_z_mm + camera.sensor_distance_mm - array.distance_mm
            rows[:, column.BY_START] = -ahead / behind
            rows[:, column.BY_AIM] = 1.0 + ahead / behind - ahead / rows[:, column.FOCAL] - bounds.drift
        else:
            _LinearMaps(arrays, array, lattice, stop_row).set()
    return arrays


def _acceptance(camera: Camera) -> Acceptance:
    """The acceptance of a sensor's pixels, and whether rays weigh area."""
    sensor = camera.sensor
    by_area = camera.weight == "area"
    if sensor.acceptance == "cone":
        half_angle, roll_off = np.deg2rad([sensor.acceptance_half_angle_deg, sensor.acceptance_roll_off_deg]).tolist()
        return Acceptance(power=0.0, half_angle=half_angle, roll_off=roll_off, by_area=by_area)
    power = float(sensor.acceptance_power) if sensor.acceptance == "cosine" else 0.0
    return Acceptance(power=power, half_angle=0.0, roll_off=0.0, by_area=by_area)


def _elements(array: MicrolensArray) -> Elements:
    """Surfaces and apertures of an array's microlenses, by their types."""
    bends = np.zeros((len(array.focal_lengths_mm), column.BENDS))
    for row, faces in zip(bends, array.faces, strict=False):
        row[:] = -1 / faces.front_radius_mm, faces.index, faces.aperture_is_in_front
    model = PLAIN if array.is_plain else _MODELS[array.model]
    disc_mm = (array.disc_diameter_mm or 0.0) / 2
    turn = np.ascontiguousarray((_HALF_TURN @ tilt(array) @ _HALF_TURN).T)
    return Elements(model, disc_mm, turn, element_tables(array), bends, _rims(array))


def _rims(array: MicrolensArray) -> np.ndarray:
    """Points along the edge of each type's aperture, on the face that carries it, (types, _RIM, 3).

    Frame of the microlens [mm].
    """
    if array.disc_diameter_mm is None:
        rim = rim_of(cell(array), _RIM)
    else:
        # A polygon of the disc's area: their weights differ by the curvature of cos^4 across a sixtieth of a radius.
        side_rad = 2 * np.pi / _RIM
        circumradius_mm = array.disc_diameter_mm / 2 * np.sqrt(side_rad / np.sin(side_rad))
        rim = regular(_RIM, circumradius_mm * np.cos(side_rad / 2), first_deg=0.0)
    return on_apertures(array, rim)


def on_apertures(array: MicrolensArray, points_mm: Float64[np.ndarray, "n 2"]) -> np.ndarray:
    """Points (n, 2) across the axis of a microlens, projected onto the aperture's face of each type, (types, n, 3).

    Frame of the microlens [mm].
    """
    height = np.hypot(*points_mm.T)
    if array.model == "refractive":
        z = [faces.aperture_z_mm(height) for faces in array.faces]
    else:
        z = [np.full(len(height), array.reach_mm - array.distance_mm)] * len(array.focal_lengths_mm)
    return np.stack([np.column_stack([points_mm, z_of_type]) for z_of_type in z])


class _LinearMaps:
    """Linear maps of microlenses that are not plain."""

    def __init__(self, arrays: CameraArrays, array: MicrolensArray, lattice: Lattice, stop_row: int) -> None:
        self.arrays = arrays
        self.array = array
        self.lattice = lattice
        self.stop_row = stop_row
        self.rows = arrays.microlenses
        self.optics = arrays.optics
        self.vertices = arrays.microlenses[:, :2]

    def set(self) -> None:
        """Write the maps and their aim planes."""
        rows = self.rows
        array = self.array
        drift = self.optics.drift
        # Aim in the plane of the vertex, or as far before it as the front face appears through the glass.
        slab = [faces.thickness_mm / faces.index * faces.aperture_is_in_front for faces in array.faces]
        rows[:, column.AIM] = array.distance_mm + self.lattice.z_mm
        rows[:, column.AIM] += np.array(slab)[self.lattice.type] if slab else 0.0
        # Set the constant part of the maps, and their slopes by first-order optics.
        base = self.vertices
        if array.is_tilted:  # crossings of the chief rays through vertices with the plane of the untilted array
            slopes = chief_slopes(self.arrays.table, self.stop_row, rows[:, [column.X, column.Y, column.Z]])
            base = self.vertices - self.lattice.z_mm[:, None] * slopes
        rows[:, [column.OUTLINE_X, column.OUTLINE_Y]] = base
        rows[:, [column.BASE_X, column.BASE_Y]] = self.vertices - drift * (self.vertices - base)
        for map_column, at_sensor in ((column.BY_START, 1.0), (column.BY_AIM, 0.0)):
            at_rear, at_film = self._crossings(at_sensor)
            rows[:, map_column] = at_rear - drift * at_film
        self._measure()

    def _crossings(self, at_sensor: float) -> tuple[np.ndarray, np.ndarray]:
        """Paraxial crossings with the rear vertex plane and the film plane, (m,) each, per unit of a sensor position
        (`at_sensor` 1) or of an aim point (0).
        """
        array = self.array
        rows = self.rows
        above = self.lattice.z_mm
        planes = np.array(array.principal_mm)[self.lattice.type] - array.distance_mm
        # Height of the ray at the rear principal plane, its slope behind the front one, and its height at the vertex.
        slope = (-1.0 if at_sensor else 1.0) / rows[:, column.AIM]
        at_principal = at_sensor + slope * (array.distance_mm + above + planes[:, 0])
        refracted = slope - at_principal / rows[:, column.FOCAL]
        at_vertex = at_principal - refracted * planes[:, 1]
        return at_vertex + refracted * (self.optics.rear_z_mm - rows[:, column.Z]), at_vertex - refracted * above

    def _measure(self) -> None:
        """Set inflation and margin from real rays of the lowest, the highest and a middle microlens of each type."""
        rows = self.rows
        types = self.lattice.type
        reach = self._sensor_reach()
        rng = np.random.default_rng(0)
        # Outward normals of the aperture's edges, and their distances from the vertex, both over the edges' lengths.
        aperture = self.arrays.aperture
        edge = np.roll(aperture, -1, axis=0) - aperture
        normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
        inradius = np.sum(normal * aperture, axis=1)
        inflation = margin = 0.0
        for kind in np.unique(types):
            of_type = np.flatnonzero(types == kind)
            order = of_type[np.argsort(self.lattice.z_mm[of_type], kind="stable")]
            for microlens in dict.fromkeys((order[0], order[len(order) // 2], order[-1])):
                # Aim rays from random positions on the sensor at random points of the aperture's edge: the polygon must
                # be inflated to hold all aims.
                vertex = rows[microlens, :2]
                trial_rows = np.full(_TRIALS, microlens)
                aims = np.empty((_TRIALS, 2))
                angle = rng.uniform(0, 2 * np.pi, _TRIALS)
                distance = reach * np.sqrt(rng.uniform(0, 1, _TRIALS))
                starts = vertex + distance[:, None] * unit_vectors(angle)
                points = self.arrays.elements.rims[kind][rng.integers(0, _RIM, _TRIALS)]
                aims_for(self.arrays, trial_rows, starts, points, aims)
                inflation = max(inflation, float((((aims - vertex) @ normal.T) / inradius).max() - 1))
                # Trace rays through random points within it: their distance from the linear map is the margin.
                inner = vertex + np.sqrt(rng.uniform(0, 1, (_TRIALS, 1))) * (aims - vertex)
                margin = max(margin, self._error(trial_rows, starts, inner))
        rows[:, column.INFLATION] = _SAFETY * inflation + 1e-9
        rows[:, column.MARGIN] = _SAFETY * margin + 1e-9

    def _sensor_reach(self) -> float:
        """Largest distance of a microlens's light on the sensor from its vertex, to first order [mm]."""
        rows = self.rows
        polygons = outlines_around(self.arrays, rows[:, [column.OUTLINE_X, column.OUTLINE_Y]])
        from_base = polygons - rows[:, None, [column.BASE_X, column.BASE_Y]]
        widest_aperture = np.hypot(*self.arrays.aperture.T).max()
        at_rear = np.hypot(*from_base.T).max(axis=0) + widest_aperture * np.abs(rows[:, column.BY_AIM])
        return float(1.05 * (at_rear / np.abs(rows[:, column.BY_START])).max())

    def _error(self, microlens: np.ndarray, starts: np.ndarray, aims: np.ndarray) -> float:
        """Largest distance on the rear vertex plane between real rays and the linear map [mm]."""
        position = np.empty((_TRIALS, 3))
        direction = np.empty((_TRIALS, 3))
        passes = np.empty(_TRIALS)
        rays_before(self.arrays, microlens, starts, aims, position, direction, passes)
        slope = direction[:, :2] / direction[:, 2:]
        row = self.rows[microlens[0]]
        at_rear = position[:, :2] + slope * (self.optics.rear_z_mm - position[:, 2:])
        at_film = position[:, :2] + slope * (self.optics.sampling_z_mm - position[:, 2:])
        linear = row[[column.BASE_X, column.BASE_Y]] + row[column.BY_START] * (starts - row[:2])
        linear += row[column.BY_AIM] * (aims - row[:2])
        actual = at_rear - self.optics.drift * (at_film - row[[column.OUTLINE_X, column.OUTLINE_Y]])
        return float(np.hypot(*(actual - linear).T)[passes > 0].max(initial=0.0))
