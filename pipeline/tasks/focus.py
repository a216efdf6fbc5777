"""Task `focus`: settle a camera's near and far planes. Writes `focused.json`, the record that all ray tasks read."""

from pathlib import Path
from typing import Any

from pipeline.camera.camera import Camera
from pipeline.camera.focus import focused
from pipeline.files.jsonfile import write_json
from pipeline.records import from_plain, to_plain
from pipeline.tasks.cameras import FOCUSED, Inputs

LIBRARIES = ("numpy",)


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: camera (plain `camera.Camera`)."""
    write_json(out / FOCUSED, to_plain(focused(from_plain(Camera, params["camera"]))))
