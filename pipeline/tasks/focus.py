"""Task `focus`: place the sensor and set the stop.

It writes `focused.json`, the record that all tasks of a camera read. Near and far planes are no part of it (see the
task `planes`): no image depends on them.
"""

from pathlib import Path

from pipeline.camera.focusing.focus_request import solved
from pipeline.files.jsonfile import write_json
from pipeline.records.plain import to_plain
from pipeline.tasks.artefacts.cameras import FOCUSED, Inputs
from pipeline.tasks.params.cameras import Focus as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write focused.json."""
    write_json(out / FOCUSED, to_plain(solved(params.asked)))
