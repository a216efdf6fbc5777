"""Task `noise_check`: whether some rows of an image need another pass.

Its verdict is all that the next pass reads of the noise that was asked for: passes that two requests have in common are
the same tasks, so that a finer request goes on from the samples of a coarser one.
"""

from pathlib import Path

from pipeline.files.jsonfile import read_json, write_json
from pipeline.jit.work import work
from pipeline.tasks.artefacts.cameras import Inputs
from pipeline.tasks.artefacts.passes import LEVEL, VERDICT, facts_of
from pipeline.tasks.params.images import BEFORE
from pipeline.tasks.params.images import NoiseCheck as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write verdict.json, and tell the noise to whoever watches the build."""
    found, level = facts_of(inputs, BEFORE), read_json(inputs["level"][LEVEL])["mean"]
    goes_on = found.noise > params.noise * level
    write_json(out / VERDICT, {"goes_on": goes_on})
    if level > 0:
        work().news = f"noise {found.noise / level:.2g}, asked {params.noise:g}"
