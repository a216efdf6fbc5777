"""Pixels of uniform colour: such a pixel is its colour times the light of a white scene, without noise.

Beams, the rays of a few sensor points, bound where the light of every pixel may come from; see `camera.tracing.beams`.
The judgement is conservative: a pixel of uniform colour may be called undecided, and is then sampled. Light through the
microlens of a pixel's cell and light through other microlenses are judged separately.

A footprint is a box around the points where the beam of a pixel meets a plane, interpolated by cubics in x and y from
the rays of its block. The box is enlarged by a seventh of its size, because of rays between the traced ones; by the
extent of the pixel's square; and by the possible error of the cubics.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.camera.micro_images.centres import MicroImages
from pipeline.camera.rig import Rig
from pipeline.camera.tracing.beams import NODES, RAYS, Beams, Blocks, beams_of
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, SKIP
from pipeline.jit.decorators import inline, kernel
from pipeline.render.pixel_rays import Band
from pipeline.targets.drawing import BESIDE, MIXED, colour_of_box
from pipeline.targets.surface_kernels import on_plane
from pipeline.targets.surfaces import Patch
from pipeline.targets.vectors import row

_TILE_PX = 32
"""Edge of a block of a sensor without microlenses [px]: cubics through 16 nodes suffice for its thousand pixels."""
_NODES_WITHIN = 0.75
"""Extent of the nodes behind a microlens over that of its light [1]: the corners of that square have no light."""
TOUCHING_MM = 1e-2
"""Margin around a solid [mm]: its true surface may lie so far in front of its mesh."""
BEHIND, FRONT, BACK, ODD = range(4)
"""Relation of all rays of a beam to a plane: behind their start, meeting its front, its back, or mixed [1]."""
NOTHING, SHEET, UNDECIDED = range(3)
"""Verdict about a pixel: it sees the background only, one colour of one sheet, or possibly several surfaces."""
_FOOTPRINT_GROWTH = 1.15
"""Enlargement of a footprint over the box around its rays [1]."""
_BLOCK_GROWTH = 1.5
"""Enlargement of a block over the box around its nodes [1]: a microlens lights two thirds of a step beyond them."""
_SQUARE = 0.6
"""Part of a pixel's edge by which footprints grow [1]: half of it, and more because blocks are not quite linear."""
_LAST_TERM = 0.25
"""Part of the last term of a cubic that bounds the next one [1], also two thirds of a step beyond the nodes."""


class Box(NamedTuple):
    """A box across the axis or in a plane [mm]."""

    left: float
    right: float
    bottom: float
    top: float


class BlockPixels(NamedTuple):
    """Pixels and the blocks to which they belong."""

    positions: np.ndarray  # (n, 2), on the sensor, vision frame [mm]
    blocks: np.ndarray  # (n, s), indices of the blocks; -1 for none
    # (b, 2), (b,), centres and node distances of the blocks
    centre_mm: np.ndarray
    step_mm: np.ndarray


class Meeting(NamedTuple):
    """Intersections of beams with a plane."""

    points: np.ndarray  # (b, NODES^2, 2, RAYS), x and y in the plane [mm]
    side: np.ndarray  # (b,), relation of all rays of a beam to the plane
    margin: np.ndarray  # (b, 2), margin of the footprints of pixels over the rays of their centres [mm]


