"""Compile kernels by calling them with tiny cameras. Workers then find the compiled code in the kernel cache."""

import dataclasses
import gc
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from itertools import chain, takewhile
from typing import NamedTuple, NoReturn

import numpy as np

from pipeline.camera.integrating import edge_kernels
from pipeline.camera.integrating.polar_hits import single_hits
from pipeline.camera.integrating.quadrature import edges
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.micro_images.light import micro_light
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.records import CameraArrays
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.entry_points import offered, plugged_in
from pipeline.machine.process import end_with_parent
from pipeline.optics.prescription import Prescription, Surface
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import irradiance_and_crosstalk, pictures
from pipeline.render.sensor.read_out import Shot, digital_numbers
from pipeline.render.sensor.response import SensorResponse
from pipeline.targets.mesh import MeshTarget, Occluder
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.surfaces import Cylinder, Warped
from pipeline.targets.target import AnyTarget, Target
from pipeline.truth.grid import quad_search


class Part(NamedTuple):
    """A call that compiles kernels, made if all of its `steps` are to be compiled; names separated by spaces."""

    steps: str
    call: Callable[[], object]


def compile_kernels(steps: Iterable[str], numbers: Iterable[int] | None = None) -> None:
    """Call every kernel of these steps once, with the types that real tasks use; or only parts with these numbers."""
    chosen = set(steps)
    of_plug_ins = (plugged_in("kernel", step) for step in sorted(chosen & offered("kernel").keys()))
    parts = [part for part in (*chain(*of_plug_ins), *_PARTS) if chosen.issuperset(part.steps.split())]
    all_numbers = range(len(parts))
    gc.disable()  # the compiler frees almost nothing before it ends; searching for garbage costs a tenth of the time
    try:
        for number in all_numbers if numbers is None else takewhile(all_numbers.__contains__, numbers):
            parts[number].call()
    finally:
        gc.enable()


def compile_apart() -> NoReturn:
    """Compile those parts of the steps in the arguments whose numbers this process, and no other, reads from its input.

    The process ends at once: to free one by one what the compiler has left takes seconds.
    """
    end_with_parent()
    sys.excepthook = lambda *error: None  # the process that started this one meets it, too: see `_compiled_by_helpers`
    compile_kernels(sys.argv[1:], (byte[0] for byte in iter(lambda: os.read(0, 1), b"")))
    os._exit(0)


def _tracer(*surfaces: Surface) -> Tracer:
    """A camera of 2 x 2 pixels whose lens has these surfaces, and behind them its stop."""
    lens = Prescription(surfaces=(*surfaces, Surface(semi_diameter_mm=1.0, is_stop=True)))
    sensor = Sensor(width_px=2, height_px=2, pitch_mm=0.01)
    return Tracer(Camera(prescription=lens, sensor=sensor, sensor_distance_mm=10.0))


def _plenoptic(tilt_x_deg: float) -> Tracer:
    """A camera with one microlens, in a tilted array."""
    array = MicrolensArray(
        pitch_mm=0.1, focal_lengths_mm=(1.0,), columns=1, rows=1, distance_mm=1.0, tilt_x_deg=tilt_x_deg
    )
    return Tracer(dataclasses.replace(_tracer().camera, microlenses=array))


_POSITION, _NO_LENS = np.zeros((1, 2)), np.array([NO_MICROLENS])
"""The centre of a sensor [mm] and the index for "no microlens"; any position compiles the same code."""
_CORNERS = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
"""Vertices of a triangle [mm]: any shape compiles the same code."""
_CARD = Occluder(vertices_mm=np.array(_CORNERS), triangles=np.array([[0, 1, 2]]))
"""A triangle that may hide a target."""
_SQUARES = Checkerboard(columns=2, rows=1, square_mm=1.0)
"""A pattern, of any size."""


def _integrals(tracer: Tracer, microlens: int) -> None:
    """Integrals over the light of one position on the sensor, by two rules."""
    outlines = edges(tracer.arrays, _POSITION, np.array([microlens]))
    outlines.moments(parallel_planes(1.0, 2.0)[None], (2, 4))
    edge_kernels.spread(outlines.polygons, outlines.counts, np.zeros((1, 1, 2)))


