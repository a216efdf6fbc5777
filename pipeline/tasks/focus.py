"""Task `focus`: place the sensor and set the stop.

It writes `focused.json`, the record that all tasks of a camera read. Near and far planes are no part of it (see the
task `planes`): no image depends on them.
"""

from pathlib import Path
from typing import Any

from pipeline.camera.camera import Camera
from pipeline.camera.request import FocusRequest, solved
from pipeline.files.jsonfile import write_json
from pipeline.records import from_plain, to_plain
from pipeline.tasks.cameras import FOCUSED, Inputs


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: camera (plain `camera.Camera`) or request (plain `request.FocusRequest`)."""
    if "request" in params:
        camera: Camera | FocusRequest = from_plain(FocusRequest, params["request"])
    else:
        camera = from_plain(Camera, params["camera"])
    write_json(out / FOCUSED, to_plain(solved(camera)))
