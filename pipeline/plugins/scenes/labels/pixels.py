"""Labels of pixels: means over the rays of a pixel, weighted by their light, spreads, and shares of light.

CONVENTIONS.md, "Labels", defines each number.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.frames import apply
from pipeline.plugins.scenes.labels.sight_lines import SETTLED_PX, SightLines
from pipeline.plugins.scenes.labels.things import LabelledScene
from pipeline.records.shapes import Bool, Float32, Float64
from pipeline.render.pixel_rays import Band, Batch, PixelRays, rays_of
from pipeline.render.spectral.preview import srgb_encoded

RANKS = 6
"""Things of a pixel whose ids are kept, those of most light: three layers of Cryptomatte, as most programs write."""
_TURNS = 12
"""Steps of the fixed-point iteration for a point in the line that is exposed when it is there [1]: each leaves the part
of the error by which the image moves during the scan."""
LinesOfFrames = tuple[SightLines, SightLines]
"""Mean rays of a camera in a frame, and in the next."""


@dataclass(frozen=True, slots=True)
class Requested:
    """Labels that are asked for in a frame."""

    tokens: tuple[str, ...]
    targets: tuple[str, ...]  # names of the targets, which are the first things, if their shares are
    mattes: dict[str, np.ndarray]  # ids of all things, (things,) float32, by the name of the matte
    world_from_vision: Float64[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))

    @property
    def channels(self) -> list[str]:
        """Names of the channels in their order; those of mattes are the last."""
        names = ["A"]
        for token, of_token in _CHANNELS.items():
            names += of_token if token in self.tokens else []
        names += [f"targets.{name}" for name in self.targets]
        for matte in self.mattes:
            names += [f"{matte}{rank // 2:02d}.{part}" for rank in range(RANKS) for part in ("RG", "BA")[rank % 2]]
        return names


class _LabelledPixels:
    """Pixels of a batch, with the first hits of their rays."""

    def __init__(
        self, rays: PixelRays, scene: LabelledScene, request: Requested, band: Band, lines: LinesOfFrames | None
    ) -> None:
        self._rays = rays
        self._band = band
        self._lines = lines
        self._request = request
        self._faces = scene.faces
        self._later = scene.later
        self._hits = scene.first_hits(rays)
        self._row = rays.row[self._hits.ray]  # pixel of each hit
        self._weight = rays.leaving.share[self._hits.ray]
        self._pixels = len(rays.pixels)
        self._sum = np.bincount(rays.row, rays.leaving.share, minlength=self._pixels)

    def columns(self) -> np.ndarray:
        """All channels, (pixels, channels) float32."""
        parts = [self._share(self._hits.thing >= 0)]
        point, world = self._hits.point_mm, self._request.world_from_vision
        of_tokens = {
            "depth": lambda: self._mean(point[:, 2:]),
            "range": lambda: self._mean(np.linalg.norm(point, axis=1, keepdims=True)),
            "position": lambda: self._mean(apply(world, point)),
            "normal": lambda: self._mean(self._hits.normal @ world[:3, :3].T),
            "board": self._board,
            "flow": self._flow,
        }
        parts += [of_tokens[token]() for token in _CHANNELS if token in self._request.tokens]
        parts += [self._share(self._hits.thing == number) for number in range(len(self._request.targets))]
        # Ids are bits of single precision: no arithmetic may touch them.
        mattes = [self._matte(ids) for ids in self._request.mattes.values()]
        return np.column_stack([*(part.astype(np.float32) for part in parts), *mattes])

    def _board(self) -> np.ndarray:
        """Mean point in the chart of the face with most light, its share, and the numbers of target and face."""
        row, face, light, _ = self._grouped(self._hits.face, self._hits.face >= 0)
        # The last assignment stays: the face with most light, of equals the first.
        order = np.lexsort((-face, light))
        brightest = np.full(self._pixels, -1)
        brightest[row[order]] = face[order]
        is_on = (self._hits.face >= 0) & (self._hits.face == brightest[self._row])
        chart = self._mean(self._hits.sheet_mm, is_on)
        faces = np.array([*self._faces, (np.nan, np.nan)])
        return np.column_stack([chart[:, :2], self._share(is_on), faces[brightest], chart[:, 2]])

    def _flow(self) -> np.ndarray:
        """Optical flow: displacement in the image of the mean point of each thing, averaged over things."""
        assert self._lines is not None
        lines, next_lines = self._lines
        moving = (self._rays.route[self._hits.ray] == 0) & np.isfinite(self._hits.later_mm).all(axis=1)
        row, thing, light, group = self._grouped(self._hits.thing, moving)
        points = np.concatenate([self._hits.point_mm, self._hits.later_mm], axis=1)[moving]
        means = _mean(points, self._weight[moving], group, len(row))
        cell = self._band.strata[self._rays.pixels[row], 0]
        start = lines.positions(means[:, :3], cell, self._rays.squares.pixels[row].astype(float))
        flow = self._positions_later(next_lines, means[:, 3:6], thing, cell, start) - start
        is_known = np.isfinite(flow).all(axis=1)
        return _mean(flow[is_known], light[is_known], row[is_known], self._pixels)

    def _positions_later(
        self, lines: SightLines, points_mm: np.ndarray, thing: np.ndarray, cell: np.ndarray, start_px: np.ndarray
    ) -> np.ndarray:
        """Positions of points of things in the next frame, (n, 2); with a shutter each at the time of its line."""
        later = self._later
        if later.shutter is None:
            return lines.positions(points_mm, cell, start_px)
        x_px = before = start_px
        for _ in range(_TURNS):
            before = x_px
            moved_mm = later.at(points_mm, thing, later.shutter.middle_s(before, lines.size_px))
            x_px = lines.positions(moved_mm, cell, before)
        has_settled = np.abs(x_px - before).max(axis=1) < SETTLED_PX
        return np.where(has_settled[:, None], x_px, np.nan)

    def _matte(self, ids: Float32[np.ndarray, "things"]) -> np.ndarray:
        """Ids and shares of the things with most light, alternating, (pixels, 2 RANKS)."""
        names, number = np.unique(ids, return_inverse=True)
        row, name, light, _ = self._grouped(number[self._hits.thing], self._hits.thing >= 0)
        order = np.lexsort((name, -light, row))
        row, name, light = row[order], name[order], light[order]
        rank = np.arange(len(row)) - np.searchsorted(row, row)
        is_ranked = rank < RANKS
        result = np.zeros((self._pixels, RANKS, 2), np.float32)
        result[row[is_ranked], rank[is_ranked], 0] = names[name[is_ranked]]
        result[row[is_ranked], rank[is_ranked], 1] = (light / self._sum[row])[is_ranked]
        return result.reshape(self._pixels, -1)

    def _share(self, chosen: Bool[np.ndarray, "n"]) -> np.ndarray:
        """Share of the chosen rays in the light of each pixel, (pixels,)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.bincount(self._row[chosen], self._weight[chosen], minlength=self._pixels) / self._sum)

    def _mean(
        self, values: Float64[np.ndarray, "n k"], chosen: Bool[np.ndarray, "n"] | slice = slice(None)
    ) -> np.ndarray:
        """Mean of values of the chosen rays in each pixel, and behind it their spread, (pixels, k + 1)."""
        return _mean(values[chosen], self._weight[chosen], self._row[chosen], self._pixels)

    def _grouped(self, number: np.ndarray, chosen: Bool[np.ndarray, "n"]) -> tuple[np.ndarray, ...]:
        """Groups of rays of one pixel and number: pixel, number and light of each group, and the group of each ray."""
        stride = int(number.max(initial=0)) + 1
        keys, group = np.unique(self._row[chosen] * stride + number[chosen], return_inverse=True)
        return keys // stride, keys % stride, np.bincount(group, self._weight[chosen], minlength=len(keys)), group


