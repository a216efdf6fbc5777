"""Task `planes`: settle the planes of J_near and J_far.

It writes `planes.json`, which the report and the tasks that trace J read beside `focused.json`.
"""

import dataclasses
from pathlib import Path
from typing import Any

from pipeline.camera.focus import focused
from pipeline.files.jsonfile import write_json
from pipeline.tasks.cameras import PLANES, Inputs, focused_camera


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: near_mm, far_mm (null: derived), circle_of_confusion_px."""
    camera = focused(dataclasses.replace(focused_camera(inputs), **params))
    write_json(out / PLANES, {"near_mm": camera.near_mm, "far_mm": camera.far_mm})
