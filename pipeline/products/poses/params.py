"""Parameters of poses and baselines."""

from dataclasses import dataclass, field
from typing import Annotated

from pipeline.products.views import Matrix

BASELINES = "baselines.csv"
"""Output of the task `baselines`."""


def poses_file(number: int) -> str:
    """Output of the task `frame_poses` that holds a frame."""
    return f"{number:04d}.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class PosedFrame:
    """Poses in a frame; camera_from_target by the name of the target.

    `at_lines`: those when the first line of a camera with a shutter is exposed, and the last, in the middle.
    """

    number: int
    camera_from_world: Matrix
    targets: Annotated[dict[str, Matrix], "poses targets/*"]
    at_lines: Annotated[dict[str, tuple[Matrix, ...]], "motions targets/*"] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class FramePoses:
    """Poses of a camera, with its name, in all frames."""

    camera: str
    frames: tuple[PosedFrame, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFrame:
    """camera_from_world of all cameras in a frame, in the order of their names; None of a camera that is not in it."""

    number: int
    camera_from_world: Annotated[tuple[Matrix | None, ...], "poses"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Baselines:
    """All cameras of a dataset, by name."""

    cameras: tuple[str, ...]
    frames: tuple[RigFrame, ...]
