"""Two plain lenses and random rays for slow twins."""

import numpy as np

from pipeline.optics.prescription import Prescription, Surface

SINGLET = Prescription(
    surfaces=(
        Surface(radius_mm=60.0, thickness_mm=8.0, index=1.8, semi_diameter_mm=30.0),
        Surface(radius_mm=-60.0, thickness_mm=5.0, semi_diameter_mm=30.0),
        Surface(semi_diameter_mm=12.0, is_stop=True),
    )
)


BALL = Prescription(
    surfaces=(
        Surface(radius_mm=10.0, thickness_mm=10.0, index=1.9, semi_diameter_mm=10.0),
        Surface(semi_diameter_mm=8.0, thickness_mm=10.0, index=1.9, is_stop=True),
        Surface(radius_mm=-10.0, semi_diameter_mm=10.0),
    )
)


def random_rays(lens: Prescription, behind_mm: float, field_mm: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """From anywhere on a square sensor to anywhere on 1.2 times the rear surface."""
    rng = np.random.default_rng(20)
    rear_mm = -lens.vertices_from_stop_mm[-1]
    start = np.column_stack([rng.uniform(-field_mm, field_mm, (count, 2)), np.full(count, rear_mm - behind_mm)])
    aim_mm = 1.2 * lens.surfaces[-1].semi_diameter_mm
    aim = np.column_stack([rng.uniform(-aim_mm, aim_mm, (count, 2)), np.full(count, rear_mm)])
    way = aim - start
    return start, way / np.linalg.norm(way, axis=1, keepdims=True)
