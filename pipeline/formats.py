"""Export formats: the record that describes a format, and the discovery of formats in all installed packages.

A format is a module with `FORMAT`, a `Format`, and `write(material, folder)`, which lays out an
`exports.material.Material` as files; its `central_model(camera, models)`, if it has one, replaces that of
`exports.central`. An entry point of the group `plenoptic_pipeline.formats` names it, in this package or in another. A
stage that asks for an export is checked, and its tasks are planned, before there is any result; so a format derives its
file names from the names of cameras and frames alone. docs/export_format.md writes one.

Our own conventions are those of CONVENTIONS.md: the centre of the top-left pixel is (0, 0), x right, y down; mm; poses
from the target, whose frame has its origin in the middle, x right, y up, z towards the viewer.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from importlib.metadata import EntryPoint
from itertools import combinations
from types import ModuleType

import numpy as np

from pipeline.channel_names import body_and_channel
from pipeline.entry_points import offered, package_of
from pipeline.errors import UsageError
from pipeline.spelling import did_you_mean

SIDE_CAR = "export.json"
"""Side-car file of every export: the stage, the conventions, the noise."""
EXACT = "exact"
"""Name of the positions of J; chief, saddle and centroid are the columns of these names."""


class ExportError(UsageError):
    """An unknown format, a format that cannot hold the build, or contradictory exports."""


class Cameras(StrEnum):
    """Cameras that a format can describe."""

    CONVENTIONAL = "conventional"
    PLENOPTIC = "plenoptic"
    ANY = "any"


class Targets(StrEnum):
    """Targets that a format can describe."""

    ANY = "any"
    ONE = "one"
    BOARD = "one, whose points form a grid"


class Reads(StrEnum):
    """Results that a format reads, besides camera.json and the micro-images."""

    CORNERS = "correspondences and poses"
    IMAGES = "linear images"
    RAYS = "rays of pixels"
    SCENE = "surfaces before the cameras"


class Origin(StrEnum):
    """Coordinate that a format gives to the centre of the top-left pixel; the middle of an image may lie between
    pixels.
    """

    ZERO = "0"
    HALF = "0.5"
    ONE = "1"
    IMAGE_CENTRE = "from the image centre"
    SHARE = "0.5 / size"
    """Shares of width and height, from a corner: half a pixel of them."""


_FIRST_PIXEL = {Origin.ZERO: 0.0, Origin.HALF: 0.5, Origin.ONE: 1.0}
"""Coordinate of the centre of the top-left pixel [px]; for all other origins it depends on the image size."""


class ImageAxes(StrEnum):
    """Order and direction of image coordinates."""

    X_Y = "x right, y down"
    Y_X = "y down, then x right"
    X_UP = "x right, y up"


class Board(StrEnum):
    """Frame in which a format states target points."""

    RIGHT_DOWN = "from point 0, x right, y down, z away from the viewer"
    KALIBR = "from point 0, z towards the viewer; x down, y right, but x right, y up of AprilGrids"
    OURS = "from the middle of the pattern, x right, y up, z towards the viewer"
    NONE = "none, columns and rows alone"


class Pose(StrEnum):
    """Direction of a stored pose."""

    CAMERA_FROM_TARGET = "camera from target"
    TARGET_FROM_CAMERA = "target from camera"
    CAMERA_FROM_FIRST = "camera from first camera"
    CAMERA_FROM_PREVIOUS = "camera from previous camera"
    NONE = "none"


class CameraAxes(StrEnum):
    """Camera axes of a stored pose."""

    VISION = "x right, y down, z forward"
    OPENGL = "x right, y up, z backward"


class Centre(StrEnum):
    """Point of the camera that a pose refers to."""

    PINHOLE = "equivalent pinhole"
    FITTED_TO_ROWS = "pinhole of the rows"
    """The pinhole that a calibration finds in the exported correspondences, as export.json states it; the equivalent
    pinhole where these determine none."""
    CENTRAL = "central model of the image"
    """The equivalent pinhole, or what export.json states: one of `Format.models` that leaves less."""
    PRINCIPAL_POINT = "front principal point"


class Rotation(StrEnum):
    """Representation of a stored rotation."""

    VECTOR = "Rodrigues vector"
    MATRIX = "matrix, by rows"
    COLUMNS = "matrix, by columns"
    QUATERNION = "quaternion w, x, y, z"
    NONE = "none"


class Unit(StrEnum):
    """Unit of length in space."""

    MM = "mm"
    M = "m"
    NONE = "none"


class Microlenses(StrEnum):
    """Numbering of microlenses and of their types."""

    NONE = "none"
    AXIAL = "axial (k, l); type as in CONVENTIONS.md"
    FROM_CENTRAL = "type counted from that of the microlens nearest to the middle of the image"
    TYPES_FROM_ONE = "type 1, 2, 3 for 0, 1, 2 of ours"
    MICRO_IMAGE_GRID = "column, row of the micro-image from the top left; type ((row mod 2) + column) mod 3"


@dataclass(frozen=True, slots=True, kw_only=True)
class Convention:
    """Meaning of a format's numbers. `exports.conversion`, and nothing else, converts a build to it."""

    origin: Origin
    axes: ImageAxes = ImageAxes.X_Y
    board: Board = Board.NONE
    pose: Pose = Pose.NONE
    centre: Centre = Centre.PINHOLE
    rotation: Rotation = Rotation.NONE
    camera_axes: CameraAxes = CameraAxes.VISION
    unit: Unit = Unit.NONE
    microlenses: Microlenses = Microlenses.NONE

    @property
    def scale(self) -> float:
        """One millimetre, in this unit."""
        return 1e-3 if self.unit is Unit.M else 1.0

    def positions(self, ours_px: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
        """Our image positions in the coordinates of this convention, (..., 2) [px, or 1].

        `size_px` is the width and height of the image.
        """
        upwards = self.axes is ImageAxes.X_UP
        if self.origin is Origin.SHARE:
            shares = (ours_px + _FIRST_PIXEL[Origin.HALF]) / np.array(size_px)
            shifted = np.stack([shares[..., 0], 1 - shares[..., 1]], axis=-1) if upwards else shares
        elif self.origin is Origin.IMAGE_CENTRE:
            shifted = (ours_px - (np.array(size_px) - 1) / 2) * (1, -1 if upwards else 1)
        else:
            shifted = (ours_px + _FIRST_PIXEL[self.origin]) * (1, -1 if upwards else 1)
        return shifted[..., ::-1] if self.axes is ImageAxes.Y_X else shifted


OURS = Convention(origin=Origin.ZERO, board=Board.OURS, unit=Unit.MM, microlenses=Microlenses.AXIAL)
"""Our own conventions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Format(Convention):
    """An export format: its consumer, its files, the parts of a build that it reads, and the meaning of its numbers."""

    consumer: str  # who reads it
    source: str = ""  # how we know: programs that are run on files, in every test or in a proof, and what was only read
    note: str = ""  # facts that a reader of its files has to know, beside their names
    # Paths in its folder; <camera>, <plenoptic camera>, <frame>, <pair> (of cameras), and by numbers of six digits
    # <frame6> and, counted from 0, <camera6> and <target6> stand for as many files
    files: tuple[str, ...]
    cameras: Cameras
    targets: Targets = Targets.ANY
    reads: frozenset[Reads] = frozenset({Reads.CORNERS})
    models: tuple[str, ...] = ()  # models of `pipeline fit` that it knows besides the pinhole, the simplest first
    least_cameras: int = 1  # fewest cameras, or channels of one, that it relates to each other

    def takes(self, is_plenoptic: bool) -> bool:
        """Whether the format can describe such a camera."""
        return self.cameras is Cameras.ANY or is_plenoptic is (self.cameras is Cameras.PLENOPTIC)

    def paths(self, cameras: Mapping[str, bool], frames: Mapping[str, Sequence[int]], targets: int) -> list[str]:
        """All files of an export, with its side-car, sorted.

        `cameras`: name, as `Rig.Camera` or `Rig.Camera@red` of a channel -> whether it is plenoptic.
        `frames`: of each camera.
        `targets`: number of targets.
        """
        all_frames = sorted({number for numbers in frames.values() for number in numbers})
        # Placeholder -> the texts that replace it, each with its frames
        texts_of: dict[str, dict[str, Sequence[int]]] = {
            "<pair>": {f"{first}-{second}": all_frames for first, second in pairs(cameras, frames)},
            "<target6>": {f"{number:06d}": all_frames for number in range(targets)},
            "<camera>": {name: frames[name] for name in cameras},
            "<plenoptic camera>": {name: frames[name] for name, is_plenoptic in cameras.items() if is_plenoptic},
            "<camera6>": {f"{number:06d}": frames[name] for number, name in enumerate(cameras)},
        }
        paths = {SIDE_CAR}
        for pattern in self.files:
            frames_of_path: dict[str, Sequence[int]] = {pattern: all_frames}
            for word, texts in texts_of.items():
                if word in pattern:
                    frames_of_path = {
                        path.replace(word, text): texts[text] for path in frames_of_path for text in texts
                    }
            for path, numbers in frames_of_path.items():
                for number in numbers if "<frame" in path else [0]:
                    paths.add(path.replace("<frame>", f"{number:04d}").replace("<frame6>", f"{number:06d}"))
        return sorted(paths)


def pairs(cameras: Iterable[str], frames: Mapping[str, Sequence[int]]) -> list[tuple[str, str]]:
    """Pairs of different cameras that share a frame; of cameras with channels, pairs within the same channel.

    `frames`: of each camera.
    """
    split = {name: body_and_channel(name) for name in cameras}
    return [
        (first, second)
        for first, second in combinations(split, 2)
        if split[first][0] != split[second][0] and split[first][1] == split[second][1]
        if set(frames[first]) & set(frames[second])
    ]


def folder_of(name: str, position: str) -> str:
    """Folder of an exported format: `opencv`, or `opencv-saddle` with the positions of saddles."""
    return name if position == EXACT else f"{name}-{position}"


def names() -> list[str]:
    """Sorted names of all formats of the installed packages, without loading any."""
    return sorted(offered("format"))


def format_of(name: str) -> Format:
    """The format of this name; its module is loaded.

    Raises ExportError: as `module_of`.
    """
    record: Format = module_of(name).FORMAT
    return record


def loadable() -> dict[str, Format]:
    """Name -> format for every format that loads: the choices of `pipeline export`."""
    formats = {}
    for name in names():
        with suppress(ExportError):  # whoever asks for it is told
            formats[name] = format_of(name)
    return formats


def module_of(name: str) -> ModuleType:
    """The module of a format, with `FORMAT` and `write`.

    Raises ExportError: no format has this name, two packages define it, or its package is broken.
    """
    entry = entry_of(name)
    subject = f'the export format "{name}" of the package {package_of(entry)}'
    try:
        module: ModuleType = entry.load()
    except Exception as error:  # a stranger's code may fail in any way
        message = f"{subject} cannot be loaded: {type(error).__name__}: {error}"
        raise ExportError(message, hint="mend or remove that package", code="broken-export") from error
    if not isinstance(getattr(module, "FORMAT", None), Format) or not callable(getattr(module, "write", None)):
        message = f"{subject} is {entry.value}, which has no FORMAT or no write"
        hint = "its entry point names a module with both: docs/export_format.md"
        raise ExportError(message, hint=hint, code="broken-export")
    return module


def entry_of(name: str) -> EntryPoint:
    """The entry point of a format, not loaded.

    Raises ExportError: no format has this name, or two packages define it.
    """
    entries = offered("format").get(name, [])
    if len(entries) > 1:
        packages = " and ".join(sorted(map(package_of, entries)))
        message = f'the packages {packages} each have an export format "{name}"'
        raise ExportError(message, hint="remove one of them", code="broken-export")
    if not entries:
        installed = ", ".join(names()) or "none is installed: install plenoptic-pipeline again"
        guess = did_you_mean(name, names())
        hint = f"{guess} formats: {installed}" if guess else f"formats: {installed}"
        raise ExportError(f'there is no export format "{name}"', hint=hint, code="unknown-export")
    return entries[0]
