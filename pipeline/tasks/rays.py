"""Task `rays`: J_near, J_far, second moments, hit fraction and error of a camera, assembled from its tiles."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.exr import Part, write_exr
from pipeline.files.npy import read_npy
from pipeline.tasks.cameras import Inputs, tracer_of
from pipeline.tasks.rays_tile import ERROR_SQUARED, FAR, HIT_FRACTION, NEAR
from pipeline.truth.error import in_pixels, jacobian

AXES = ("xn", "yn", "xf", "yf")
MOMENTS = tuple(f"{a}_{b}" for i, a in enumerate(AXES) for b in AXES[i:])
"""Channel names of the part `moments`: upper triangle of the covariance of (x_near, y_near, x_far, y_far)."""


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: tiles (number), supersampling, samples, seed, weight, footprint, wavelength_nm."""
    tracer, _ = tracer_of(inputs, params["seed"])
    camera, k = tracer.camera, params["supersampling"]
    bundles, cells, covariance = (
        _stacked(inputs, params["tiles"], name) for name in ("bundles", "cells", "covariance")
    )
    near, far = bundles[..., NEAR], bundles[..., FAR]
    head: dict[str, Any] = {
        "frame": "vision frame, mm: origin at the aperture stop, x right, y down, z forward",
        "grid": "K times finer than the image: x_px = (x_K + 1/2) / K - 1/2",
        **{name: params[name] for name in ("supersampling", "samples", "seed", "weight", "footprint", "wavelength_nm")},
    }
    kept = "of the bundle from the point at fine position (x K + K // 2, y K + K // 2) of each pixel, mm^2"
    error = error_of(bundles, cells, k)
    parts = [
        _part("near", near, ("X", "Y"), {**head, "plane_z_mm": camera.near_mm}),
        _part("far", far, ("X", "Y"), {**head, "plane_z_mm": camera.far_mm}),
        _part("moments", covariance, MOMENTS, {**head, "kept": kept}),
        _part("hit_fraction", bundles[..., HIT_FRACTION, None], ("Y",), head),
        _part("error", error, ("X", "Y"), {**head, "unit": "px", "plane": "the worse of near and far"}),
    ]
    if tracer.lattice is not None:
        axial = np.stack([tracer.lattice.k, tracer.lattice.l], axis=-1)[cells]
        parts.append(_part("microlens", axial, ("k", "l"), head))
    write_exr(out / "rays.exr", parts)


def error_of(bundles: np.ndarray, cells: np.ndarray, supersampling: int) -> np.ndarray:
    """Standard error of J from the ray sampling, on the worse of the two planes, (K h, K w, 2) [px]."""
    squared, planes = bundles[..., ERROR_SQUARED], (NEAR, FAR)
    errors = (
        in_pixels(squared[..., part], jacobian(bundles[..., plane], cells), supersampling)
        for part, plane in zip((slice(0, 2), slice(2, 4)), planes, strict=True)
    )
    return np.fmax(*errors)  # type: ignore[no-any-return]


def _stacked(inputs: Inputs, tiles: int, name: str) -> np.ndarray:
    files = (inputs[f"tile{number}"][f"{name}.npy"] for number in range(tiles))
    return np.concatenate([read_npy(file) for file in files])


def _part(name: str, pixels: np.ndarray, channels: tuple[str, ...], attributes: dict[str, Any]) -> Part:
    planes = {channel: pixels[..., i] for i, channel in enumerate(channels)}
    return Part(name=name, channels=planes, attributes=attributes)
