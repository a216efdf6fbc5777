"""Displacements of the surfaces of a lens from their places: decentres and tilts as rigid motions.

A motion acts on points of the lens frame with its origin moved to the centre of the nominal stop. It carries the
surface as it stands in the centred lens to where it really stands, and nothing else: what follows stays.
"""

import math

import numpy as np

from pipeline.frames import rigid
from pipeline.optics.prescription import Prescription


def displacements(prescription: Prescription) -> list[np.ndarray | None]:
    """Motion of every surface, (4, 4) [mm]; None where it stands in its place.

    The surface moves first, then its group: what a surface is displaced by counts in the axes of its group.
    """
    vertices = prescription.vertices_from_stop_mm
    motions = [motion(s.decentre_mm, s.tilt_deg, z) for s, z in zip(prescription.surfaces, vertices, strict=True)]
    for group in prescription.groups:
        whole = motion(group.decentre_mm, group.tilt_deg, vertices[group.first] + group.pivot_mm)
        for i in group.members if whole is not None else ():
            own = motions[i]
            motions[i] = whole if own is None else whole @ own
    return motions


def motion(decentre_mm: tuple[float, float], tilt_deg: tuple[float, float], pivot_mm: float) -> np.ndarray | None:
    """Turn about the point (0, 0, pivot), first about x, then about the turned y, then shift; None for no motion."""
    if not any((*decentre_mm, *tilt_deg)):
        return None
    (cos_x, cos_y), (sin_x, sin_y) = ([f(math.radians(angle)) for angle in tilt_deg] for f in (math.cos, math.sin))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cos_x, -sin_x], [0.0, sin_x, cos_x]])
    about_y = np.array([[cos_y, 0.0, sin_y], [0.0, 1.0, 0.0], [-sin_y, 0.0, cos_y]])
    turn, pivot = about_x @ about_y, np.array([0.0, 0.0, pivot_mm])
    return rigid(turn, pivot - turn @ pivot + np.array([*decentre_mm, 0.0]))
