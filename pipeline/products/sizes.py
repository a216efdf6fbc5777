"""Sizes of tasks for forecasts: numbers proportional to their work, and a coarse cost where nothing has run yet."""

import json
import math
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from typing import Any, Protocol, runtime_checkable

import numpy as np

from pipeline.camera.bundle import bundle_behind
from pipeline.camera.figures.outlook import microlenses_lit, outlook
from pipeline.camera.integrals import Bundles, integrals, random_integrals
from pipeline.camera.parts.camera import Camera
from pipeline.camera.pupil.outlines import lit_share
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.engine.planning.explain import duration
from pipeline.engine.planning.forecast import Cost
from pipeline.engine.planning.graph import Task, TaskGraph
from pipeline.engine.records import Params, as_json
from pipeline.files.jsonfile import Json
from pipeline.frames import apply
from pipeline.optics.first_order import first_order
from pipeline.products.certificate.params import Certificate
from pipeline.products.graph import graph_of
from pipeline.products.images.params import SECONDS_PER_MET, Image, White
from pipeline.products.light import Exposure
from pipeline.products.positions.params import Positions
from pipeline.products.rays.params import JoinedRays, RaysTile
from pipeline.products.truth.params import Truth
from pipeline.products.views import PaintedView, PlacedView
from pipeline.records.plain import from_plain, to_plain
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.targets.drawing import CHECKS, DISC, POLYGON, SPOKES
from pipeline.targets.target import target_from_plain
from pipeline.truth.settings import JUDGES_RAYS, LEAVING, LEVELS, RAYS, SHARPER, rows_of_build

SECONDS_PER_RAY = 1e-7
"""Processor time of one ray of an image or a bundle [s]: tiles of white images took 85 ns through 12 surfaces and 40 ns
behind microlenses, tiles of images of boards up to 90 ns, on a core of an AMD EPYC on 24 November 2026. Slower
processors take two or three times as long.
"""
_SHARE_BEHIND_MICROLENSES = 0.3
"""Share of the rays of a white image that one without lamps takes behind microlenses: 0.2 to 0.4 in example 02."""
_BESIDE_BLUR_PX = 2.0
"""Width by which footprints of pixels surpass the blur of a point: that of a pixel, and margins on both sides [px]."""
_SHAPES_WITH_FACES = ("flat", "cube", "stairs")
_SECONDS_PER_TASK = 0.05
"""Processor time of a task besides such rays [s]: tiles of truth took 0.3 s there, and most others less than this."""
_SECONDS_PER_PAIR = {True: 6e-4, False: 1e-2}
"""Processor time to look for a point behind a microlens in one wavelength [s]: thin ones parallel to the sensor took
0.6 ms, others, whose apertures are found by tracing, 5 to 13 ms, on an Intel Xeon on 27 November 2026."""
_LONG_S = 60.0
"""Processor time from which a preview is worth a word [s]."""


@runtime_checkable
class _Imaged(Protocol):
    """Params of images and labels."""

    exposure: Exposure


@runtime_checkable
class _Seen(_Imaged, Protocol):
    """Params of images of a view, and of its labels."""

    view: PaintedView | None
    rows: tuple[int, int] | None

    @property
    def seconds_per_ray(self) -> float | None: ...


def size(task: Task, plain: Params) -> float:
    """Rays of a task per pixel of the sensor, or of a band of its rows; 0 if its params have no samples.

    The resolution of the sensor is not considered: after it was edited, a forecast states the cost of the old one.
    """
    try:
        params: Any = from_plain(task.record or dict, plain)
    except (KeyError, TypeError, ValueError, AttributeError):  # those of another version
        return 0.0
    match params:
        case RaysTile(sampling=how):
            return float((params.end_row - params.first_row) * how.supersampling**2 * how.samples)
        case JoinedRays(sampling=how) | Positions(sampling=how):
            return float(how.supersampling**2 * how.samples)
        case _Imaged():
            return float(params.exposure.samples)
    return 0.0


