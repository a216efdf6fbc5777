"""Labels of pixels: what each sees, by the light that it receives, as means over its rays, spreads and shares.

CONVENTIONS.md, "Labels", defines each number.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.frames import apply
from pipeline.records.shapes import Float32, Float64, Int64
from pipeline.render.labels.sight_lines import SightLines
from pipeline.render.labels.things import Things
from pipeline.render.pixel_rays import Band, Batch, PixelRays, rays_of

RANKS = 6
"""Things of a pixel whose ids are kept, those with most light: three layers of Cryptomatte, as most programs write."""
_NO_ID = np.float32(0.0)
"""The id of a rank that nothing has."""


@dataclass(frozen=True, slots=True)
class Asked:
    """Labels that are asked for in a frame."""

    tokens: tuple[str, ...]
    world_from_vision: Float64[np.ndarray, "4 4"]
    targets: tuple[str, ...]  # names of the targets, which are the first things
    mattes: dict[str, np.ndarray]  # ids of all things, (things,) float32, by the name of the matte

    @property
    def channels(self) -> list[str]:
        """Names of the channels in their order; those of mattes are the last."""
        names = ["A"]
        for token, of_token in _CHANNELS.items():
            names += of_token if token in self.tokens else []
        names += [f"targets.{name}" for name in self.targets] if "targets" in self.tokens else []
        for matte in self.mattes:
            names += [f"{matte}{rank // 2:02d}.{part}" for rank in range(RANKS) for part in ("RG", "BA")[rank % 2]]
        return names


class _Seen:
    """What some pixels see along their rays."""

    def __init__(self, rays: PixelRays, things: Things, asked: Asked, band: Band, lines: SightLines | None) -> None:
        self.rays, self.asked, self.band, self.lines, self.faces = rays, asked, band, lines, things.faces
        self.met = things.met(rays.leaving.origin, rays.leaving.direction)
        self.pixels, self.hit = len(rays.pixels), np.flatnonzero(self.met.thing >= 0)
        self.all_light = self._light(slice(None))

    def _light(self, some: np.ndarray | slice) -> np.ndarray:
        """Light of some rays in each pixel."""
        return np.bincount(self.rays.row[some], self.rays.leaving.share[some], minlength=self.pixels)

    def share(self, some: np.ndarray) -> np.ndarray:
        """Share of some rays in the light of each pixel, (pixels, 1)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return (self._light(some) / self.all_light)[:, None]  # type: ignore[no-any-return]

    def mean(self, values: Float64[np.ndarray, "n k"], some: Int64[np.ndarray, "n"]) -> np.ndarray:
        """Mean of values of some rays in each pixel, and behind it their spread, (pixels, k + 1)."""
        return _mean(values, self.rays.leaving.share[some], self.rays.row[some], self.pixels)

    def columns(self) -> np.ndarray:
        """All channels, (pixels, channels) float32."""
        parts = [self.share(self.hit), *(getattr(self, token)() for token in _CHANNELS if token in self.asked.tokens)]
        if "targets" in self.asked.tokens:
            parts += [self.share(np.flatnonzero(self.met.thing == k)) for k in range(len(self.asked.targets))]
        # Ids are bits of single precision: no arithmetic may touch them.
        mattes = [self.matte(ids) for ids in self.asked.mattes.values()]
        return np.column_stack([*(part.astype(np.float32) for part in parts), *mattes])

    def depth(self) -> np.ndarray:
        return self.mean(self.met.point_mm[self.hit, 2:], self.hit)

    def range(self) -> np.ndarray:
        return self.mean(np.linalg.norm(self.met.point_mm[self.hit], axis=1)[:, None], self.hit)

    def position(self) -> np.ndarray:
        return self.mean(apply(self.asked.world_from_vision, self.met.point_mm[self.hit]), self.hit)

    def normal(self) -> np.ndarray:
        return self.mean(self.met.normal[self.hit] @ self.asked.world_from_vision[:3, :3].T, self.hit)

    def board(self) -> np.ndarray:
        """Place on the face with most light, its share, and the numbers of target and face."""
        on_sheet = np.flatnonzero(self.met.face >= 0)
        row, face, light, _ = self._grouped(self.met.face, on_sheet)
        # The last of several that a pixel is given stays: that with most light, of equals the first face.
        order, chosen = np.lexsort((-face, light)), np.full(self.pixels, -1)
        chosen[row[order]] = face[order]
        some = on_sheet[self.met.face[on_sheet] == chosen[self.rays.row[on_sheet]]]
        place = self.mean(self.met.sheet_mm[some], some)
        faces = np.array([*self.faces, (np.nan, np.nan)])
        return np.column_stack([place[:, :2], self.share(some), faces[chosen], place[:, 2]])

    def flow(self) -> np.ndarray:
        """Way of the mean point of each thing, in the mean of all of them."""
        assert self.lines is not None
        moving = self.hit[(self.rays.way[self.hit] == 0) & np.isfinite(self.met.later_mm[self.hit, 0])]
        row, _, light, group = self._grouped(self.met.thing, moving)
        weight = self.rays.leaving.share[moving]
        now, later = (
            _mean(points[moving], weight, group, len(row))[:, :3] for points in (self.met.point_mm, self.met.later_mm)
        )
        pixel = self.rays.squares.pixels[row].astype(float)
        cell = self.band.strata[self.rays.pixels[row], 0]
        start = self.lines.positions(now, cell, pixel)
        way = self.lines.positions(later, cell, start) - start
        known = np.isfinite(way).all(axis=1)
        return _mean(way[known], light[known], row[known], self.pixels)

    def matte(self, ids: Float32[np.ndarray, "things"]) -> np.ndarray:
        """Ids and shares of the things with most light, alternating, (pixels, 2 RANKS)."""
        names, number = np.unique(ids, return_inverse=True)
        row, name, light, _ = self._grouped(np.where(self.met.thing >= 0, number[self.met.thing], -1), self.hit)
        order = np.lexsort((name, -light, row))
        row, name, light = row[order], name[order], light[order]
        rank = np.arange(len(row)) - np.searchsorted(row, row)
        kept = rank < RANKS
        result = np.zeros((self.pixels, RANKS, 2), np.float32)
        result[row[kept], rank[kept], 0] = names[name[kept]]
        result[row[kept], rank[kept], 1] = (light / self.all_light[row])[kept]
        return result.reshape(self.pixels, -1)

    def _grouped(self, number: np.ndarray, some: np.ndarray) -> tuple[np.ndarray, ...]:
        """Rays of one pixel with one number: pixel, number and light of each group, and the group of each ray."""
        most = int(number.max(initial=0)) + 1
        keys, group = np.unique(self.rays.row[some] * most + number[some], return_inverse=True)
        light = np.bincount(group, self.rays.leaving.share[some], minlength=len(keys))
        return keys // most, keys % most, light, group


