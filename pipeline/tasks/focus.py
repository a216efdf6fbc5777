"""Task `focus`: settle a camera's near and far planes and report its first-order optics.

Writes `focused.json`, the record that all ray tasks read, and `camera.json`, the report.
"""

from pathlib import Path
from typing import Any

from pipeline.camera.camera import Camera
from pipeline.camera.focus import focused
from pipeline.camera.report import report
from pipeline.files.jsonfile import write_json
from pipeline.records import from_plain, to_plain
from pipeline.tasks.cameras import FOCUSED, Inputs

LIBRARIES = ("numpy",)

CONVENTIONS = {
    "pixel": "(0, 0) is the centre of the top-left pixel, x right, y down",
    "vision_frame": "origin at the centre of the aperture stop, x right, y down, z forward, mm",
    "target_frame": "origin at the pattern centre, x right, y up, z towards the viewer, mm",
    "distances": "vision z from the aperture stop, mm",
}


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: camera (plain `camera.Camera`), labels (what the report says besides)."""
    camera = focused(from_plain(Camera, params["camera"]))
    labels = params["labels"]
    figures = report(camera)
    lens = {"name": labels["lens_name"], "index_source": labels["index_source"], **figures.pop("lens")}
    head = {name: figures.pop(name) for name in ("resolution", "pixel_pitch_mm", "sensor_mm", "sensor_distance_mm")}
    light = {"weight": labels["weight"], "footprint": labels["footprint"], "wavelengths_nm": [labels["wavelength_nm"]]}
    write_json(out / "camera.json", {**head, "conventions": CONVENTIONS, **light, "lens": lens, **figures})
    write_json(out / FOCUSED, to_plain(camera))
