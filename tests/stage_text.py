"""Text that stages of the tests have in common."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from places import DATA


def head(prim: str, end: int = 1, unit: str = "0.001") -> str:
    """The first lines of a layer in millimetres with y up: its default prim, and frames from 1."""
    return f"""#usda 1.0
(
    defaultPrim = "{prim}"
    endTimeCode = {end}
    metersPerUnit = {unit}
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)
"""


def stage_in(folder: Path, text: str) -> Path:
    """The `dataset.usda` of a folder, with a text."""
    path = folder / "dataset.usda"
    path.write_text(text, encoding="utf-8")
    return path


def placed(x: object, y: object, z: object) -> str:
    """A translation, and the order that names it."""
    return f'double3 xformOp:translate = ({x}, {y}, {z})\nuniform token[] xformOpOrder = ["xformOp:translate"]'


def mesh_text(name: str, points: Sequence[tuple[float, float, float]], *lines: str, schemas: str = "") -> str:
    """One face without subdivision, and further lines of its mesh."""
    corners = list(range(len(points)))
    faces = f"int[] faceVertexCounts = [{len(corners)}]\nint[] faceVertexIndices = {corners}"
    own = f'(\nprepend apiSchemas = ["{schemas}"]\n)\n' if schemas else ""
    shape = f'point3f[] points = {list(points)}\nuniform token subdivisionScheme = "none"'
    return "\n".join([f'\ndef Mesh "{name}" {own}{{', faces, shape, *lines, "}\n"])


def in_the_library(things: str, *, board: str, rig: str = "", occluders: str = "", end: int = 1) -> str:
    """A dataset "Scene" of things beside the library's rig of 100 mm and checkerboard, with lines of those two."""
    relation = f"rel plen:occluders = <{occluders}>\n" if occluders else ""
    parts = (("Rig", "rigs/conventional_100mm", rig), ("Board", "targets/checkerboard_4x7", board))
    text = "".join(
        f'def "{name}" (\nprepend references = @{file}.usda@\n)\n{{\n{own}\n}}\n' for name, file, own in parts
    )
    top = f"rel plen:cameras = </Scene/Rig/Camera>\nrel plen:targets = </Scene/Board>\n{relation}"
    return f'{head("Scene", end=end)}def PlenDataset "Scene"\n{{\n{top}{text}{things}\n}}\n'


def over_tiny(camera: str = "", lens: str = "") -> str:
    """A layer over `tiny_conventional` with opinions on its camera and its lens."""
    sublayer = f"    subLayers = [@{(DATA / 'tiny_conventional/dataset.usda').as_posix()}@]\n)\n"
    overs = "".join(f'over "{name}"\n{{\n{text}\n}}\n' for name, text in (("Camera", camera), ("Lens", lens)))
    top = edited(head("TinyConventional", end=2), (")\n", sublayer))
    return f'{top}over "TinyConventional"\n{{\nover "Rig"\n{{\n{overs}}}\n}}\n'


def plen(at: str, **values: Any) -> dict[tuple[str, str], Any]:
    """Values by prim and attribute, of attributes that are named without their namespace and with __ for a colon."""
    return {(at, f"plen:{name.replace('__', ':')}"): value for name, value in values.items()}


def without_method(stage: str) -> str:
    """The same stage without an opinion on `plen:truth:method` and rays, so that a test can write its own."""
    return re.sub(" *uniform (token plen:truth:method|bool plen:truth:rays) = .*\n", "", stage)


def edited(stage: str, *edits: tuple[str, str]) -> str:
    """The same stage with texts replaced, each of which it has."""
    for old, new in edits:
        assert old in stage, f"{old!r} is not in the stage"
        stage = stage.replace(old, new)
    return stage


def exposed(stage: str, image: str, response: str) -> str:
    """A tiny stage with attributes of its images and of a sensor that responds, a line each, as `double x = 1`."""

    def written(lines: str) -> str:
        return "".join(f"            uniform {line.strip()}\n" for line in lines.strip().splitlines())

    camera, sensor = (f'        over "{name}"\n        {{\n' for name in ("Camera", "Sensor"))
    responds = sensor.replace("\n", ' (\n            prepend apiSchemas = ["PlenSensorResponseAPI"]\n        )\n', 1)
    return edited(stage, (camera, camera + written(image)), (sensor, responds + written(response)))


def tiny_text(kind: str, *edits: tuple[str, str]) -> str:
    """The stage of `tiny_conventional` or `tiny_plenoptic`, which finds the library from any folder, with edits."""
    text = (DATA / f"tiny_{kind}/dataset.usda").read_text(encoding="utf-8")
    return edited(text.replace("@../../../stages/", "@"), *edits)
