"""A plenoptic camera as a thin lens before an array of thin lenses: start values of calibrations that assume one.

Paraxial figures of camera.json, the gap between the principal planes left out. Of a real lens they are a start, no
truth: its pupil does not stand in a principal plane.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

_INFINITE_MM = 1e8
"""Distance that libpleno takes for infinite [mm]."""
_SAME = 1e-6
"""Difference of focal length and distance below which microlenses count as unfocused: parts of the focal length."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ThinLens:
    focal_mm: float  # of the main lens
    f_number: float
    main_lens_mm: float  # distance of the array from the main lens, D
    sensor_mm: float  # distance of the array from the sensor, d
    focal_lengths_mm: np.ndarray  # (types,), of the microlenses

    @property
    def mode(self) -> int:
        """0 unfocused, 1 Keplerian, 2 Galilean, by libpleno's rule: the first microlens."""
        first = float(self.focal_lengths_mm[0])
        if abs(first - self.sensor_mm) < _SAME * first:
            return 0
        return 1 if first < self.sensor_mm else 2

    @property
    def ratio(self) -> float:
        """Pitch of microlenses over that of micro-images, lambda = D / (D + d)."""
        return self.main_lens_mm / (self.main_lens_mm + self.sensor_mm)

    @property
    def focus_mm(self) -> float:
        """Distance from object to image by which libpleno starts: H² / (H - F), H = D, D - 2 d or D + 2 d by mode."""
        image = self.main_lens_mm + {0: 0, 1: -2, 2: 2}[self.mode] * self.sensor_mm
        beyond = image - self.focal_mm
        return min(image**2 / beyond, _INFINITE_MM) if beyond > 0 else _INFINITE_MM


def thin_lens(record: dict[str, Any], focal_lengths_mm: np.ndarray) -> ThinLens:
    """The thin-lens camera of a plenoptic camera, from its camera.json and focal lengths of its types in some order."""
    lens, types = record["lens"], record["mla"]["types"]
    front, rear = (sum(kind["principal_planes_mm"][side] for kind in types) / len(types) for side in (0, 1))
    return ThinLens(
        focal_mm=lens["efl_mm"],
        f_number=lens["f_number"],
        main_lens_mm=record["sensor_distance_mm"] - front + lens["principal_planes_mm"][1],  # z towards the scene
        sensor_mm=rear,
        focal_lengths_mm=focal_lengths_mm,
    )
