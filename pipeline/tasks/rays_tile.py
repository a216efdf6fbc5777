"""Task `rays_tile`: bundles of a band of rows of a camera's fine grid. Tiles only distribute the work."""

import dataclasses
from pathlib import Path

import numpy as np

from pipeline.camera.parts.camera import Sampling
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import COLUMNS, COVARIANCE, FREE_WEIGHT, VARIANCE, WEIGHT
from pipeline.files.npy import write_npy
from pipeline.tasks.artefacts.cameras import Inputs, Stretch, rig_of, stretches
from pipeline.tasks.params.cameras import RaysTile as Params

NEAR, FAR, HIT_FRACTION, ERROR_SQUARED, WIDTH = slice(0, 2), slice(2, 4), 4, slice(5, 9), 9
"""Columns of bundles.npy; the last value is their number."""


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write three arrays."""
    rig = rig_of(inputs, params.sampling.seed)
    tracer = dataclasses.replace(rig.tracer, device=params.device)
    k = params.sampling.supersampling
    height, width = (params.end_row - params.first_row) * k, tracer.camera.sensor.width_px * k
    bundles = np.empty((height * width, WIDTH), np.float32)
    cells = np.empty(height * width, np.int32)
    covariance = np.empty((height * width, 10), np.float32)
    for piece in stretches(rig, k, params.first_row * k, params.end_row * k):
        bundles[piece.index], covariance[piece.index] = traced(tracer, piece, params.sampling, params.square_px)
        cells[piece.index] = piece.microlens if rig.images else 0
    # For every pixel the bundle next to its centre keeps its second moments.
    small = covariance.reshape(height, width, 10)[k // 2 :: k, k // 2 :: k]
    write_npy(out / "bundles.npy", bundles.reshape(height, width, WIDTH))
    write_npy(out / "cells.npy", cells.reshape(height, width))
    write_npy(out / "covariance.npy", np.ascontiguousarray(small))


def traced(tracer: Tracer, piece: Stretch, sampling: Sampling, square_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Bundles (n, WIDTH) of positions, and second moments (n, 10), which are needed only next to a pixel's centre."""
    camera, k, microlens = tracer.camera, sampling.supersampling, piece.microlens
    assert camera.near_mm is not None and camera.far_mm is not None
    planes = parallel_planes(camera.near_mm, camera.far_mm)
    moments = tracer.moments(piece.positions_mm, microlens, planes, sampling.samples, piece.pixels, square_px)
    free = moments[:, FREE_WEIGHT] if tracer.lattice is not None else tracer.reference_weight_sr
    bundles = np.empty((len(microlens), WIDTH))
    bundles[:, NEAR], bundles[:, FAR] = moments[:, 0:2], moments[:, 2:4]
    bundles[:, HIT_FRACTION] = moments[:, WEIGHT] / free
    bundles[:, ERROR_SQUARED] = moments[:, VARIANCE:COLUMNS]
    covariance = moments[:, COVARIANCE:WEIGHT]
    if square_px > 0:
        # Second moments are those of the bundle without its square.
        kept = (piece.pixels % k == k // 2).all(axis=1)
        points = piece.positions_mm[kept], microlens[kept], planes, sampling.samples, piece.pixels[kept]
        covariance[kept] = tracer.moments(*points)[:, COVARIANCE:WEIGHT]
    return bundles, covariance
