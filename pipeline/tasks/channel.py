"""Task `channel`: a camera as one of its colour channels sees it, in place of that of task `focus`."""

from pathlib import Path

from pipeline.files.jsonfile import write_json
from pipeline.records.plain import to_plain
from pipeline.tasks.artefacts.cameras import FOCUSED, Inputs, focused_camera
from pipeline.tasks.params.cameras import InChannel as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write focused.json."""
    write_json(out / FOCUSED, to_plain(focused_camera(inputs).in_light(params.channel)))
