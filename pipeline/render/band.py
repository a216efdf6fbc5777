"""Rows of an image that is computed, and the microlenses that light their pixels."""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.micro_images.centres import pixel_strata, positions_of
from pipeline.camera.rig import Rig
from pipeline.records.shapes import Float64, Int64

Rows = tuple[int, int]
"""First and end of some rows of an image."""


@dataclass(frozen=True, slots=True)
class Band:
    """Rows of an image.

    `positions_mm`: centres of their pixels on the sensor, row by row, vision frame.
    `strata`: microlenses that light each pixel, as `camera.micro_images.centres` finds them.
    """

    rig: Rig
    rows: Rows
    positions_mm: Float64[np.ndarray, "n 2"]
    strata: Int64[np.ndarray, "n s"]

    @classmethod
    def of(cls, rig: Rig, rows: Rows | None = None) -> "Band":
        """The band of some rows, by default all."""
        rows = rows or (0, rig.tracer.camera.sensor.height_px)
        strata = pixel_strata(rig.tracer, rig.images, rows, rig.diffraction.reach_mm)
        return cls(rig, rows, positions_of(rig.tracer, rows), strata)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows[1] - self.rows[0], self.rig.tracer.camera.sensor.width_px
