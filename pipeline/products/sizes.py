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
        case RaysTile(sampling=sampling):
            return float((params.end_row - params.first_row) * sampling.supersampling**2 * sampling.samples)
        case JoinedRays(sampling=sampling) | Positions(sampling=sampling):
            return float(sampling.supersampling**2 * sampling.samples)
        case _Imaged():
            return float(params.exposure.samples)
    return 0.0


def assumed_cost(graph: TaskGraph, name: str) -> Cost:
    """Cost of a task of which only its rays are known: their number times `ray_s`, and a time besides.

    Passes after the first, which may not be needed, count nothing.
    """
    task = graph[name]
    params: Any = from_plain(task.record or dict, task.params)
    plain = as_json(graph[task.reads.get("camera", name)].params)
    rays = besides_s = 0.0
    ray_s = SECONDS_PER_RAY
    match params:
        case Certificate(frames=(_, *_)) | Truth(view=PlacedView()):
            rays, besides_s = _cost_of_rows(params, plain)
            ray_s = SECONDS_PER_RAY / 2  # most are blocked early
        case RaysTile(sampling=sampling):
            rays = (params.end_row - params.first_row) * _row_rays(plain, sampling.samples * sampling.supersampling**2)
        case Positions(sampling=sampling):
            height_px = _camera(plain).sensor.height_px
            rays = height_px * _row_rays(plain, sampling.samples * sampling.supersampling**2)
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
    return Cost(cpu_seconds=_SECONDS_PER_TASK + besides_s + rays * ray_s, rays=rays, peak_bytes=0)


def _rows(params: White | _Seen, plain: bytes) -> tuple[int, int]:
    return params.rows or (0, _camera(plain).sensor.height_px)


def _row_rays(plain: bytes, samples: int) -> int:
    return _camera(plain).sensor.width_px * samples


@lru_cache(maxsize=64)
def _camera(plain: bytes) -> Camera:
    return from_plain(Camera, json.loads(plain))


def _are_dark_at_an_end(plain: bytes, first: int, end: int) -> bool:
    """Whether the image circle ends within some rows: then these are sampled, else quadrature computes them."""
    (width, height), lit = _lit(plain)
    return math.hypot(width, max(height - 2 * first, 2 * end - height)) > lit * math.hypot(width, height)


@lru_cache(maxsize=8)
def _lit(plain: bytes) -> tuple[tuple[int, int], float]:
    """Size of the sensor [px], and the share of the line from its middle to its farthest corner that light reaches."""
    camera = _camera(plain)
    sensor = camera.sensor
    tracer = Tracer(camera)
    ends_mm = np.array([(sensor.offset_x_mm, sensor.offset_y_mm), sensor.farthest_corner_mm])
    return (sensor.width_px, sensor.height_px), lit_share(tracer.table, tracer.stop_row, *tracer.on_film(ends_mm))


@lru_cache(maxsize=8)
@np.errstate(all="ignore")  # a share that is not finite counts as all pixels
def _share_sampled(plain: bytes, targets: bytes) -> float:
    """Share of the pixels that take rays in an image of flat targets that glow: those whose light comes from both sides
    of an edge.

    They lie in bands along the edges, as wide as the blur and a pixel. Were these strewn at random over the area A of a
    patch in the image, the bands of width w along edges of length l would cover the share 1 - exp(-w l / A) of it.
    """
    camera = _camera(plain)
    share = 0.0
    if camera.microlenses:
        return _SHARE_BEHIND_MICROLENSES
    for placed in json.loads(targets):
        for patch in target_from_plain(placed["target"]).patches():
            pose = np.array(placed["vision_from_target"]) @ patch.target_from_patch
            drawing = patch.drawing.arrays
            # Cosine between the normal and the line of sight, by which the patch is foreshortened
            facing = max(1e-3, abs(pose[:3, 2] @ pose[:3, 3]) / np.linalg.norm(pose[:3, 3]))
            size_mm = 2 * np.array([drawing.half_x, drawing.half_y])
            points = apply(pose, np.append(size_mm, 0) / 4 * [(1, 1, 0), (1, -1, 0), (-1, 1, 0), (-1, -1, 0)])[None]
            blur_px = outlook(camera, points, np.broadcast_to(pose[:3, 2], points.shape)).blur_px.mean()
            px_per_mm = abs(first_order(camera.prescription).magnification(pose[2, 3])) / camera.sensor.pitch_mm
            edges_px = 2 * px_per_mm * (size_mm.sum() + sum(map(_half_edges_mm, drawing.kinds, drawing.numbers)))
            area_px2 = px_per_mm**2 * size_mm.prod() * facing
            width_px = 1.15 * blur_px + _BESIDE_BLUR_PX
            covered = -np.expm1(-width_px * edges_px * math.sqrt(facing) / area_px2)
            share += float(min(1.0, area_px2 / math.prod(camera.sensor.size_px)) * covered)
    return min(1.0, share)


def _half_edges_mm(kind: int, numbers: np.ndarray) -> float:
    """Half the length of the edges of a shape of a drawing, of a polygon that of its bounds."""
    a, b, c, d, e, _ = numbers.tolist()
    return {POLYGON: c - b + e - d, DISC: math.pi * d, SPOKES: a * (e - d), CHECKS: (a + 1) * (b + 1) * c}[int(kind)]


def _is_bent(target: Json) -> bool:
    """Whether a target has other surfaces than planes."""
    surface = target.get("surface")  # none of a mesh
    return surface is None or surface["kind"] not in _SHAPES_WITH_FACES