def _mean(values: np.ndarray, weight: np.ndarray, row: np.ndarray, rows: int) -> np.ndarray:
    """Means of values (n, k) by weight in each row, and their spread, (rows, k + 1); NaN where there is nothing."""
    total = np.bincount(row, weight, minlength=rows)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.stack([np.bincount(row, weight * v, minlength=rows) / total for v in values.T], axis=1)
        off = np.square(values - mean[row]).sum(axis=1)
        return np.column_stack([mean, np.sqrt(np.bincount(row, weight * off, minlength=rows) / total)])


_CHANNELS = {
    "depth": ["Z", "spread.Z"],
    "range": ["range", "spread.range"],
    "position": ["P.X", "P.Y", "P.Z", "spread.P"],
    "normal": ["N.X", "N.Y", "N.Z", "spread.N"],
    "board": ["board.U", "board.V", "board.share", "board.target", "board.face", "spread.board"],
    "flow": ["flow.X", "flow.Y", "spread.flow"],
}
"""Channels of a token, in the order in which the function of its name returns them."""


def labels(band: Band, samples: int, scenes: Sequence[tuple[Things, Asked]]) -> list[np.ndarray]:
    """Labels of the pixels of a band in several scenes, which share their rays: (h, w, channels) float32 each."""
    has_flow = any("flow" in asked.tokens for _, asked in scenes)
    home = band.strata[:, 0]
    lines = SightLines(band.rig, np.unique(home[home != SKIP])) if has_flow else None
    results = []
    for _, asked in scenes:
        result = np.full((len(home), len(asked.channels)), np.nan, np.float32)
        result[:, result.shape[1] - 2 * RANKS * len(asked.mattes) :] = _NO_ID
        results.append(result)
    for rays in rays_of(band, Batch(samples), np.where(band.strata == SKIP, 0, samples)):
        for result, (things, asked) in zip(results, scenes, strict=True):
            result[rays.pixels] = _Seen(rays, things, asked, band, lines).columns()
    return [result.reshape(*band.shape, -1) for result in results]
