"""Task `parts`: lens elements, stop, sensor, microlenses and rays of a camera as a layer for USD viewers.

It stands alone because no other task needs USD.
"""

from pathlib import Path

from pipeline.report.page.camera_parts import camera_parts
from pipeline.scene.write.parts import parts_text
from pipeline.tasks.artefacts.cameras import Inputs, focused_camera
from pipeline.tasks.params.cameras import PARTS, Parts


def run(params: Parts, inputs: Inputs, out: Path) -> None:
    """Write parts.usda."""
    text = parts_text(camera_parts(focused_camera(inputs)), params.meters_per_unit, params.up_axis)
    (out / PARTS).write_text(text, encoding="utf-8", newline="\n")
