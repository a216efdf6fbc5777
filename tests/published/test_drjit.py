"""Dr.Jit differentiates a trace of its own by itself: derivatives of rows by every number of a lens and of an array.

The trace has nothing of ours: Newton's method on sags in the camera frame, and a stop behind the lens, or behind thin
microlenses alone, so that straight lines from the sensor tell what passes. Each lane of Dr.Jit's forward mode has the
tangent of one number.
"""

import dataclasses

import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of
from scipy.spatial.transform import Rotation

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.frames import rigid
from pipeline.optics.prescription import Prescription, Surface
from pipeline.truth.derivatives import Neighbour, SolvedRows, Variation, derivatives
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.planes import Planes, tangent_planes

dr = pytest.importorskip("drjit", reason="needs the extra `referees`")

LENS = (
    Surface(
        radius_mm=60.0,  # light passes beside its axis, where r^3 has a kink
        thickness_mm=6.0,
        index=1.6,
        semi_diameter_mm=25.0,
        conic=-0.4,
        even_coefficients=(0.0, 3e-6),
        odd_coefficients=(2e-6,),
        decentre_mm=(4.0, -3.0),
        tilt_deg=(0.0, 0.6),
    ),
    Surface(radius_mm=-85.0, thickness_mm=3.0, semi_diameter_mm=25.0, tilt_deg=(0.8, -0.5)),
    Surface(radius_mm=-95.0, thickness_mm=3.0, index=1.7, semi_diameter_mm=25.0),
    Surface(radius_mm=210.0, thickness_mm=5.0, semi_diameter_mm=25.0, conic=1.5),
    Surface(semi_diameter_mm=3.0, is_stop=True),
)
PIXELS = {"width_px": 400, "height_px": 300, "pitch_mm": 0.05, "offset_x_mm": 0.4, "offset_y_mm": -0.3}
BARE = rigs.bare(Prescription(surfaces=LENS), Sensor(**PIXELS), 75.0, (400.0, 700.0))
PLENOPTIC = dataclasses.replace(
    BARE,
    microlenses=MicrolensArray(
        pitch_mm=4.0, focal_lengths_mm=(7.0,), layout="square", width_mm=19.0, height_mm=14.0, distance_mm=5.0
    ),
)
STEPS = {
    "radius": 5e-3,
    "index": 1e-6,
    "conic": 1e-3,
    "a3": 1e-8,
    "a4": 1e-9,
    "pitch": 1e-5,
    "lattice": 1e-5,
    "gap": 1e-4,
    "focal length": 1e-4,
}
"""Half the steps of our differences; of other numbers 1e-3 [mm, deg]."""
SAME = 1e-7
"""Relative to the largest derivative by a number: the error of central differences, and of two quadratures."""

Number = tuple[str, int, int]
"""A kind of number, the place of its surface, and which of a pair it is."""


def numbers(camera: Camera) -> dict[Number, float]:
    """All numbers of a camera by which rows have derivatives."""
    values: dict[Number, float] = {("distance", 0, 0): camera.sensor_distance_mm, ("pitch", 0, 0): PIXELS["pitch_mm"]}
    values |= {("offset", 0, i): PIXELS[name] for i, name in enumerate(("offset_x_mm", "offset_y_mm"))}
    for place, surface in enumerate(camera.prescription.surfaces[:-1]):
        values |= {("radius", place, 0): surface.radius_mm, ("thickness", place, 0): surface.thickness_mm}
        values |= {("decentre", place, i): value for i, value in enumerate(surface.decentre_mm)}
        values |= {("tilt", place, i): value for i, value in enumerate(surface.tilt_deg)}
        values |= {("index", place, 0): surface.index} if surface.index != 1 else {}
        values |= {("conic", place, 0): surface.conic} if surface.conic else {}
        values |= {("a3", place, 0): surface.odd_coefficients[0]} if surface.odd_coefficients else {}
        values |= {("a4", place, 0): surface.even_coefficients[1]} if surface.even_coefficients else {}
    values["stop", len(LENS) - 1, 0] = camera.prescription.surfaces[-1].semi_diameter_mm
    if array := camera.microlenses:
        values |= {("lattice", 0, 0): array.pitch_mm, ("gap", 0, 0): array.distance_mm}
        values["focal length", 0, 0] = array.focal_lengths_mm[0]
    return values