def _cost_of_rows(params: Truth | Certificate, plain: bytes) -> tuple[float, float]:
    """Rays of the rows of a table, or of the sample that a certificate judges; behind microlenses, where the search for
    microlenses that see a point dominates, no rays but a time [s].
    """
    camera = _camera(plain)
    array = camera.microlenses
    is_certificate = isinstance(params, Certificate)
    claim_px, has_occluders, points = math.inf, False, None
    if isinstance(params, Certificate):  # its frames are taken as equal to the first
        targets = params.frames[0].targets
        claim_px = params.claim_px or math.inf
    else:
        assert params.view is not None  # of tables that tiles make
        targets = params.view.targets
        has_occluders = bool(params.view.occluders)
        points = params.points
    rows = rays = 0.0
    for target in targets:
        z_mm = target.vision_from_target[2][3]
        count = len(target_from_plain(target.target).points().kinds)
        first, end = points.get(target.name, (0, 0)) if points else (0, count)
        rows_of_target = (end - first) * (microlenses_lit(camera, array, z_mm) if array else 1)
        solving, looking, judging = (
            (0, 0, JUDGES_RAYS[0]) if array else _rays_of_row(plain, z_mm, params.square_px, claim_px)
        )
        rows += rows_of_target
        rays += rows_of_target * (judging if is_certificate else solving + looking * has_occluders)
    if isinstance(params, Certificate):
        all_rows = rows * len(params.frames)
        return rays / max(1.0, rows) * min(all_rows, rows_of_build(int(all_rows))), 0.0
    wavelengths = len(params.table.channel.wavelengths_nm) if params.table.channel else 1
    return rays, rows * wavelengths * _SECONDS_PER_PAIR[array.is_plain] if array else 0.0


@lru_cache(maxsize=64)
def _rays_of_row(plain: bytes, z_mm: float, square_px: float, claim_px: float) -> tuple[float, float, float]:
    """Rays to solve a row of truth, to see whether it is hidden, and to judge it: means over five bundles, in the
    middle of the sensor and of its quarters.

    They are traced, because no number of a lens tells how many rays pass, or whether the passing light is in pieces.
    """
    tracer = Tracer(_camera(plain))
    x_px = np.array([(2, 2), (1, 1), (1, 3), (3, 1), (3, 3)]) / 4 * tracer.camera.sensor.size_px - 0.5
    bundles = Bundles(x_px, np.full(5, NO_MICROLENS), parallel_planes(z_mm, 2 * z_mm)[None].repeat(5, 0), square_px)
    # A level of visibility is traced for bundles of which too few rays left the lens in the level before.
    leaving = np.array([len(bundle_behind(tracer, x, y, NO_MICROLENS, RAYS).weight_sr) for x, y in x_px]) / RAYS
    levels = zip((0, *LEVELS), LEVELS, strict=False)
    looking = sum(rays * np.mean(leaving * before < LEAVING) for before, rays in levels)
    # The judge's error in pixels: J moves by sqrt(2) mm_per_px from a pixel to its diagonal neighbour.
    integral, beside = (integrals(tracer, replace(bundles, x_px=x_px + step), 2) for step in (0, 1))
    mm_per_px = np.hypot(*(beside.moments - integral.moments)[:, :2].T) / math.sqrt(2)
    error_px = np.hypot(*random_integrals(tracer, bundles, JUDGES_RAYS[0]).error_mm.T) / mm_per_px
    # Four times the rays err by 0.35 times as much, as Sobol points do; a level sends them once to three times.
    level = np.ceil(np.log2(np.maximum(1.0, (1 + SHARPER) * error_px / claim_px)) / 1.5)  # NaN: dark
    judging = JUDGES_RAYS[0] * 4 ** np.minimum(level, len(JUDGES_RAYS) - 1) * 8 / 3
    # A search took 3 to 7 times the rays of its last integral.
    return 4 * integral.rays / 5, float(looking), float(np.nansum(judging) / max(1, np.sum(judging > 0)))


def cost_lines(dataset: Dataset | None, cameras: Iterable[CameraEntry]) -> list[str]:
    """Lines on the cost of a dataset, or of an image of each camera of a rig, before anything has run."""
    sizes = [(entry, f"{entry.asked.sensor.width_px} x {entry.asked.sensor.height_px} px") for entry in cameras]
    if dataset:
        frames = len(dataset.frames)
        # Every frame adds the same tasks. The cost is extrapolated from graphs of three and of four frames: from three
        # on, a certificate draws all of its rows.
        graphs = [graph_of(replace(dataset, frames=dataset.frames[:count]))[0] for count in (3, 4)]
        costs = [(len(graph), sum(assumed_cost(graph, name).cpu_seconds for name in graph)) for graph in graphs]
        tasks, seconds = (three + (frames - 3) * (four - three) for three, four in zip(*costs, strict=True))
        sooner = "; `pipeline build --preview` makes small pictures first" if seconds > _LONG_S else ""
        passes = ", without further passes for the noise" if any(entry.image_noise for entry, _ in sizes) else ""
        sizes_px = " and ".join(dict.fromkeys(size_px for _, size_px in sizes))
        job = f"{frames} frame{'s' * (frames != 1)} of {sizes_px}, {tasks} tasks"
        return [f"{job}: about {duration(seconds)} of processor time{passes}{sooner}"]
    lines = []
    for entry, size_px in sizes:
        sensor = entry.asked.sensor
        rays = entry.image_samples * max(1, len(entry.channels))
        time = duration(sensor.width_px * sensor.height_px * rays * SECONDS_PER_RAY)
        lines.append(f"{entry.name}: {size_px}; an image takes about {time} of processor time at {rays} rays each")
    return lines
