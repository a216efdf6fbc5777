"""Task `stop`: a focused camera with its stop set to another F-number, for a further white image.

It writes `focused.json` like the task `focus`, so that white images and micro-images are made from it in the same
way.
"""

from pathlib import Path

from pipeline.camera.focusing.focus_request import stopped_down
from pipeline.files.jsonfile import write_json
from pipeline.records.plain import to_plain
from pipeline.tasks.artefacts.cameras import FOCUSED, Inputs, focused_camera
from pipeline.tasks.params.cameras import Stop as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write focused.json."""
    write_json(out / FOCUSED, to_plain(stopped_down(focused_camera(inputs), params.f_number)))
