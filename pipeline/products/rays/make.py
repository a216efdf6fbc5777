"""Tasks `rays` and `rays_tile`: J_near, J_far, second moments, hit fraction and error of a camera; in bands of rows."""

import dataclasses
from pathlib import Path

import numpy as np

from pipeline.camera.parts.camera import Sampling
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import COLUMNS, COVARIANCE, FREE_WEIGHT, VARIANCE, WEIGHT
from pipeline.files.exr_bands import BandedPart, Rows, write_bands
from pipeline.files.jsonfile import write_json
from pipeline.files.npy import StackedRows, append_npy, write_npy
from pipeline.products.cameras import Inputs, Stretch, rig_of, stretches, tracer_alone
from pipeline.products.rays.params import JoinedRays, RaysTile
from pipeline.truth.grid.position_image import in_pixels, jacobian

NEAR, FAR, HIT_FRACTION, ERROR_SQUARED, WIDTH = slice(0, 2), slice(2, 4), 4, slice(5, 9), 9
"""Columns of bundles.npy; the last value is their number."""
GRID, ERROR, AXIAL = "grid.json", "error.npy", "axial.npy"
"""Files for the task `truth`: facts of the grid, the part `error`, and k and l of each microlens, (m, 2)."""


def rays_tile(params: RaysTile, inputs: Inputs, out: Path) -> None:
    """Bundles of a band of rows of the fine grid: three arrays."""
    rig = rig_of(inputs, params.sampling.seed)
    tracer = dataclasses.replace(rig.tracer, device=params.device)
    k = params.sampling.supersampling
    height = (params.end_row - params.first_row) * k
    width = tracer.camera.sensor.width_px * k
    bundles = np.empty((height * width, WIDTH), np.float32)
    cells = np.empty(height * width, np.int32)
    covariance = np.empty((height * width, 10), np.float32)
    for piece in stretches(rig, k, params.first_row * k, params.end_row * k):
        bundles[piece.index], covariance[piece.index] = traced(tracer, piece, params.sampling, params.square_px)
        cells[piece.index] = piece.microlens if rig.images else 0
    # For every pixel the bundle next to its centre keeps its second moments.
    of_pixels = covariance.reshape(height, width, 10)[k // 2 :: k, k // 2 :: k]
    write_npy(out / "bundles.npy", bundles.reshape(height, width, WIDTH))
    write_npy(out / "cells.npy", cells.reshape(height, width))
    write_npy(out / "covariance.npy", np.ascontiguousarray(of_pixels))


def traced(tracer: Tracer, piece: Stretch, sampling: Sampling, square_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Bundles (n, WIDTH) of positions, and second moments (n, 10), which are needed only next to a pixel's centre."""
    camera = tracer.camera
    k = sampling.supersampling
    microlens = piece.microlens
    assert camera.near_mm is not None and camera.far_mm is not None
    planes = parallel_planes(camera.near_mm, camera.far_mm)
    moments = tracer.moments(piece.positions_mm, microlens, planes, sampling.samples, piece.pixels, square_px)
    # Light of a bundle that nothing in the main lens blocks
    unvignetted = moments[:, FREE_WEIGHT] if tracer.lattice is not None else tracer.reference_weight_sr
    bundles = np.empty((len(microlens), WIDTH))
    bundles[:, NEAR] = moments[:, 0:2]
    bundles[:, FAR] = moments[:, 2:4]
    bundles[:, HIT_FRACTION] = moments[:, WEIGHT] / unvignetted
    bundles[:, ERROR_SQUARED] = moments[:, VARIANCE:COLUMNS]
    covariance = moments[:, COVARIANCE:WEIGHT]
    if square_px > 0:
        # Second moments are those of the bundle without its square.
        next_to_centre = (piece.pixels % k == k // 2).all(axis=1)
        covariance[next_to_centre] = tracer.moments(
            piece.positions_mm[next_to_centre],
            microlens[next_to_centre],
            planes,
            sampling.samples,
            piece.pixels[next_to_centre],
        )[:, COVARIANCE:WEIGHT]
    return bundles, covariance


Attributes = dict[str, str | float | int]
"""Header of a part of a file."""

AXES = ("xn", "yn", "xf", "yf")
MOMENTS = tuple(f"{a}_{b}" for i, a in enumerate(AXES) for b in AXES[i:])
"""Channel names of the part `moments`: upper triangle of the covariance of (x_near, y_near, x_far, y_far)."""


def rays(params: JoinedRays, inputs: Inputs, out: Path) -> None:
    """All bundles of a camera, joined from tiles: rays.exr."""
    tracer = tracer_alone(inputs, params.sampling.seed)
    k = params.sampling.supersampling
    near_mm, far_mm = tracer.camera.near_mm, tracer.camera.far_mm
    assert near_mm is not None and far_mm is not None
    bundles, cells, covariance = bundles_of(inputs, params.tiles)
    facts = {"supersampling": k, "planes_mm": [near_mm, far_mm], "footprint": params.light.footprint}
    write_json(out / GRID, facts | {"tiles": params.tiles})
    head: Attributes = {
        "frame": "vision frame, mm: origin at the aperture stop, x right, y down, z forward",
        "grid": "K times finer than the image: x_px = (x_K + 1/2) / K - 1/2",
        **dataclasses.asdict(params.sampling),
        **dataclasses.asdict(params.light),
    }
    remark = "of the bundle from the point at fine position (x K + K // 2, y K + K // 2) of each pixel, mm^2"

    def error(first: int, end: int) -> np.ndarray:
        low, high = max(first - 1, 0), min(end + 1, bundles.shape[0])  # differences reach one row beyond a band
        errors = error_of(bundles.rows(low, high), cells.rows(low, high), k)[first - low : end - low]
        append_npy(out / ERROR, errors.astype(np.float32), lambda: bundles.shape[0])
        return errors

    def columns(channels: slice) -> Rows:
        return lambda first, end: bundles.rows(first, end)[..., channels]

    fine = bundles.shape[:2]
    light = slice(HIT_FRACTION, HIT_FRACTION + 1)
    parts = [
        _part("near", ("X", "Y"), fine, columns(NEAR), {**head, "plane_z_mm": near_mm}),
        _part("far", ("X", "Y"), fine, columns(FAR), {**head, "plane_z_mm": far_mm}),
        _part("moments", MOMENTS, covariance.shape[:2], covariance.rows, {**head, "kept": remark}),
        _part("hit_fraction", ("Y",), fine, columns(light), head),
        _part("error", ("X", "Y"), fine, error, {**head, "unit": "px", "plane": "the worse of near and far"}),
    ]
    if (lattice := tracer.lattice) is not None:
        axial = np.stack([lattice.k, lattice.l], axis=-1)
        write_npy(out / AXIAL, axial)
        parts.append(_part("microlens", ("k", "l"), fine, lambda first, end: axial[cells.rows(first, end)], head))
    write_bands(out / "rays.exr", parts)


def _part(
    name: str, channels: tuple[str, ...], shape: tuple[int, ...], rows: Rows, attributes: Attributes
) -> BandedPart:
    return BandedPart(name=name, shape=(shape[0], shape[1]), channels=channels, rows=rows, attributes=attributes)


def bundles_of(inputs: Inputs, tiles: int) -> tuple[StackedRows, StackedRows, StackedRows]:
    """Bundles, cells and second moments of all tiles, by rows of the fine grid, and of the image."""
    bundles, cells, covariance = (
        StackedRows([inputs[f"tile{number}"][f"{name}.npy"] for number in range(tiles)])
        for name in ("bundles", "cells", "covariance")
    )
    return bundles, cells, covariance


def error_of(bundles: np.ndarray, cells: np.ndarray, supersampling: int) -> np.ndarray:
    """Standard error of J from the ray sampling, on the worse of the two planes, (K h, K w, 2) [px]."""
    squared_mm2 = bundles[..., ERROR_SQUARED]  # of x and y on the near plane, then on the far one
    near_px = in_pixels(squared_mm2[..., 0:2], jacobian(bundles[..., NEAR], cells), supersampling)
    far_px = in_pixels(squared_mm2[..., 2:4], jacobian(bundles[..., FAR], cells), supersampling)
    return np.fmax(near_px, far_px)  # type: ignore[no-any-return]