def _moments() -> None:
    _tracer().moments(_POSITION, _NO_LENS, parallel_planes(1.0, 2.0), 4, np.zeros((1, 2), np.int64))


def _aspheres() -> CameraArrays:
    conic = Surface(radius_mm=-9.0, semi_diameter_mm=2.0, conic=-1.0, index=1.5)
    asphere = dataclasses.replace(conic, even_coefficients=(0.0, 1e-9), blades=5, index=1.0)
    return _tracer(conic, asphere).arrays


def _micro_images() -> None:
    tracer = _plenoptic(0.0)
    micro_light(tracer, micro_images(tracer))


def _pictures(tracer: Tracer, occluders: Sequence[Occluder] = ()) -> None:
    """A white image, and one of a board with occluders."""
    board = Target(_SQUARES)
    pose = np.eye(4)
    pose[2, 3] = 100.0
    scenes = [TargetLight([(board, pose)], 0.0, [(occluder, pose) for occluder in occluders])]
    rig = Rig.of(tracer)
    white, foreign = irradiance_and_crosstalk(rig, 1, None)
    pictures(rig, 1, scenes, np.array([white - foreign, foreign]))


def _shapes() -> None:
    _SQUARES.radiance(np.zeros(1), np.zeros(1))
    point = ((0.0, 0.0, 1.0),)
    for shape in (Warped(deflection_mm=(0.0, 0.0)), Cylinder(radius_mm=9.0)):
        _shine(Target(_SQUARES, shape))
    _shine(MeshTarget(vertices_mm=_CORNERS, triangles=((0, 1, 2),), albedo=point, points_mm=point, normals=point))


def _shine(target: AnyTarget) -> None:
    """Radiance of a target along one ray."""
    ray = np.array([[0.0, 0.0, 1.0]])
    target.points()
    TargetLight([(target, np.eye(4))], 0.0).radiance(ray, ray)


def _search() -> None:
    """The search for a point in a position image of 2 x 2 pixels."""
    image = np.zeros((2, 2, 2))
    cell = np.zeros((2, 2), np.int64)
    quads = np.zeros((1, 3), np.int64)
    quad_search.quads_that_hold(image, cell, np.zeros((1, 2)), quads)
    limits = quad_search.Filter(True, 0.1, 0.1)
    quad_search.solve_quads(image, cell, np.zeros((1, 2)), quads, limits, np.zeros(1, np.int64), np.zeros((1, 9)))
    quad_search.nearest_positions(image, cell, np.zeros((1, 2)), np.zeros((1, 1)), np.zeros((1, 1, 2), np.int64))


def _sensor() -> None:
    response = SensorResponse(quantum_efficiency=(1.0,), full_well_e=1.0, gain_dn_per_e=1.0, bit_depth=8)
    digital_numbers(response, {"mono": np.zeros((1, 1))}, Shot(seed=0, camera="", frame=0, exposure_time_s=0.0))


_PARTS = (
    Part("lens", lambda: _integrals(_tracer(), NO_MICROLENS)),
    Part("images", lambda: _pictures(_tracer())),
    Part("lens", _moments),
    Part("aspheres", _aspheres),
    Part("lens", lambda: single_hits(_tracer().arrays, _POSITION, _NO_LENS, _POSITION, np.zeros((1, 4, 3)))),
    Part("microlenses", lambda: micro_images(_plenoptic(1.0))),
    Part("search", _search),
    Part("microlenses", lambda: _integrals(_plenoptic(1.0), 0)),
    Part("sensor", _sensor),
    Part("shapes", _shapes),
    Part("company", lambda: _pictures(_tracer(), [_CARD])),
    Part("micro_images", _micro_images),
    Part("images micro_images", lambda: _pictures(_plenoptic(0.0))),
    Part("micro_images", lambda: _integrals(_plenoptic(0.0), 0)),
    Part("company", lambda: _shine(Target(_SQUARES))),
)
"""All parts, the slowest first, so that two processes that take parts in turn end together."""