def _mean(values: np.ndarray, weight: np.ndarray, row: np.ndarray, rows: int) -> np.ndarray:
    """Weighted means of values (n, k) in each row, and their spread, (rows, k + 1); NaN in an empty row."""
    total = np.bincount(row, weight, minlength=rows)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.stack([np.bincount(row, weight * v, minlength=rows) / total for v in values.T], axis=1)
        squares = np.square(values - mean[row]).sum(axis=1)
        return np.column_stack([mean, np.sqrt(np.bincount(row, weight * squares, minlength=rows) / total)])


_CHANNELS = {
    "depth": ["Z", "spread.Z"],
    "range": ["range", "spread.range"],
    "position": ["P.X", "P.Y", "P.Z", "spread.P"],
    "normal": ["N.X", "N.Y", "N.Z", "spread.N"],
    "board": ["board.U", "board.V", "board.share", "board.target", "board.face", "spread.board"],
    "flow": ["flow.X", "flow.Y", "spread.flow"],
}
"""Channels of a token, in the order in which they are computed."""


def labels_of(
    band: Band, samples: int, scenes: Sequence[tuple[LabelledScene, Requested]], lines: LinesOfFrames | None = None
) -> list[np.ndarray]:
    """Labels of the pixels of a band in several scenes, which share their rays: (h, w, channels) float32 each.

    `lines`: those of the camera now and in the next frame, if flow is among the labels.
    """
    results = []
    for _, request in scenes:
        result = np.full((len(band.strata), len(request.channels)), np.nan, np.float32)
        result[:, result.shape[1] - 2 * RANKS * len(request.mattes) :] = 0.0
        results.append(result)
    for rays in rays_of(band, Batch(samples), np.where(band.strata == SKIP, 0, samples)):
        for result, (scene, request) in zip(results, scenes, strict=True):
            result[rays.pixels] = _LabelledPixels(rays, scene, request, band, lines).columns()
    return [result.reshape(*band.shape, -1) for result in results]


PREVIEWED = "A", "Z", "CryptoObject00.R", "CryptoObject00.G"
"""Channels that `preview` shows, if they exist."""
_DARKEST = 0.15
"""Brightness of the farthest thing, and of red, green and blue in the colour of any [1]: nothing vanishes."""


def preview(channels: dict[str, Float32[np.ndarray, "h w"]]) -> np.ndarray:
    """An sRGB picture, (h, w, 3) uint8."""
    picture = np.repeat(np.nan_to_num(channels["A"].astype(float))[..., None], 3, axis=2)
    if PREVIEWED[-1] in channels:
        bits = np.ascontiguousarray(channels[PREVIEWED[-2]]).view(np.uint32)[..., None]
        hue = (bits >> np.array([0, 7, 14], np.uint32) & 127) / 127
        picture = channels[PREVIEWED[-1]][..., None] * (_DARKEST + (1 - _DARKEST) * hue)
    if "Z" in channels and np.isfinite(channels["Z"]).any():
        z_mm = channels["Z"].astype(float)
        nearness = (np.nanmax(z_mm) - z_mm) / max(float(np.ptp(z_mm[np.isfinite(z_mm)])), 1.0)
        picture = picture * (_DARKEST + (1 - _DARKEST) * np.nan_to_num(nearness))[..., None]
    return np.rint(255 * srgb_encoded(np.clip(picture, 0.0, 1.0))).astype(np.uint8)
