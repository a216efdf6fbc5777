"""New stages as text with comments, for people who go on from there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """A target in one frame: its pose in the world, and a comment on it."""

    world_from_target: np.ndarray
    comment: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetText:
    """Contents of a new dataset: name of the default prim, asset paths relative to the new file or of the library, path
    of the camera below the rig, and attributes of the target that differ from its file [mm].
    """

    name: str
    doc: str
    rig: str
    target: str
    camera: str
    values: dict[str, float]

    def with_values(self, values: dict[str, float]) -> "DatasetText":
        """The same with other values of the target."""
        return replace(self, values=values)

    def text(self, frames: Sequence[Placed]) -> str:
        """The stage, with one frame per pose."""
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
    rel plen:cameras = </{self.name}/Rig{self.camera}>
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
