"""Task `first_order`: the first-order report of a camera, camera.json.

It is not part of `focus`, because it writes names: renaming a lens must not touch a ray.
"""

import dataclasses
from pathlib import Path
from typing import Any

from pipeline.camera.camera import Camera
from pipeline.camera.report import report
from pipeline.files.jsonfile import write_json
from pipeline.tasks.cameras import Inputs, focused_camera

CONVENTIONS = {
    "pixel": "(0, 0) is the centre of the top-left pixel, x right, y down",
    "vision_frame": "origin at the centre of the aperture stop, x right, y down, z forward, mm",
    "target_frame": "origin at the pattern centre, x right, y up, z towards the viewer, mm",
    "distances": "vision z from the aperture stop, mm",
}

_FIRST = ("resolution", "pixel_pitch_mm", "pixel_acceptance", "sensor_mm", "sensor_distance_mm")


def document(labels: dict[str, Any], camera: Camera) -> dict[str, Any]:
    """What camera.json says of a focused camera; `labels` is what it says besides."""
    figures = report(camera)
    lens = {"name": labels["lens_name"], "index_source": labels["index_source"], **figures.pop("lens")}
    head = {name: figures.pop(name) for name in _FIRST}
    light = {"weight": labels["weight"], "footprint": labels["footprint"], "wavelengths_nm": [labels["wavelength_nm"]]}
    head["focus_request"] = labels.get("focus_request")
    return {**head, "conventions": CONVENTIONS, **light, "lens": lens, **figures}


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: labels (what the report says besides), circle_of_confusion_px."""
    camera = dataclasses.replace(focused_camera(inputs), circle_of_confusion_px=params["circle_of_confusion_px"])
    write_json(out / "camera.json", document(params["labels"], camera))
