"""Task `micro_images`: centre, radius and type of every micro-image of a plenoptic camera."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.tables import write_table
from pipeline.tasks.cameras import Inputs, tracer_of

HEADER = (
    "micro-images: one row per microlens, k and l are axial indices of the lattice",
    "positions in px: (0, 0) is the centre of the top-left pixel, x right, y down; vertices in the sensor frame, mm,"
    " from the sensor's centre",
    "centre: sensor hit of the real ray through the centre of the aperture stop and the microlens vertex",
    "radius: exit-pupil radius * B / P, the contour of half illumination; complete: the circle lies in the image",
    "empty: centroid_x_px, centroid_y_px (the centroid of the lit area is not computed yet)",
)


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: none."""
    tracer, images = tracer_of(inputs, 0)
    grid, array, sensor = tracer.lattice, tracer.camera.microlenses, tracer.camera.sensor
    assert images is not None and grid is not None and array is not None
    centre = tracer.pixels_at(images.centre_mm)
    radius = images.radius_mm / sensor.pitch_mm
    room = np.array([sensor.width_px, sensor.height_px]) - 0.5 - radius
    complete = ((centre >= radius - 0.5) & (centre <= room)).all(axis=1)
    unknown = [None] * len(grid.k)
    columns = {
        "microlens_k": grid.k,
        "microlens_l": grid.l,
        "microlens_type": grid.type,
        "vertex_x_mm": grid.x_mm,
        "vertex_y_mm": grid.y_mm,
        "centre_x_px": centre[:, 0],
        "centre_y_px": centre[:, 1],
        "centroid_x_px": unknown,
        "centroid_y_px": unknown,
        "radius_px": np.full(len(grid.k), radius),
        "focal_length_mm": np.array(array.focal_lengths_mm)[grid.type],
        "complete": complete.astype(int),
    }
    write_table(out / "micro_images.csv", HEADER, columns)
