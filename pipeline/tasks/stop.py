"""Task `stop`: a focused camera with its stop set to another F-number, for a further white image.

It writes `focused.json` like the task `focus`, so that white images and micro-images are made of it in the same way.
"""

from pathlib import Path
from typing import Any

from pipeline.camera.stop import stopped_down
from pipeline.files.jsonfile import write_json
from pipeline.records import to_plain
from pipeline.tasks.cameras import FOCUSED, Inputs, focused_camera


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: f_number."""
    write_json(out / FOCUSED, to_plain(stopped_down(focused_camera(inputs), params["f_number"])))