def changed(camera: Camera, number: Number, value: float) -> Camera:
    """The camera with another value of a number."""
    kind, place, entry = number
    array = camera.microlenses
    if kind == "distance":
        return dataclasses.replace(camera, sensor_distance_mm=value)
    if kind in ("pitch", "offset"):
        name = "pitch_mm" if kind == "pitch" else ("offset_x_mm", "offset_y_mm")[entry]
        return dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, **{name: value}))
    if kind in ("lattice", "gap", "focal length"):
        name = {"lattice": "pitch_mm", "gap": "distance_mm"}.get(kind, "focal_lengths_mm")
        new = dataclasses.replace(array, **{name: (value,) if kind == "focal length" else value})
        return dataclasses.replace(camera, microlenses=new)
    if kind in ("decentre", "tilt"):
        name = "decentre_mm" if kind == "decentre" else "tilt_deg"
        pair = getattr(camera.prescription.surfaces[place], name)
        field = {name: tuple(value if i == entry else other for i, other in enumerate(pair))}
    elif kind in ("a3", "a4"):
        field = {"odd_coefficients": (value,)} if kind == "a3" else {"even_coefficients": (0.0, value)}
    else:
        units = {"radius": "radius_mm", "thickness": "thickness_mm", "stop": "semi_diameter_mm"}
        field = {units.get(kind, kind): value}
    return rigs.reshaped(camera, {place: field})


def turned(v: list, tilt_deg: list, sign: int) -> list:
    """A vector of the lens from the frame of a surface, or with the sign -1 into it: about x, then the turned y."""
    (sin_x, cos_x), (sin_y, cos_y) = (dr.sincos(sign * angle * (np.pi / 180)) for angle in tilt_deg)
    turns = [
        lambda x, y, z: [x, cos_x * y - sin_x * z, sin_x * y + cos_x * z],
        lambda x, y, z: [cos_y * x + sin_y * z, y, cos_y * z - sin_y * x],
    ]
    for turn in turns[::-sign]:
        v = turn(*v)
    return v


def dot(a: list, b: list):
    return sum(x * y for x, y in zip(a, b, strict=True))


def refracted(at: list, way: list, of: dict[str, list], mu) -> tuple[list, list]:
    """A ray at a surface, in its own frame: z towards the sensor, from where rays come."""
    c, k, a3, a4 = (of[name][0] for name in ("curvature", "conic", "a3", "a4"))

    def sag(x, y):
        h2 = x * x + y * y
        root, h = dr.sqrt(1 - (1 + k) * c * c * h2), dr.sqrt(h2)
        return c * h2 / (1 + root) + a3 * h * h2 + a4 * h2 * h2, c / root + 3 * a3 * h + 4 * a4 * h2

    t = -at[2] / way[2]
    for _ in range(8):
        x, y, z = (p + t * d for p, d in zip(at, way, strict=True))
        height, slope = sag(x, y)  # the slope over the height above the axis
        t = t - (z - height) / (way[2] - slope * (x * way[0] + y * way[1]))
    at = [p + t * d for p, d in zip(at, way, strict=True)]
    slope = sag(*at[:2])[1]
    normal = [-slope * at[0], -slope * at[1], 1 + 0 * slope]
    length = dr.sqrt(dot(normal, normal))
    normal = [n / length for n in normal]
    cos = -dot(normal, way)
    turn = mu * cos - dr.sqrt(1 - mu * mu * (1 - cos * cos))
    return at, [mu * d + turn * n for d, n in zip(way, normal, strict=True)]


