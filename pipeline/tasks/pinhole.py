"""Task `pinhole`: the equivalent pinhole of a camera, for programs that know no other model.

It writes `pinhole.json`, which the report of the camera and its poses read; null where no pinhole can be fitted.
"""

from pathlib import Path

from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.files.jsonfile import write_json
from pipeline.records.plain import to_plain
from pipeline.tasks.artefacts.cameras import PINHOLE, Inputs, focused_camera
from pipeline.tasks.params.cameras import Nothing as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write pinhole.json."""
    write_json(out / PINHOLE, to_plain(pinhole(focused_camera(inputs))))