class Footprints:
    """Footprints of the pixels of a band on the objects before the camera."""

    def __init__(self, band: Band) -> None:
        rig = band.rig
        blocks, blocks_of = _tiles(band) if rig.images is None else _behind(rig, rig.images, band.strata)
        # Diffraction widens what a pixel sees: as if its square were larger.
        self._edge_mm = rig.tracer.camera.sensor.pitch_mm + 2 * rig.diffraction.reach_mm
        self._blocks = blocks
        # Light through the microlens of the pixel's cell, and through the others
        parts = blocks_of[:, :1], blocks_of[:, 1:]
        self._parts = [BlockPixels(band.positions_mm, np.ascontiguousarray(part), *blocks[1:]) for part in parts]
        self._beams: Beams = beams_of(rig.tracer.arrays, blocks)

    def undecided(self) -> np.ndarray:
        """NaN for each pixel through the microlens of its cell and through the others, (2, n): no footprint can judge
        the objects.
        """
        return np.full((len(self._parts), len(self._parts[0].positions)), np.nan)

    def uniform_light(
        self, sheets: Sequence[tuple[Patch, np.ndarray]], solids: Sequence[np.ndarray], background: float
    ) -> np.ndarray:
        """Radiance that each pixel sees through the microlens of its cell, and through the others, (2, n): that of the
        background, or of one colour of one sheet; NaN if it may see both, or a solid. Its unit is that of `background`
        and of the colours of patches.

        `sheets`: flat patches with their poses vision_from_patch.
        `solids`: points (m, 3) of the meshes of everything else, vision frame [mm].
        """
        shape = len(self._parts), len(self._parts[0].positions)
        verdict = np.full(shape, NOTHING, np.int8)
        light = np.full(shape, background)
        for points in solids:
            left, bottom, front = (points.min(axis=0) - TOUCHING_MM).tolist()
            right, top, back = (points.max(axis=0) + TOUCHING_MM).tolist()
            bounds = Box(left, right, bottom, top)
            # Front and back end of the solid, vision frame
            planes_across_axis = np.tile(np.eye(4), (2, 1, 1))
            planes_across_axis[:, 2, 3] = front, back
            near, far = map(self._meeting, planes_across_axis)
            for part, its_verdict in zip(self._parts, verdict, strict=True):
                judge_solid(bounds, part, near, far, its_verdict)  # writes its_verdict
        for patch, pose in sheets:
            meeting = self._meeting(pose)
            colour_of_block = np.empty(len(self._blocks.step_mm))
            colours_of_blocks(patch.drawing.arrays, meeting, colour_of_block)
            drawing_and_colours = patch.drawing.arrays, np.array(patch.colours)
            for part, its_verdict, its_light in zip(self._parts, verdict, light, strict=True):
                # writes its_verdict and its_light
                judge_sheet(*drawing_and_colours, part, meeting, colour_of_block, its_verdict, its_light)
        light[verdict == UNDECIDED] = np.nan
        return light

    def _meeting(self, vision_from_plane: np.ndarray) -> Meeting:
        """Intersections of all beams with the plane z = 0 of a frame."""
        count = len(self._blocks.step_mm)
        result = Meeting(np.empty((count, NODES * NODES, 2, RAYS)), np.empty(count, np.int64), np.empty((count, 2)))
        pose = np.ascontiguousarray(vision_from_plane)
        meet_plane(self._beams, pose, self._edge_mm, self._blocks.step_mm, result)
        return result