def through_lens(at: list, way: list, theta: dict) -> tuple[list, list]:
    """A ray from the stop, in the camera frame, in front of the lens."""
    z = 0
    for place in range(len(LENS) - 2, -1, -1):
        z = z - theta["thickness", place, 0]
        shift, tilt = ([theta[kind, place, i] for i in (0, 1)] for kind in ("decentre", "tilt"))
        of = {name: [theta.get((name, place, 0), 0)] for name in ("conic", "a3", "a4")}
        of["curvature"] = [1 / theta["radius", place, 0]]
        vertex = [*shift, z]
        mu = theta.get(("index", place, 0), 1) / theta.get(("index", place - 1, 0), 1)
        at, way = turned([p - v for p, v in zip(at, vertex, strict=True)], tilt, -1), turned(way, tilt, -1)
        at, way = refracted(at, way, of, mu)
        at = [p + v for p, v in zip(turned(at, tilt, 1), vertex, strict=True)]
        way = turned(way, tilt, 1)
    return at, way


def hits_and_weights(theta: dict, nodes: list, plane: np.ndarray, steps_from_axial: list | None) -> tuple[list, object]:
    """Hits on tangent planes along their axes, and weights of the rays; all lanes."""
    x = [
        theta["pitch", 0, 0] * (theta["x_px", 0, i] - (PIXELS[n] - 1) / 2)
        for i, n in enumerate(("width_px", "height_px"))
    ]
    place = [theta["offset", 0, 0] - x[0], x[1] - theta["offset", 0, 1]]  # x right, y up, seen from behind
    radius, angle = theta["stop", len(LENS) - 1, 0] * nodes[0], nodes[1]
    in_stop, distance = [radius * dr.cos(angle), radius * dr.sin(angle)], theta["distance", 0, 0]
    if steps_from_axial is None:
        first, gap = in_stop, distance
        behind = [u - p for u, p in zip(first, place, strict=True)]
        way = [*behind, -distance]
    else:
        gap, f = theta["gap", 0, 0], theta["focal length", 0, 0]
        s = [theta["lattice", 0, 0] * step for step in steps_from_axial]
        vertex = [theta["offset", 0, 0] - s[0], s[1] - theta["offset", 0, 1]]
        rest = distance - gap
        # u = m + rest ((m - p) / gap - (m - v) / f): where a ray through m of the microlens meets the stop
        first = [
            (u + rest * (p / gap - v / f)) / (1 + rest / gap - rest / f)
            for u, p, v in zip(in_stop, place, vertex, strict=True)
        ]
        behind = [m - p for m, p in zip(first, place, strict=True)]
        way = [*((u - m) / rest for u, m in zip(in_stop, first, strict=True)), -1 + 0 * gap]
    weight = radius / dr.square(dot(behind, behind) + gap * gap)  # cos^4 over the plane of the aperture
    length = dr.sqrt(dot(way, way))
    at, way = through_lens([*in_stop, 0 * gap], [d / length for d in way], theta)
    origin, *axes, normal = plane
    t = dot([o - p for o, p in zip(origin, at, strict=True)], normal) / dot(way, normal)
    hit = [p + t * d - o for p, d, o in zip(at, way, origin, strict=True)]
    return [dot(hit, axis) for axis in axes], weight


