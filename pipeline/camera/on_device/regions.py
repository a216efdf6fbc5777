"""Regions that bundles may pass, many at once: a thread of a device bounds each. They stay on the device."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pipeline.camera.parts.polygon import MAX_VERTICES
from pipeline.camera.tracing.sampling_bounds import bound
from pipeline.jit.decorators import inline
from pipeline.jit.device import room

AT_ONCE, THREADS = 1 << 16, 64
"""Regions that are on the device together, 2 kB each; threads of a block that bounds them."""


class Regions(NamedTuple):
    """Regions that many bundles may pass."""

    # (n, MAX_VERTICES, 2), (n, MAX_VERTICES) float64, polygons, and cumulative areas of their fans
    polygons: np.ndarray
    cumulative: np.ndarray
    # (n,) int64, (n, 2), (n,) float64, the fans, of area 0 where nothing passes: see `tracing.sampling_bounds.Fan`
    vertices: np.ndarray
    centre: np.ndarray
    area: np.ndarray


def room_for_regions(count: int, room: Callable[..., Any] = room) -> Regions:
    """Room for so many regions, on the device unless `room` makes other arrays."""
    polygons, cumulative = room((count, MAX_VERTICES, 2)), room((count, MAX_VERTICES))
    return Regions(polygons, cumulative, room(count, np.int64), room((count, 2)), room(count))


def blocks_for(count: int, threads: int = THREADS) -> int:
    """Blocks of so many threads with at least `count` of them."""
    return -(-count // threads)


@inline
def write_region(camera, microlens, x, y, slack, region, regions, n):
    """Bound the rays of a sensor position, as region number n; `region` is a `tracing.sampling_bounds.Region` that
    holds the polygon and the areas of that number."""
    fan = bound(camera, microlens, x, y, slack, region)
    regions.vertices[n], regions.area[n] = fan.vertices, fan.area
    regions.centre[n, 0], regions.centre[n, 1] = fan.x, fan.y
