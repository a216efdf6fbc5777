"""Mistakes that newcomers made, and words that must come of them."""

import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

STAGE = """#usda 1.0
(
    defaultPrim = "Mine"
    endTimeCode = 2
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)

def PlenDataset "Mine"
{
    rel plen:cameras = </Mine/Rig/Camera>
    uniform int plen:seed = 7
    rel plen:targets = </Mine/Board>

    def "Rig" (
        prepend references = @rigs/conventional_100mm.usda@
    )
    {
        over "Sensor"
        {
            uniform double plen:pixelPitch = 0.01
        }
    }

    def "Board" (
        prepend references = @targets/checkerboard_4x7.usda@
    )
    {
        double3 xformOp:translate = (0, 0, -430)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""
"""A dataset without a mistake."""


@dataclass(frozen=True)
class Stone:
    """A mistake: a line of the stage written otherwise, the command, and a pattern that its output must have."""

    name: str
    says: str
    right: str = ""
    wrong: str = ""
    command: str = "pipeline check mine.usda"

    def is_gone(self, folder: Path, environment: dict[str, str]) -> bool:
        """Whether the command says what it should, and no Python traceback."""
        folder.mkdir(exist_ok=True)
        (folder / "mine.usda").write_text(STAGE.replace(self.right, self.wrong) if self.right else STAGE)
        done = subprocess.run(
            self.command, shell=True, cwd=folder, env={**environment, "COLUMNS": "200"}, capture_output=True, text=True
        )
        text = done.stdout + done.stderr
        return "Traceback" not in text and re.search(self.says, text) is not None


ORDER = 'uniform token[] xformOpOrder = ["xformOp:translate"]'
TURNED = """double xformOp:rotateY = 180
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]"""
BLOCK = """{
            uniform double plen:pixelPitch = 0.01
        }"""
ONE_LINE = "{ uniform double plen:pixelPitch = 0.01 }"
PLACE = "double3 xformOp:translate = (0, 0, -430)"
STONES = (
    Stone("no mistake", r"0 errors, 0 warnings"),
    Stone("board out of view", r"sees no point of \"Board\".*out of view", PLACE, PLACE.replace("(0,", "(900,")),
    Stone("board behind the camera", r"sees no point|behind", PLACE, PLACE.replace("-430", "430")),
    Stone("board shows its back", r"shows its back", ORDER, TURNED),
    Stone("pixel pitch in micrometres", r"lengths are millimetres", "pixelPitch = 0.01", "pixelPitch = 10"),
    Stone("half a seed", r"whole numbers, not 7.5", "seed = 7", "seed = 7.5"),
    Stone("file name mistyped", r"did you mean @targets/checkerboard_4x7.usda@", "checkerboard_4x7", "checkerbord_4x7"),
    Stone("attribute mistyped", r'did you mean "plen:pixelPitch"', "plen:pixelPitch", "plen:pixelpitch"),
    Stone("brace on the line", r"closing brace", BLOCK, ONE_LINE),
    Stone("no xformOpOrder", r"xformOpOrder = \[", ORDER, ""),
    Stone("prim that is not there", r"did you mean|nothing defines", 'over "Sensor"', 'over "Senser"'),
    Stone("verb mistyped", r"Did you mean 'build'", command="pipeline bild mine.usda"),
    Stone("-h", r"Usage: pipeline build", command="pipeline build -h"),
    Stone("default of --out", r"build/NAME-OF-THE-STAGE", command="pipeline build --help"),
    Stone("a lens by its name", r"effective focal length", command="pipeline show lenses/cooke_triplet_50mm.usda"),
    Stone("a list of what there is", r"rigs/conventional_100mm.usda", command="pipeline library rigs"),
    Stone("a stage as output", r"is a stage, and no output folder", command="pipeline report mine.usda"),
)
