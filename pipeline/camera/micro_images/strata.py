"""Microlenses that light each pixel of some rows of the image.

Microlenses are laid onto the pixels that they may light, instead of looking up those of every pixel in a tree.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.micro_images.centres import MicroImages
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, SKIP
from pipeline.jit.decorators import kernel

_SLACK_PX = math.sqrt(0.5)
"""Circumradius of a pixel."""


class _Discs(NamedTuple):
    """Discs on the sensor: centres [mm] and [px], the latter counted in the rows that are wanted; reach [mm]."""

    centre_mm: np.ndarray
    centre_px: np.ndarray
    reach_mm: np.ndarray
    farthest_mm: float
    farthest_px: float


def pixel_strata(
    tracer: Tracer, images: MicroImages | None, rows: tuple[int, int], spread_mm: float = 0.0
) -> np.ndarray:
    """Microlenses that light of each pixel of some rows may pass, nearest first: its own cell's, (n, s) int64.

    Diffraction may spread light by `spread_mm` more than geometry lets it go.
    """
    width = tracer.camera.sensor.width_px
    count = (rows[1] - rows[0]) * width
    if images is None:
        return np.full((count, 1), NO_MICROLENS)
    slack_mm = tracer.camera.sensor.pitch_mm * _SLACK_PX + spread_mm
    farthest_mm = float(images.reach_mm.max()) + slack_mm
    centre_px = tracer.pixels_at(images.centre_mm) - [0.0, rows[0]]
    farthest_px = farthest_mm / tracer.camera.sensor.pitch_mm + 1e-6
    discs = _Discs(images.centre_mm, centre_px, images.reach_mm + slack_mm, farthest_mm, farthest_px)
    positions = positions_of(tracer, rows)
    filled = np.zeros(count, np.int64)
    _lay(discs, positions, width, np.zeros((count, 0)), np.zeros((count, 0), np.int64), filled)
    places = max(1, int(filled.max()))
    strata, distance = np.full((count, places), SKIP), np.zeros((count, places))
    filled[:] = 0
    _lay(discs, positions, width, distance, strata, filled)
    return strata


def positions_of(tracer: Tracer, rows: tuple[int, int]) -> np.ndarray:
    """Centres of the pixels of some rows, vision frame (n, 2) [mm]."""
    width = tracer.camera.sensor.width_px
    y_px, x_px = np.divmod(np.arange(rows[0] * width, rows[1] * width), width)
    return tracer.positions_mm(x_px, y_px)


@kernel
def _lay(discs, positions, width, distance, strata, filled):
    """Sort discs into the pixels that they reach, nearest first; without room for them they are only counted.

    A disc beyond its own reach keeps its place as `SKIP`: the first place is that of the pixel's own cell.
    """
    height = positions.shape[0] // width
    for microlens in range(discs.centre_mm.shape[0]):
        x, y, far = discs.centre_px[microlens, 0], discs.centre_px[microlens, 1], discs.farthest_px
        if not (x > -far - 1.0 and x < width + far and y > -far - 1.0 and y < height + far):
            continue
        for j in range(max(0, math.ceil(y - far)), min(height - 1, math.floor(y + far)) + 1):
            for i in range(max(0, math.ceil(x - far)), min(width - 1, math.floor(x + far)) + 1):
                n = j * width + i
                across = positions[n, 0] - discs.centre_mm[microlens, 0]
                up = positions[n, 1] - discs.centre_mm[microlens, 1]
                away = math.sqrt(across * across + up * up)
                if away > discs.farthest_mm:
                    continue
                place = filled[n]
                filled[n] += 1
                if distance.shape[1] == 0:
                    continue
                while place > 0 and distance[n, place - 1] > away:
                    distance[n, place], strata[n, place] = distance[n, place - 1], strata[n, place - 1]
                    place -= 1
                distance[n, place] = away
                strata[n, place] = microlens if away <= discs.reach_mm[microlens] else SKIP
