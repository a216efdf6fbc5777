"""Sizes of tasks for forecasts: numbers proportional to their work, and a coarse cost where nothing has run yet."""

from collections.abc import Iterable
from typing import Any

from pipeline.engine.planning.explain import duration
from pipeline.engine.planning.forecast import Cost
from pipeline.engine.planning.graph import TaskGraph
from pipeline.graph.dataset_graph import graph_of
from pipeline.scene.dataset import CameraEntry, Dataset

SECONDS_PER_RAY = 1e-7
"""Processor time of one ray of an image or a bundle [s]: tiles of white images took 85 ns through 12 surfaces and 40 ns
behind microlenses, tiles of images of boards up to 90 ns, on a core of an AMD EPYC on 24 November 2026. Slower
processors take two or three times as long, and so do lamps that shine on a scene.
"""
_SHARE_OF_GLOWING = 0.3
"""Share of its rays that an image without lamps takes: it has those of the white image, and few outside the targets."""
_SECONDS_PER_TASK = 0.05
"""Processor time of a task besides such rays [s]: tiles of truth took 0.3 s there, and most others less than this."""
_LONG_S = 60.0
"""Processor time from which a preview is worth a word [s]."""


def size(_: str, params: dict[str, Any]) -> float:
    """Rays of a task per pixel of the sensor, or of a band of its rows; 0 if its params have no samples.

    The resolution of the sensor is not considered: after it was edited, a forecast states the cost of the old one.
    """
    rows = params["end_row"] - params["first_row"] if "end_row" in params else 1
    rays = params.get("sampling") or params.get("exposure") or {}
    # Passes double the samples; how many rows a strip has is forgotten as a tile's is.
    rows *= 1 << max(0, params.get("number", 0) - 1)
    return float(rows * rays.get("supersampling", 1) ** 2 * rays.get("samples", 0))


def assumed_cost(graph: TaskGraph, name: str) -> Cost:
    """Cost of a task of which nothing is known but its rays. Passes after the first one, which may not be needed, count
    nothing.
    """
    params, rays = graph[name].params, 0.0
    how = params.get("sampling") or params.get("exposure")
    if how and not params.get("tiles") and not params.get("number"):
        while "camera" in graph[name].reads:
            name = graph[name].reads["camera"]
        focus = graph[name].params
        sensor = (focus["camera"] or focus["request"])["sensor"]
        first, end = params.get("rows") or (params.get("first_row", 0), params.get("end_row", sensor["height_px"]))
        rays = (end - first) * sensor["width_px"] * how["samples"] * how.get("supersampling", 1) ** 2
        rays *= _SHARE_OF_GLOWING if "view" in params and params["view"]["lighting"] is None else 1.0
    return Cost(cpu_seconds=_SECONDS_PER_TASK + rays * SECONDS_PER_RAY, rays=rays, peak_bytes=0)


def cost_lines(dataset: Dataset | None, cameras: Iterable[CameraEntry]) -> list[str]:
    """What a dataset, or an image of each camera of a rig, will cost, said before anything has run."""
    sensors = {entry.name: entry.asked.sensor for entry in cameras}
    sizes = {name: f"{sensor.width_px} x {sensor.height_px} px" for name, sensor in sensors.items()}
    if dataset:
        graph, frames = graph_of(dataset)[0], len(dataset.frames)
        seconds = sum(assumed_cost(graph, name).cpu_seconds for name in graph)
        what = (
            f"{frames} frame{'s' * (frames != 1)} of {' and '.join(dict.fromkeys(sizes.values()))}, {len(graph)} tasks"
        )
        sooner = "; `pipeline build --preview` makes small pictures first" if seconds > _LONG_S else ""
        return [f"{what}: about {duration(seconds)} of processor time{sooner}"]
    lines = []
    for entry in cameras:
        sensor, rays = sensors[entry.name], entry.image_samples * max(1, len(entry.channels))
        time = duration(sensor.width_px * sensor.height_px * rays * SECONDS_PER_RAY)
        lines.append(
            f"{entry.name}: {sizes[entry.name]}; an image takes about {time} of processor time at {rays} rays each"
        )
    return lines