def _tiles(band: Band) -> tuple[Blocks, np.ndarray]:
    """Tiles of the sensor, independent of the rows and columns of the band, and the tile of each pixel (n, 1)."""
    tracer = band.rig.tracer
    down, across = ((first // _TILE_PX, -(-end // _TILE_PX)) for first, end in (band.rows, band.columns))
    y, x = (axis.ravel() for axis in np.mgrid[slice(*down), slice(*across)])
    middle = tracer.positions_mm((x + 0.5) * _TILE_PX - 0.5, (y + 0.5) * _TILE_PX - 0.5)
    step = np.full(len(middle), _TILE_PX * tracer.camera.sensor.pitch_mm / (NODES - 1))
    row, column = np.mgrid[slice(*band.rows), slice(*band.columns)]
    tile = (row // _TILE_PX - down[0]) * (across[1] - across[0]) + column // _TILE_PX - across[0]
    return Blocks(np.full(len(middle), NO_MICROLENS), middle, step), np.ascontiguousarray(tile.reshape(-1, 1))


def _behind(rig: Rig, images: MicroImages, strata: np.ndarray) -> tuple[Blocks, np.ndarray]:
    """The block lit by each microlens, and for each pixel the indices of its microlenses among them (n, s)."""
    microlens = np.unique(strata[strata != SKIP])
    index = np.full(len(images.centre_mm) + 1, -1)
    index[microlens] = np.arange(len(microlens))
    reach = images.reach_mm[microlens] + rig.tracer.camera.sensor.pitch_mm + rig.diffraction.reach_mm
    step = 2 * _NODES_WITHIN * reach / (NODES - 1)
    blocks_of = index[np.where(strata == SKIP, -1, strata)]
    return Blocks(microlens, np.ascontiguousarray(images.centre_mm[microlens]), step), blocks_of


@kernel
def meet_plane(beams, pose, edge_mm, step_mm, meeting):
    """Intersect the beams of blocks with the plane z = 0 of a frame; `meeting` is written."""
    for b in range(step_mm.shape[0]):
        front, back, behind = 0, 0, 0
        for m in range(NODES * NODES):
            for k in range(RAYS):
                t, x, y, towards = on_plane(pose, row(beams.origin[b, m], k), row(beams.direction[b, m], k))
                meeting.points[b, m, 0, k], meeting.points[b, m, 1, k] = x, y
                front += t > 0.0 and towards < 0.0
                back += t > 0.0 and towards > 0.0
                behind += t < 0.0
        meeting.side[b] = ODD
        if beams.is_complete[b]:
            for side, count in ((FRONT, front), (BACK, back), (BEHIND, behind)):
                if count == NODES * NODES * RAYS:
                    meeting.side[b] = side
        for axis in range(2):
            meeting.margin[b, axis] = _margin(meeting.points[b], axis, edge_mm / step_mm[b])


@inline
def _margin(points, axis, edge_steps):
    """Margin [mm] of a footprint beyond the box about the rays of a pixel's centre, on both sides along an axis of the
    plane.

    It has two terms: the steepest step between nodes times the edge of the pixel's square, and a part of the largest
    third difference, which bounds the error of the cubics.

    `points`, (NODES^2, 2, RAYS) [mm]: the intersections of one block.
    `edge_steps`: the edge of the pixel's square in distances of nodes.
    """
    steepest_steps, third_differences = 0.0, 0.0  # sums over both directions of the grid of nodes
    for direction in range(2):
        stride, line_stride = (1, NODES) if direction == 0 else (NODES, 1)
        steepest, third = 0.0, 0.0
        for line in range(NODES):
            for k in range(RAYS):
                first = line * line_stride
                a, b = points[first, axis, k], points[first + stride, axis, k]
                c, d = points[first + 2 * stride, axis, k], points[first + 3 * stride, axis, k]
                steepest = max(steepest, max(abs(b - a), max(abs(c - b), abs(d - c))))
                third = max(third, abs(d - 3.0 * c + 3.0 * b - a))
        steepest_steps += steepest
        third_differences += third
    return _SQUARE * edge_steps * steepest_steps + _LAST_TERM * third_differences


@kernel
def colours_of_blocks(drawing, meeting, colour):
    """Colour of everything that each block sees of a sheet, (b,), written: black 0, white 1, `BESIDE` or `MIXED`."""
    for b in range(colour.shape[0]):
        colour[b] = MIXED
        if meeting.side[b] == BEHIND:
            colour[b] = BESIDE
        elif meeting.side[b] != ODD:
            left, right, bottom, top = math.inf, -math.inf, math.inf, -math.inf
            for m in range(NODES * NODES):
                for k in range(RAYS):
                    left, right = min(left, meeting.points[b, m, 0, k]), max(right, meeting.points[b, m, 0, k])
                    bottom, top = min(bottom, meeting.points[b, m, 1, k]), max(top, meeting.points[b, m, 1, k])
            left, right, bottom, top = _enlarged(left, right, bottom, top, _BLOCK_GROWTH, meeting.margin[b])
            colour[b] = colour_of_box(drawing, left, right, bottom, top)


@inline
def _enlarged(left, right, bottom, top, factor, margin):
    """A box enlarged about its middle by a factor, and then by a margin (2,) on every side."""
    x, y = 0.5 * (left + right), 0.5 * (bottom + top)
    half_x, half_y = factor * (right - x) + margin[0], factor * (top - y) + margin[1]
    return x - half_x, x + half_x, y - half_y, y + half_y


@kernel
def judge_sheet(drawing, colours, pixels, meeting, colour_of_block, verdict, light):
    """Update the verdicts of pixels by one more sheet.

    `colours`, (2,) float64: radiance of black and of white.
    `colour_of_block`, (b,) float64: colours from `colours_of_blocks`.
    `verdict`, (n,) int8: read and written.
    `light`, (n,) float64: written where a pixel sees the sheet alone, and one colour of it.
    """
    u, v = np.empty(RAYS), np.empty(RAYS)
    for n in range(verdict.shape[0]):
        common_colour = math.nan
        faces = ODD
        for j in range(pixels.blocks.shape[1]):
            b = pixels.blocks[n, j]
            if b < 0 or verdict[n] == UNDECIDED:
                continue
            colour = colour_of_block[b]
            if colour == MIXED and meeting.side[b] != ODD:
                left, right, bottom, top = _footprint(meeting, b, pixels, n, u, v)
                colour = colour_of_box(drawing, left, right, bottom, top)
            side = BEHIND if colour == BESIDE else meeting.side[b]
            if colour == MIXED or not (math.isnan(common_colour) or (common_colour == colour and faces == side)):
                verdict[n] = UNDECIDED
            common_colour, faces = colour, side
        if verdict[n] == UNDECIDED or math.isnan(common_colour) or common_colour == BESIDE:
            continue
        if verdict[n] == SHEET:  # another sheet is seen, too
            verdict[n] = UNDECIDED
            continue
        verdict[n] = SHEET
        light[n] = 0.0 if faces == BACK else colours[int(common_colour)]


@inline
def _footprint(meeting, b, pixels, n, u, v):
    """The box of the beam of pixel `n` in a plane, from block `b`; `u` and `v` (RAYS,) are overwritten."""
    per_step = 1.0 / pixels.step_mm[b]
    x = (pixels.positions[n, 0] - pixels.centre_mm[b, 0]) * per_step + 0.5 * (NODES - 1)
    y = (pixels.positions[n, 1] - pixels.centre_mm[b, 1]) * per_step + 0.5 * (NODES - 1)
    wx, wy = _cubic(x), _cubic(y)
    for k in range(RAYS):
        u[k], v[k] = 0.0, 0.0
    for j in range(NODES):
        for i in range(NODES):
            w, m = wx[i] * wy[j], j * NODES + i
            for k in range(RAYS):
                u[k] += w * meeting.points[b, m, 0, k]
                v[k] += w * meeting.points[b, m, 1, k]
    left, right, bottom, top = u[0], u[0], v[0], v[0]
    for k in range(1, RAYS):
        left, right, bottom, top = min(left, u[k]), max(right, u[k]), min(bottom, v[k]), max(top, v[k])
    return _enlarged(left, right, bottom, top, _FOOTPRINT_GROWTH, meeting.margin[b])


@inline
def _cubic(x):
    """Weights of the nodes 0, 1, 2, 3 in the cubic through them at x, by Lagrange."""
    a, b, c, d = x, x - 1.0, x - 2.0, x - 3.0
    return -b * c * d / 6.0, 0.5 * a * c * d, -0.5 * a * b * d, a * b * c / 6.0


@kernel
def judge_solid(bounds, pixels, near, far, verdict):
    """Mark pixels as undecided if they may see an object in addition to the background or a sheet.

    Between two planes a ray stays within the boxes that it meets on both.

    `bounds`, Box: around the object, vision frame.
    `near`, `far`, Meeting: intersections with the planes across the axis at its ends.
    """
    u, v = np.empty(RAYS), np.empty(RAYS)
    for n in range(verdict.shape[0]):
        for j in range(pixels.blocks.shape[1]):
            b = pixels.blocks[n, j]
            if b < 0 or verdict[n] == UNDECIDED or (near.side[b] == BEHIND and far.side[b] == BEHIND):
                continue
            if near.side[b] == ODD or near.side[b] != far.side[b]:
                verdict[n] = UNDECIDED
                continue
            left, right, bottom, top = _footprint(near, b, pixels, n, u, v)
            far_left, far_right, far_bottom, far_top = _footprint(far, b, pixels, n, u, v)
            left, right = min(left, far_left), max(right, far_right)
            bottom, top = min(bottom, far_bottom), max(top, far_top)
            # Written as "not beside", so that it also holds for a NaN bound.
            if not (right < bounds.left or left > bounds.right or top < bounds.bottom or bottom > bounds.top):
                verdict[n] = UNDECIDED
