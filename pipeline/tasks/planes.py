"""Task `planes`: determine the planes of J_near and J_far.

It writes `planes.json`, which the report and the tasks that trace J read beside `focused.json`.
"""

import dataclasses
from pathlib import Path

from pipeline.camera.focusing.depth_of_field import focused
from pipeline.files.jsonfile import write_json
from pipeline.tasks.artefacts.cameras import PLANES, Inputs, focused_camera
from pipeline.tasks.params.cameras import Planes as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write planes.json."""
    camera = focused(dataclasses.replace(focused_camera(inputs), **dataclasses.asdict(params)))
    write_json(out / PLANES, {"near_mm": camera.near_mm, "far_mm": camera.far_mm})
