"""Sizes of tasks for forecasts: numbers proportional to their work, and a coarse cost where nothing has run yet."""

from collections.abc import Iterable
from dataclasses import replace

from pipeline.camera.figures.outlook import microlenses_lit
from pipeline.camera.focusing.focus_request import FocusRequest
from pipeline.camera.in_time import INSTANTS, STATES
from pipeline.camera.parts.camera import Camera
from pipeline.engine.planning.explain import duration
from pipeline.engine.planning.forecast import Cost
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.records import Params
from pipeline.graph.dataset_graph import graph_of
from pipeline.records.plain import from_plain
from pipeline.scene.dataset import CameraEntry, Dataset

SECONDS_PER_RAY = 1e-7
"""Processor time of one ray of an image or a bundle [s]: tiles of white images took 85 ns through 12 surfaces and 40 ns
behind microlenses, tiles of images of boards up to 90 ns, on a core of an AMD EPYC on 24 November 2026. Slower
processors take two or three times as long, and so do lamps that shine on a scene.
"""
_SHARE_OF_GLOWING = 0.3
"""Share of its rays that an image without lamps takes: it has those of the white image, and few outside the targets."""
_SECONDS_PER_MET = 6e-7
"""Processor time of a ray that is followed to what it meets [s]: those of labels, and of images without lamps of a bent
target, took 0.5 to 1.3 µs on a busy Intel Xeon on 27 November 2026.
"""
_SHAPES_WITH_FACES = ("flat", "cube", "stairs")
_SECONDS_PER_TASK = 0.05
"""Processor time of a task besides such rays [s]: tiles of truth took 0.3 s there, and most others less than this."""
_SECONDS_PER_PAIR = {True: 6e-4, False: 1e-2}
"""Processor time to look for a point behind a microlens in one wavelength [s]: thin ones in a plane parallel to the
sensor took 0.6 ms, others, whose apertures are found by tracing, 5 to 13 ms, on an Intel Xeon on 27 November 2026.
"""
_SECONDS_PER_INSTANT = 0.15
"""Processor time of a camera that changes to make it as it is at an instant, and a part of an image with it [s]: two
frames of example 08 before a shutter that rolls took 0.13 s for each, on an Intel Xeon on 27 November 2026.
"""
_LONG_S = 60.0
"""Processor time from which a preview is worth a word [s]."""


def size(_: str, params: Params) -> float:
    """Rays of a task per pixel of the sensor, or of a band of its rows; 0 if its params have no samples.

    The resolution of the sensor is not considered: after it was edited, a forecast states the cost of the old one.
    """
    rows = params["end_row"] - params["first_row"] if "end_row" in params else 1
    rays = params.get("sampling") or params.get("exposure") or {}
    # Passes double the samples; how many rows a strip has is forgotten as a tile's is.
    rows *= 1 << max(0, params.get("number", 0) - 1)
    return float(rows * rays.get("supersampling", 1) ** 2 * rays.get("samples", 0))


def assumed_cost(graph: TaskGraph, name: str) -> Cost:
    """Cost of a task of which only its rays are known. Passes after the first one, maybe not needed, count nothing."""
    params, rays, ray_s, more_s = graph[name].params, 0.0, SECONDS_PER_RAY, 0.0
    how, changes = params.get("sampling") or params.get("exposure"), "in_time" in graph[name].reads
    while "camera" in graph[name].reads:
        name = graph[name].reads["camera"]
    focus = graph[name].params
    if params.get("points") and params.get("view"):
        more_s = _seconds_of_pairs(params, focus) * (STATES if changes else 1)
    if how and not params.get("tiles") and not params.get("number"):
        sensor = (focus["camera"] or focus["request"])["sensor"]
        first, end = params.get("rows") or (params.get("first_row", 0), params.get("end_row", sensor["height_px"]))
        rays = (end - first) * sensor["width_px"] * how["samples"] * how.get("supersampling", 1) ** 2
        glows = "view" in params and params["view"]["lighting"] is None
        if "later" in params or (glows and any(map(_is_bent, params["view"]["targets"]))):
            ray_s = _SECONDS_PER_MET
        elif glows:
            rays *= _SHARE_OF_GLOWING
        if changes and params.get("shutter"):
            shutter = params["shutter"]
            frame_s = sensor["height_px"] * shutter["line_s"] + shutter["exposure_s"]
            share = (end - first) * shutter["line_s"] / frame_s if frame_s else 0.0
            more_s += shutter["instants"] * (1 + INSTANTS * share) * _SECONDS_PER_INSTANT
            rays *= 2 * shutter["instants"]  # of a white image, too
    return Cost(cpu_seconds=_SECONDS_PER_TASK + more_s + rays * ray_s, rays=rays, peak_bytes=0)


def _is_bent(target: Params) -> bool:
    surface = target["target"].get("surface")  # none of a mesh
    return surface is None or surface["kind"] not in _SHAPES_WITH_FACES


def _seconds_of_pairs(params: Params, focus: Params) -> float:
    """Processor time of a tile of truth by its points and the microlenses that see them, to first order; 0 without."""
    asked = from_plain(Camera, focus["camera"]) if focus["camera"] else from_plain(FocusRequest, focus["request"])
    array, channel, pairs = asked.microlenses, params["table"]["channel"], 0.0
    if array is None:
        return 0.0
    for target in params["view"]["targets"]:
        first, end = params["points"].get(target["name"], (0, 0))
        pairs += (end - first) * microlenses_lit(asked, array, target["vision_from_target"][2][3])
    return pairs * (len(channel["wavelengths_nm"]) if channel else 1) * _SECONDS_PER_PAIR[array.is_plain]


def cost_lines(dataset: Dataset | None, cameras: Iterable[CameraEntry]) -> list[str]:
    """Lines on the cost of a dataset, or of an image of each camera of a rig, before anything has run."""
    sizes = [(entry, f"{entry.asked.sensor.width_px} x {entry.asked.sensor.height_px} px") for entry in cameras]
    if dataset:
        frames, shown = len(dataset.frames), " and ".join(dict.fromkeys(size_px for _, size_px in sizes))
        # All frames have tasks alike: a graph of two tells what each adds.
        graphs = [graph_of(replace(dataset, frames=dataset.frames[:count]))[0] for count in (1, 2)]
        costs = [(len(graph), sum(assumed_cost(graph, name).cpu_seconds for name in graph)) for graph in graphs]
        tasks, seconds = (first + (frames - 1) * (both - first) for first, both in zip(*costs, strict=True))
        sooner = "; `pipeline build --preview` makes small pictures first" if seconds > _LONG_S else ""
        job = f"{frames} frame{'s' * (frames != 1)} of {shown}, {tasks} tasks"
        return [f"{job}: about {duration(seconds)} of processor time{sooner}"]
    lines = []
    for entry, size_px in sizes:
        sensor, rays = entry.asked.sensor, entry.image_samples * max(1, len(entry.channels))
        time = duration(sensor.width_px * sensor.height_px * rays * SECONDS_PER_RAY)
        lines.append(f"{entry.name}: {size_px}; an image takes about {time} of processor time at {rays} rays each")
    return lines
