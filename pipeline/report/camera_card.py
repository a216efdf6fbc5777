"""A camera in a notebook: its key figures, and the drawing with real rays."""

import math

from pipeline.camera.focusing.depth_of_field import middle_focus
from pipeline.camera.parts.camera import Camera
from pipeline.notebook.markup import table
from pipeline.optics.first_order import first_order
from pipeline.report import drawing


def card(camera: Camera, name: str) -> str:
    """HTML of a focused camera."""
    lens, sensor, focus_mm = first_order(camera.prescription), camera.sensor, middle_focus(camera)
    array = camera.microlenses
    rows = [
        ("focal length", f"{lens.efl_mm:.4g} mm"),
        ("entrance pupil", f"{lens.entrance_pupil.diameter_mm:.4g} mm wide"),
        ("in focus", "infinity" if math.isinf(focus_mm) else f"{focus_mm:.5g} mm before the stop"),
        ("sensor", f"{sensor.width_px} x {sensor.height_px} px of {1000 * sensor.pitch_mm:g} µm"),
    ]
    if array is not None:
        kinds = ", ".join(f"{length:.4g}" for length in array.focal_lengths_mm)
        rows.append(("microlenses", f"{array.pitch_mm:.4g} mm apart, f = {kinds} mm"))
    return table(("camera", name), rows) + drawing.svg(camera, name)
