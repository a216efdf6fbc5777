"""New stages as text with comments, for people who go on from there, and the stages that they name."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.errors import UsageError
from pipeline.folders import share
from pipeline.spelling import did_you_mean


def found(path: Path) -> Path:
    """A stage in the working directory, or of the library.

    Raises
    ------
    UsageError
        It is in neither.
    """
    if path.exists():
        return path
    library = share("stages")
    if (library / path).is_file():
        return library / path
    known = [one.relative_to(library).as_posix() for one in library.glob("*/*.usda")]
    same = [one for one in known if Path(one).stem == path.stem]
    meant = f'did you mean "{same[0]}"?' if same else did_you_mean(str(path), known)
    raise UsageError(
        f"there is no {path}, and the library has none", hint=meant or "`pipeline library` lists what it has"
    )


def asset(path: Path, out: Path) -> str:
    """Asset path of a stage for a layer that lies at `out`; names of the library stay names."""
    if not path.exists():
        return path.as_posix()
    relative = Path(os.path.relpath(path.resolve(), out.resolve().parent)).as_posix()
    return relative if relative.startswith("..") else f"./{relative}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """A target in one frame: its pose in the world, and a comment on it."""

    world_from_target: np.ndarray
    comment: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetText:
    """Contents of a new dataset.

    Attributes
    ----------
    name : str
        Name of the default prim.
    doc : str
    rig, target : str
        Asset paths, relative to the new file or of the library.
    cameras : tuple of str
        Paths of the cameras below the rig.
    values : dict
        Attributes of the target that differ from its file, in millimetres.
    """

    name: str
    doc: str
    rig: str
    target: str
    cameras: tuple[str, ...]
    values: dict[str, float]

    def text(self, frames: Sequence[Placed]) -> str:
        """The stage, with one frame per pose."""
        cameras = ", ".join(f"</{self.name}/Rig{camera}>" for camera in self.cameras)
        return f'''#usda 1.0
(
    defaultPrim = "{self.name}"
    doc = """{self.doc}"""
    endTimeCode = {len(frames)}
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)

def PlenDataset "{self.name}" (
    kind = "assembly"
)
{{
    rel plen:cameras = {f"[{cameras}]" if len(self.cameras) > 1 else cameras}
    uniform int plen:seed = 1
    rel plen:targets = </{self.name}/Board>

    # The camera with its lens and sensor. Say here what shall be different: over "Sensor" {{ ... }}
    def "Rig" (
        prepend references = @{self.rig}@
    )
    {{
    }}

    # The target. Its frame: x right, y up, z towards the viewer. Lengths are millimetres.
    def "Board" (
        prepend references = @{self.target}@
    )
    {{
{self._values()}        quatd xformOp:orient.timeSamples = {{
{_samples(frames, _quaternion)}        }}
        double3 xformOp:translate.timeSamples = {{
{_samples(frames, _translation, with_comments=True)}        }}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
    }}
}}
'''

    def _values(self) -> str:
        return "".join(f"        uniform double {name} = {value:.6g}\n" for name, value in self.values.items())


def _samples(frames: Sequence[Placed], shown: Callable[[np.ndarray], str], *, with_comments: bool = False) -> str:
    lines = []
    for number, frame in enumerate(frames, 1):
        value = shown(frame.world_from_target)
        comment = f"  # {frame.comment}" if with_comments and frame.comment else ""
        lines.append(f"            {number}: {value},{comment}\n")
    return "".join(lines)


def _translation(pose: np.ndarray) -> str:
    return f"({', '.join(f'{x:.6f}'.rstrip('0').rstrip('.') for x in pose[:3, 3] + 0.0)})"


def _quaternion(pose: np.ndarray) -> str:
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True) + 0.0
    return f"({', '.join(f'{part:.15g}' for part in (w, x, y, z))})"
