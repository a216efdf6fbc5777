"""Meridional section of a lens: points (along the axis from the stop, + towards the sensor; height) [mm]."""

from itertools import pairwise

import numpy as np

from pipeline.frames import apply
from pipeline.optics.prescription import Prescription
from pipeline.optics.table import placed

Section = list[tuple[float, float]]


def profiles(prescription: Prescription) -> list[Section]:
    """Sections of all surfaces, displaced ones where they really are, as seen from the side."""
    outlines = []
    for surface, vertex, motion in placed(prescription):
        heights = np.linspace(-surface.semi_diameter_mm, surface.semi_diameter_mm, 61).tolist()
        points = np.array([[0.0, y, vertex + surface.sag_mm(abs(y))] for y in heights])
        points = points if motion is None else apply(motion, points)
        outlines.append([(float(z), float(y)) for _, y, z in points])
    return outlines


def elements(prescription: Prescription) -> list[Section]:
    """Outlines of the lens elements: two neighbouring surfaces with a denser medium than air between them."""
    outlines = []
    for (front, ahead), (_, behind) in pairwise(zip(prescription.surfaces, profiles(prescription), strict=True)):
        if front.is_before_glass:
            # Straight edges at the height of the larger aperture join both sections.
            upper = max(ahead[-1][1], behind[-1][1])
            lower = min(ahead[0][1], behind[0][1])
            top = [(ahead[-1][0], upper), (behind[-1][0], upper)]
            bottom = [(behind[0][0], lower), (ahead[0][0], lower)]
            outlines.append([*ahead, *top, *reversed(behind), *bottom])
    return outlines