def assumed_cost(graph: TaskGraph, name: str) -> Cost:
    """Cost of a task of which only its rays are known. Passes after the first, maybe not needed, count nothing."""
    task, rays, ray_s, more_s = graph[name], 0.0, SECONDS_PER_RAY, 0.0
    params: Any = from_plain(task.record or dict, task.params)
    plain = as_json(graph[task.reads.get("camera", name)].params)
    match params:
        case Certificate(frames=(_, *_)) | Truth(view=PlacedView()):
            (rays, more_s), ray_s = _cost_of_rows(params, plain), SECONDS_PER_RAY / 2  # most are blocked early
        case RaysTile(sampling=how):
            rays = (params.end_row - params.first_row) * _row_rays(plain, how.samples * how.supersampling**2)
        case Positions(sampling=how):
            height_px = _camera(plain).sensor.height_px
            rays = height_px * _row_rays(plain, how.samples * how.supersampling**2)
        case White(tiles=0, passes=0):
            first, end = _rows(params, plain)
            rays = (end - first) * _row_rays(plain, params.exposure.samples)
            rays *= _are_dark_at_an_end(plain, first, end) if params.is_smooth else 1.0
        case Image(passes=passes) if passes:
            pass
        case _Seen(view=PaintedView() as view):
            first, end = _rows(params, plain)
            rays = (end - first) * _row_rays(plain, params.exposure.samples)
            if params.seconds_per_ray is not None:
                ray_s = params.seconds_per_ray
            elif any(_is_bent(placed.target) for placed in view.targets):
                ray_s = SECONDS_PER_MET
            else:
                rays *= _share_sampled(plain, as_json([to_plain(placed) for placed in view.targets]))
    return Cost(cpu_seconds=_SECONDS_PER_TASK + more_s + rays * ray_s, rays=rays, peak_bytes=0)


def _rows(params: White | _Seen, plain: bytes) -> tuple[int, int]:
    return params.rows or (0, _camera(plain).sensor.height_px)


def _row_rays(plain: bytes, samples: int) -> int:
    return _camera(plain).sensor.width_px * samples


@lru_cache(maxsize=64)
def _camera(plain: bytes) -> Camera:
    return from_plain(Camera, json.loads(plain))


def _are_dark_at_an_end(plain: bytes, first: int, end: int) -> bool:
    """Whether the image circle ends within some rows: quadrature knows a white image where all of its rows are lit."""
    (width, height), lit = _lit(plain)
    return math.hypot(width, max(height - 2 * first, 2 * end - height)) > lit * math.hypot(width, height)


@lru_cache(maxsize=8)
def _lit(plain: bytes) -> tuple[tuple[int, int], float]:
    """Size of the sensor [px], and the share of the way from its middle to its farthest corner that light reaches."""
    camera = _camera(plain)
    sensor, tracer = camera.sensor, Tracer(camera)
    way_mm = np.array([(sensor.offset_x_mm, sensor.offset_y_mm), sensor.farthest_corner_mm])
    return (sensor.width_px, sensor.height_px), lit_share(tracer.table, tracer.stop_row, *tracer.on_film(way_mm))


@lru_cache(maxsize=8)
@np.errstate(all="ignore")  # what is not finite takes all rays
def _share_sampled(plain: bytes, targets: bytes) -> float:
    """Share of the pixels that take rays in an image of flat targets that glow: those whose light comes from both sides
    of an edge, by the length of all edges and the blur there.
    """
    camera, share = _camera(plain), 0.0
    if camera.microlenses:
        return _SHARE_BEHIND_MICROLENSES
    for placed in json.loads(targets):
        for patch in target_from_plain(placed["target"]).patches():
            pose, drawing = np.array(placed["vision_from_target"]) @ patch.target_from_patch, patch.drawing.arrays
            facing = max(1e-3, abs(pose[:3, 2] @ pose[:3, 3]) / np.linalg.norm(pose[:3, 3]))
            size_mm = 2 * np.array([drawing.half_x, drawing.half_y])
            points = apply(pose, np.append(size_mm, 0) / 4 * [(1, 1, 0), (1, -1, 0), (-1, 1, 0), (-1, -1, 0)])[None]
            blur_px = outlook(camera, points, np.broadcast_to(pose[:3, 2], points.shape)).blur_px.mean()
            px_per_mm = abs(first_order(camera.prescription).magnification(pose[2, 3])) / camera.sensor.pitch_mm
            edges_px = 2 * px_per_mm * (size_mm.sum() + sum(map(_half_edges_mm, drawing.kinds, drawing.numbers)))
            area_px2 = px_per_mm**2 * size_mm.prod() * facing
            covered = -np.expm1(-(1.15 * blur_px + _BESIDE_BLUR_PX) * edges_px * math.sqrt(facing) / area_px2)
            share += float(min(1.0, area_px2 / math.prod(camera.sensor.size_px)) * covered)
    return min(1.0, share)


def _half_edges_mm(kind: int, numbers: np.ndarray) -> float:
    """Half the length of the edges of a shape of a drawing, of a polygon that of its bounds."""
    a, b, c, d, e, _ = numbers.tolist()
    return {POLYGON: c - b + e - d, DISC: math.pi * d, SPOKES: a * (e - d), CHECKS: (a + 1) * (b + 1) * c}[int(kind)]


def _is_bent(target: Json) -> bool:
    surface = target.get("surface")  # none of a mesh
    return surface is None or surface["kind"] not in _SHAPES_WITH_FACES


