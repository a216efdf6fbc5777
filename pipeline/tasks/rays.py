"""Task `rays`: J_near, J_far, second moments, hit fraction and error of a camera, assembled from its tiles."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.npy import StackedRows
from pipeline.tasks.artefacts.cameras import Inputs, tracer_alone
from pipeline.tasks.params.cameras import Rays as Params
from pipeline.tasks.rays_tile import ERROR_SQUARED, FAR, HIT_FRACTION, NEAR
from pipeline.truth.grid.sampling_error import in_pixels, jacobian

Attributes = dict[str, str | float | int]
"""What the header of a part says."""

AXES = ("xn", "yn", "xf", "yf")
MOMENTS = tuple(f"{a}_{b}" for i, a in enumerate(AXES) for b in AXES[i:])
"""Channel names of the part `moments`: upper triangle of the covariance of (x_near, y_near, x_far, y_far)."""


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write rays.exr."""
    tracer = tracer_alone(inputs, params.sampling.seed)
    camera, tiles = tracer.camera, _Tiles(inputs, params.tiles, params.sampling.supersampling)
    assert camera.near_mm is not None and camera.far_mm is not None
    head: Attributes = {
        "frame": "vision frame, mm: origin at the aperture stop, x right, y down, z forward",
        "grid": "K times finer than the image: x_px = (x_K + 1/2) / K - 1/2",
        **dataclasses.asdict(params.sampling),
        **dataclasses.asdict(params.light),
    }
    kept = "of the bundle from the point at fine position (x K + K // 2, y K + K // 2) of each pixel, mm^2"
    parts = [
        tiles.part("near", ("X", "Y"), tiles.near, head | {"plane_z_mm": camera.near_mm}),
        tiles.part("far", ("X", "Y"), tiles.far, head | {"plane_z_mm": camera.far_mm}),
        tiles.part("moments", MOMENTS, tiles.covariance.rows, {**head, "kept": kept}),
        tiles.part("hit_fraction", ("Y",), tiles.hit_fraction, head),
        tiles.part("error", ("X", "Y"), tiles.error, {**head, "unit": "px", "plane": "the worse of near and far"}),
    ]
    lattice = tracer.lattice
    if lattice is not None:
        axial = np.stack([lattice.k, lattice.l], axis=-1)
        parts.append(tiles.part("microlens", ("k", "l"), lambda first, end: axial[tiles.cells.rows(first, end)], head))
    write_bands(out / "rays.exr", parts)


class _Tiles:
    """The outputs of all tiles, one below the other; their rows become pixels of parts, (rows, w, channels)."""

    def __init__(self, inputs: Inputs, tiles: int, supersampling: int) -> None:
        self.bundles, self.cells, self.covariance = (
            StackedRows([inputs[f"tile{number}"][f"{name}.npy"] for number in range(tiles)])
            for name in ("bundles", "cells", "covariance")
        )
        self._supersampling = supersampling

    def near(self, first: int, end: int) -> np.ndarray:
        """J_near."""
        return self.bundles.rows(first, end)[..., NEAR]

    def far(self, first: int, end: int) -> np.ndarray:
        """J_far."""
        return self.bundles.rows(first, end)[..., FAR]

    def hit_fraction(self, first: int, end: int) -> np.ndarray:
        """Hit fraction."""
        return self.bundles.rows(first, end)[..., HIT_FRACTION, None]

    def error(self, first: int, end: int) -> np.ndarray:
        """Errors of J; differences reach one row beyond a band."""
        low, high = max(first - 1, 0), min(end + 1, self.bundles.shape[0])
        found = error_of(self.bundles.rows(low, high), self.cells.rows(low, high), self._supersampling)
        return found[first - low : end - low]

    def part(
        self,
        name: str,
        channels: tuple[str, ...],
        pixels: Callable[[int, int], np.ndarray],
        head: Attributes,
    ) -> BandedPart:
        """A part of the file; `pixels` gives rows of it."""

        def rows(first: int, end: int) -> dict[str, np.ndarray]:
            return dict(zip(channels, np.moveaxis(pixels(first, end), -1, 0), strict=True))

        height, width = (self.covariance if name == "moments" else self.bundles).shape[:2]
        return BandedPart(name=name, shape=(height, width), channels=channels, rows=rows, attributes=head)


def error_of(bundles: np.ndarray, cells: np.ndarray, supersampling: int) -> np.ndarray:
    """Standard error of J from the ray sampling, on the worse of the two planes, (K h, K w, 2) [px]."""
    squared, planes = bundles[..., ERROR_SQUARED], (NEAR, FAR)
    errors = (
        in_pixels(squared[..., part], jacobian(bundles[..., plane], cells), supersampling)
        for part, plane in zip((slice(0, 2), slice(2, 4)), planes, strict=True)
    )
    return np.fmax(*errors)  # type: ignore[no-any-return]
