"""An ideal thin lens."""

from pipeline.optics.prescription import Prescription, Surface

F_MM = 49.9


def thin(focal_mm: float = F_MM, semi_mm: float = 6.0) -> Prescription:
    """An ideal thin lens that is its own stop."""
    return Prescription(surfaces=(Surface(focal_length_mm=focal_mm, semi_diameter_mm=semi_mm, is_stop=True),))
