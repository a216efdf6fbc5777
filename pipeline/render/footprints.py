"""Pixels that see only one colour: their value is that colour times the light of a white scene, without noise.

Beams, the rays of a few points of the sensor, show where the light of every pixel may come from; see
`camera.tracing.beams`. The judgement is conservative: a pixel of one colour may be called undecided, and is then
sampled. Light through the microlens of a pixel's cell and light through other microlenses are judged separately.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.camera.micro_images.centres import MicroImages
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.beams import NODES, RAYS, Beams, Blocks, beams_of
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, SKIP
from pipeline.render import footprint_kernels as kernels
from pipeline.render.band import Band, Rows
from pipeline.targets.patches import Patch

_TILE_PX = 32
"""Edge of a block of a sensor without microlenses [px]: a cubic fits its rays, and 16 nodes suffice for a thousand
pixels.
"""
_NODES_WITHIN = 0.75
"""Extent of the nodes behind a microlens over that of its light [1]: the corners of that square have no light."""
TOUCHING_MM = 1e-2
"""Margin around a solid [mm]: its true surface may lie so far in front of its mesh."""


class Places(NamedTuple):
    """Pixels and the blocks to which they belong.

    `positions`, (n, 2) float64: positions on the sensor, vision frame [mm].
    `blocks`, (n, s) int64: indices of the blocks; -1 for none.
    `centre_mm`, `step_mm`, (b, 2), (b,) float64: centres and node distances of the blocks.
    """

    positions: np.ndarray
    blocks: np.ndarray
    centre_mm: np.ndarray
    step_mm: np.ndarray


class Meeting(NamedTuple):
    """Points where beams meet a plane.

    `points`, (b, NODES^2, 2, RAYS) float64: x and y in the plane [mm].
    `side`, (b,) int64: see `footprint_kernels`.
    `more`, (b, 2) float64: margin of the footprints of pixels over the rays of their centres [mm].
    """

    points: np.ndarray
    side: np.ndarray
    more: np.ndarray


class Footprints:
    """Footprints of the pixels of some rows, on whatever is before the camera."""

    def __init__(self, band: Band) -> None:
        rig = band.rig
        blocks, blocks_of = (
            _tiles(rig.tracer, band.rows) if rig.images is None else _behind(rig, rig.images, band.strata)
        )
        # Diffraction widens what a pixel sees: as if its square were larger.
        self._edge_mm = rig.tracer.camera.sensor.pitch_mm + 2 * rig.diffraction.reach_mm
        self._blocks = blocks
        parts = blocks_of[:, :1], blocks_of[:, 1:]
        self._parts = [Places(band.positions_mm, np.ascontiguousarray(part), *blocks[1:]) for part in parts]
        self._beams: Beams = beams_of(rig.tracer.arrays, blocks)

    def undecided(self) -> np.ndarray:
        """NaN for both parts of each pixel, (2, n), for what no footprint can judge."""
        return np.full((len(self._parts), len(self._parts[0].positions)), np.nan)

    def judged(
        self, sheets: Sequence[tuple[Patch, np.ndarray]], solids: Sequence[np.ndarray], background: float
    ) -> np.ndarray:
        """Light that both parts of each pixel see, (2, n): that of the background, one colour of a sheet, or NaN if
        undecided.

        `sheets`, sequence of (Patch, (4, 4) float64): flat patches, each with its pose vision_from_patch.
        `solids`, sequence of (m, 3) float64: points of what else is there, whose bounding box holds it; vision frame
            [mm].
        """
        shape = len(self._parts), len(self._parts[0].positions)
        verdict, light = np.full(shape, kernels.NOTHING, np.int8), np.full(shape, background)
        for points in solids:
            low, high = points.min(axis=0) - TOUCHING_MM, points.max(axis=0) + TOUCHING_MM
            (left, bottom, front), (right, top, back) = low.tolist(), high.tolist()
            bounds = kernels.Box(left, right, bottom, top)
            near, far = (self._meeting(_across(z)) for z in (front, back))
            for part, judged in zip(self._parts, verdict, strict=True):
                kernels.look_past_solid(bounds, part, near, far, judged)
        for patch, pose in sheets:
            meeting, whole = self._meeting(pose), np.empty(len(self._blocks.step_mm))
            kernels.whole_blocks(patch.drawing.arrays, meeting, whole)
            sheet = patch.drawing.arrays, np.array(patch.colours)
            for part, judged, seen in zip(self._parts, verdict, light, strict=True):
                kernels.look_at_sheet(*sheet, part, meeting, whole, judged, seen)
        light[verdict == kernels.UNDECIDED] = np.nan
        return light

    def _meeting(self, vision_from_plane: np.ndarray) -> Meeting:
        count = len(self._blocks.step_mm)
        result = Meeting(np.empty((count, NODES * NODES, 2, RAYS)), np.empty(count, np.int64), np.empty((count, 2)))
        pose = np.ascontiguousarray(vision_from_plane)
        kernels.meet_plane(self._beams, pose, self._edge_mm, self._blocks.step_mm, result)
        return result


def _across(z_mm: float) -> np.ndarray:
    """The plane across the axis at vision z."""
    pose = np.eye(4)
    pose[2, 3] = z_mm
    return pose


def _tiles(tracer: Tracer, rows: Rows) -> tuple[Blocks, np.ndarray]:
    """Tiles of the sensor, the same for any rows, and the tile of each pixel (n, 1)."""
    width = tracer.camera.sensor.width_px
    across, first, end = -(-width // _TILE_PX), rows[0] // _TILE_PX, -(-rows[1] // _TILE_PX)
    y, x = (axis.ravel() for axis in np.mgrid[first:end, :across])
    middle = tracer.positions_mm(*((axis + 0.5) * _TILE_PX - 0.5 for axis in (x, y)))
    step = np.full(len(middle), _TILE_PX * tracer.camera.sensor.pitch_mm / (NODES - 1))
    row, column = np.mgrid[rows[0] : rows[1], :width]
    tile = (row // _TILE_PX - first) * across + column // _TILE_PX
    return Blocks(np.full(len(middle), NO_MICROLENS), middle, step), np.ascontiguousarray(tile.reshape(-1, 1))


def _behind(rig: Rig, images: MicroImages, strata: np.ndarray) -> tuple[Blocks, np.ndarray]:
    """The block lit by each microlens, and for each pixel the indices of its microlenses among them (n, s)."""
    microlens = np.unique(strata[strata != SKIP])
    place = np.full(len(images.centre_mm) + 1, -1)
    place[microlens] = np.arange(len(microlens))
    reach = images.reach_mm[microlens] + rig.tracer.camera.sensor.pitch_mm + rig.diffraction.reach_mm
    step = 2 * _NODES_WITHIN * reach / (NODES - 1)
    blocks_of = place[np.where(strata == SKIP, -1, strata)]
    return Blocks(microlens, np.ascontiguousarray(images.centre_mm[microlens]), step), blocks_of
