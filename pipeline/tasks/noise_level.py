"""Task `noise_level`: the mean of an image after the first pass, to which its noise is relative."""

import math
from pathlib import Path

from pipeline.files.jsonfile import write_json
from pipeline.tasks.artefacts.cameras import Inputs
from pipeline.tasks.artefacts.passes import LEVEL, facts_of
from pipeline.tasks.params.cameras import Nothing as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write level.json."""
    parts = [facts_of(inputs, role) for role in sorted(inputs)]
    level = math.fsum(part.light for part in parts) / sum(part.pixels for part in parts)
    write_json(out / LEVEL, {"mean": level})