def is_whole(camera: Camera, x_px: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Rows whose light passes within a microlens: the stop alone bounds it."""
    array, half_px = camera.microlenses, (np.array([PIXELS["width_px"], PIXELS["height_px"]]) - 1) / 2
    rest, f, gap = camera.sensor_distance_mm - array.distance_mm, array.focal_lengths_mm[0], array.distance_mm
    vertex = array.pitch_mm * steps
    off = PIXELS["pitch_mm"] * (x_px - half_px) - vertex  # from the vertex, as seen from behind it
    axis = np.array([PIXELS["offset_x_mm"], PIXELS["offset_y_mm"]])
    middle = rest * (off / gap - (vertex - axis) / rest) / (1 + rest / gap - rest / f)
    radius = LENS[-1].semi_diameter_mm / (1 + rest / gap - rest / f)
    return (np.abs(middle) + radius < 0.95 * array.pitch_mm / 2).all(axis=1)


def by_drjit(values: dict[Number, float], x_px: np.ndarray, planes: np.ndarray, steps: np.ndarray | None) -> np.ndarray:
    """Derivatives of rows by all numbers, (n, v, 2)."""
    from drjit.llvm.ad import Float64

    node, share = np.polynomial.legendre.leggauss(10)
    angles = 2 * np.pi * np.arange(32) / 32
    radii, angles = np.repeat((node + 1) / 2, 32), np.tile(angles, 10)
    kinds = [("x_px", 0, 0), ("x_px", 0, 1), *values]
    rows, count = len(x_px), len(radii)
    shape = (len(kinds), rows, count)

    def lanes(of_rows_and_nodes) -> Float64:
        return Float64(np.ascontiguousarray(np.broadcast_to(of_rows_and_nodes, shape)).ravel())

    theta = {}
    for place, kind in enumerate(kinds):
        value = x_px[:, kind[2], None] if kind[0] == "x_px" else values[kind]
        theta[kind] = lanes(value)
        dr.enable_grad(theta[kind])
        dr.set_grad(theta[kind], lanes((np.arange(len(kinds)) == place)[:, None, None].astype(float)))
    flip = planes * (1, -1, -1)  # of the vision frame
    plane = [[lanes(flip[:, i, j, None]) for j in range(3)] for i in range(4)]
    axial = None if steps is None else [lanes(steps[:, i, None]) for i in (0, 1)]
    hits, weight = hits_and_weights(theta, [lanes(radii), lanes(angles)], plane, axial)
    weight = weight * lanes(np.repeat(share, 32))
    j = [dr.block_sum(hit * weight, count) / dr.block_sum(weight, count) for hit in hits]
    dr.forward_to(*j)
    rates = np.stack([np.array(dr.grad(part)).reshape(len(kinds), rows) for part in j], axis=-1)
    assert max(np.abs(np.array(dr.detach(part))).max() for part in j) < 1e-7  # rows are solutions
    by_x = rates[:2].transpose(1, 2, 0)
    return -np.linalg.solve(by_x[:, None], rates[2:].transpose(1, 0, 2)[..., None])[..., 0]


@pytest.mark.heavy
@pytest.mark.parametrize("camera", [BARE, PLENOPTIC], ids=["bare", "plenoptic"])
def test_derivatives_by_all_numbers_are_those_of_a_trace_that_dr_jit_differentiates(camera):
    pose = rigid(Rotation.from_euler("xyz", (192, 11, 20), degrees=True).as_matrix(), np.array([3.0, -2.0, 560.0]))
    planes = tangent_planes(pose, np.array([[x, y, 0.0] for x in (-25.0, 4.0, 22.0) for y in (-18.0, 15.0)]))
    rig, steps = rig_of(camera), None
    rows = solve(rig, guesses(rig, planes)[0], planes, 1e-9, 0.05).solutions
    x_px, cell, point, on = rows.xy_px, rows.cell, rows.point, Planes(planes)
    if lattice := rig.tracer.lattice:
        microlens = rig.microlens(cell)
        steps = np.stack([lattice.k[microlens], lattice.l[microlens]], axis=1)
        whole = is_whole(camera, x_px, steps)
        x_px, cell, point, steps = x_px[whole], cell[whole], point[whole], steps[whole]
    values, variations = numbers(camera), []
    for number, value in values.items():
        step = STEPS.get(number[0], 1e-3)
        ends = (Neighbour(rig.tracer.next_to(changed(camera, number, value + by)), on) for by in (-step, step))
        variations.append(Variation(step, *ends))
    ours = derivatives(rig, SolvedRows(point, cell, x_px, on), variations).x_px
    expected = by_drjit(values, x_px, planes[point], steps)
    largest = np.abs(expected).max(axis=(0, 2))
    off = np.abs(ours - expected).max(axis=(0, 2)) / largest

    assert len(x_px) >= 4 and (largest > 0).all()
    assert off.max() < SAME, dict(zip(values, off, strict=True))
