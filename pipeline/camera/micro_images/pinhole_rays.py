"""Rays through points of microlens apertures, for searches of the edges of their light."""

import numpy as np

from pipeline.camera.micro_images import pinhole_kernels
from pipeline.camera.micro_images.pinhole_kernels import Pencils, Rays
from pipeline.camera.tracing.records import CameraArrays


def look(camera: CameraArrays, pencils: Pencils, rays: Rays, is_named: bool = False) -> np.ndarray:
    """Labels of rays, (m,): `PASSES` or another, which names what blocks the ray if names are asked for."""
    label = np.empty(len(rays.owner), np.int64)
    # Contiguous and writable, so that Numba has one specialisation.
    own = Rays(*(np.require(values, requirements=("C", "W")) for values in rays))
    pinhole_kernels.look(camera, pencils, own, is_named, label)
    pinhole_kernels.look.count(len(label), len(camera.table))
    return label