def _cost_of_rows(params: Truth | Certificate, plain: bytes) -> tuple[float, float]:
    """Rays of the rows of a table, or of a judge of frames alike; or time by the microlenses that may see points."""
    camera, rows, rays, claim_px, points = _camera(plain), 0.0, 0.0, math.inf, None
    if isinstance(params, Certificate):
        targets, is_hidden, claim_px = params.frames[0].targets, False, params.claim_px or math.inf
    else:
        assert params.view is not None  # of tables that tiles make
        targets, is_hidden, points = params.view.targets, bool(params.view.occluders), params.points
    array = camera.microlenses
    for target in targets:
        every, z_mm = target_from_plain(target.target).points().kinds, target.vision_from_target[2][3]
        first, end = points.get(target.name, (0, 0)) if points else (0, len(every))
        solved = (end - first) * (microlenses_lit(camera, array, z_mm) if array else 1)
        row, look, judge = (0, 0, JUDGES_RAYS[0]) if array else _rays_of_row(plain, z_mm, params.square_px, claim_px)
        rows += solved
        rays += solved * (judge if isinstance(params, Certificate) else row + look * is_hidden)
    if isinstance(params, Certificate):
        return rays / max(1.0, rows) * min(of := rows * len(params.frames), rows_of_build(int(of))), 0.0
    lights = len(params.table.channel.wavelengths_nm) if params.table.channel else 1
    return rays, rows * lights * _SECONDS_PER_PAIR[array.is_plain] if array else 0.0


@lru_cache(maxsize=64)
def _rays_of_row(plain: bytes, z_mm: float, square_px: float, claim_px: float) -> tuple[float, float, float]:
    """Rays of a row of truth, of a look at what hides it, and of its judge, by those of five bundles of the sensor."""
    # No number of a lens says where what passes is in pieces, or small. Searches took 3 to 7 times their last integral.
    tracer = Tracer(_camera(plain))
    x_px = np.array([(2, 2), (1, 1), (1, 3), (3, 1), (3, 3)]) / 4 * tracer.camera.sensor.size_px - 0.5
    bundles = Bundles(x_px, np.full(5, NO_MICROLENS), parallel_planes(z_mm, 2 * z_mm)[None].repeat(5, 0), square_px)
    leaving = np.array([len(bundle_behind(tracer, x, y, NO_MICROLENS, RAYS).weight_sr) for x, y in x_px]) / RAYS
    look = sum(rays * np.mean(leaving * fewer < LEAVING) for fewer, rays in zip((0, *LEVELS), LEVELS, strict=False))
    found, beside = (integrals(tracer, replace(bundles, x_px=x_px + step), 2) for step in (0, 1))
    mm_per_px = np.hypot(*(beside.moments - found.moments)[:, :2].T) / math.sqrt(2)
    error_px = np.hypot(*random_integrals(tracer, bundles, JUDGES_RAYS[0]).error_mm.T) / mm_per_px
    # Four times the rays err by 0.35 times as much, as Sobol points do; a level sends them once to three times.
    level = np.ceil(np.log2(np.maximum(1.0, (1 + SHARPER) * error_px / claim_px)) / 1.5)  # NaN: dark
    judge = JUDGES_RAYS[0] * 4 ** np.minimum(level, len(JUDGES_RAYS) - 1) * 8 / 3
    return 4 * found.rays / 5, float(look), float(np.nansum(judge) / max(1, np.sum(judge > 0)))


def cost_lines(dataset: Dataset | None, cameras: Iterable[CameraEntry]) -> list[str]:
    """Lines on the cost of a dataset, or of an image of each camera of a rig, before anything has run."""
    sizes = [(entry, f"{entry.asked.sensor.width_px} x {entry.asked.sensor.height_px} px") for entry in cameras]
    if dataset:
        frames, shown = len(dataset.frames), " and ".join(dict.fromkeys(size_px for _, size_px in sizes))
        # All frames have tasks alike: a graph of four tells what each adds, and judges draw enough rows from three.
        graphs = [graph_of(replace(dataset, frames=dataset.frames[:count]))[0] for count in (3, 4)]
        costs = [(len(graph), sum(assumed_cost(graph, name).cpu_seconds for name in graph)) for graph in graphs]
        tasks, seconds = (three + (frames - 3) * (four - three) for three, four in zip(*costs, strict=True))
        sooner = "; `pipeline build --preview` makes small pictures first" if seconds > _LONG_S else ""
        passes = ", without further passes for the noise" if any(entry.image_noise for entry, _ in sizes) else ""
        job = f"{frames} frame{'s' * (frames != 1)} of {shown}, {tasks} tasks"
        return [f"{job}: about {duration(seconds)} of processor time{passes}{sooner}"]
    lines = []
    for entry, size_px in sizes:
        sensor, rays = entry.asked.sensor, entry.image_samples * max(1, len(entry.channels))
        time = duration(sensor.width_px * sensor.height_px * rays * SECONDS_PER_RAY)
        lines.append(f"{entry.name}: {size_px}; an image takes about {time} of processor time at {rays} rays each")
    return lines
