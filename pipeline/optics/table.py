"""A prescription as the flat table that kernels read, for light going either way.

Both tables let rays travel along +z of their own frame, so kernels know one direction only: `towards_scene` uses the
vision frame (origin at the stop, z forward), `towards_sensor` the lens frame moved to the stop.
"""

import numpy as np

from pipeline.optics.prescription import Prescription

VERTEX, CURVATURE, INDEX_RATIO, SEMI_DIAMETER_SQUARED = range(4)
"""Columns: vertex z [mm], curvature [1/mm], index before / index behind, squared semi-diameter [mm^2]."""


def towards_scene(prescription: Prescription) -> np.ndarray:
    """Surfaces in the order in which rays from the sensor meet them, vision frame.

    Returns
    -------
    (n, 4) float64
        Rows from the rear surface to the front one.
    """
    rows = []
    for i in reversed(range(len(prescription.surfaces))):
        surface = prescription.surfaces[i]
        in_front = prescription.surfaces[i - 1].index if i else 1.0
        # Vision z points against the lens frame's z: positions and curvatures change sign.
        rows.append(
            (
                -prescription.vertices_from_stop_mm[i] + 0.0,
                -surface.curvature_per_mm + 0.0,
                surface.index / in_front,
                surface.semi_diameter_mm**2,
            )
        )
    return np.array(rows)


def towards_sensor(prescription: Prescription) -> np.ndarray:
    """Surfaces in the order in which light from the scene meets them, lens frame with its origin moved to the stop.

    Returns
    -------
    (n, 4) float64
        Rows from the front surface to the rear one.
    """
    rows = []
    before = 1.0
    for surface, vertex_mm in zip(prescription.surfaces, prescription.vertices_from_stop_mm, strict=True):
        ratio = before / surface.index
        rows.append((vertex_mm, surface.curvature_per_mm, ratio, surface.semi_diameter_mm**2))
        before = surface.index
    return np.array(rows)
