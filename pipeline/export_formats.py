"""Formats of exports: the cameras and targets that each can describe, what it reads of a build, and its files.

A stage that asks for an export is checked, and its tasks are planned, before there is any result: so each format states
its files by the names of cameras and frames alone. `exports/` has what the numbers in them mean, and the writers.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import combinations

from pipeline.channel_names import body_and_channel

SIDE_CAR = "export.json"
"""File in the folder of every format: the stage, the conventions, the noise."""
EXACT = "exact"
"""Name of the positions of J; chief, saddle and centroid are those of the columns with these names."""


class Cameras(StrEnum):
    """Kind of cameras that a format can describe."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedCamera:
    """A camera as exports name it: `Rig.Camera`, or `Rig.Camera@red` of a channel."""

    name: str
    is_plenoptic: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """Facts of a format that are known before a build.

    Attributes
    ----------
    cameras, targets, reads
    least_cameras : int
        Fewest cameras, or channels of one, that it relates to each other.
    files : tuple of str
        Paths in its folder. `<camera>`, `<plenoptic camera>`, `<frame>` and `<pair>` (of cameras)
        stand for as many files.
    """

    cameras: Cameras
    least_cameras: int = 1
    targets: Targets = Targets.ANY
    reads: frozenset[Reads] = frozenset({Reads.CORNERS})
    files: tuple[str, ...]

    def takes(self, is_plenoptic: bool) -> bool:
        """Whether it can describe such a camera."""
        return self.cameras is Cameras.ANY or is_plenoptic is (self.cameras is Cameras.PLENOPTIC)

    def paths(self, cameras: Iterable[NamedCamera], frames: Iterable[int]) -> list[str]:
        """All files of an export of these cameras and frames, with its side-car, sorted."""
        listed, numbers = list(cameras), list(frames)
        found = {path for pattern in self.files for path in _filled(pattern, listed, numbers)}
        return sorted({SIDE_CAR, *found})


def _filled(pattern: str, cameras: list[NamedCamera], frames: list[int]) -> Iterator[str]:
    """Paths for which a pattern stands."""
    names = [camera.name for camera in cameras]
    lists = {
        "<camera>": names,
        "<plenoptic camera>": [camera.name for camera in cameras if camera.is_plenoptic],
        "<pair>": [f"{one}-{other}" for one, other in combinations(names, 2) if is_pair(one, other)],
        "<frame>": [f"{frame:04d}" for frame in frames],
    }
    paths = [pattern]
    for word, values in lists.items():
        if word in pattern:
            paths = [path.replace(word, value) for path in paths for value in values]
    yield from paths


def is_pair(first: str, second: str) -> bool:
    """Whether two are different cameras, seen in the same channel of their sensors if these have channels."""
    (body, channel), (other_body, other_channel) = body_and_channel(first), body_and_channel(second)
    return body != other_body and channel == other_channel


def folder_of(name: str, position: str) -> str:
    """Folder of a format: `opencv`, or `opencv-saddle` with the positions of saddles."""
    return name if position == EXACT else f"{name}-{position}"


_CONVENTIONAL, _PLENOPTIC, _ANY = Cameras.CONVENTIONAL, Cameras.PLENOPTIC, Cameras.ANY
_TABLES = ("<camera>.correspondences", "<camera>.poses", "<plenoptic camera>.micro_images")
"""Data frames of a camera, without their ending."""
_MODEL = ("cameras", "images", "points3D")
"""Files of COLMAP's sparse model, without their ending."""
_LIBPLENO = (
    *("observations.bin.gz", "corners.bin.gz", "centers.csv", "features.csv"),
    *("camera.js", "intrinsics.js", "params.js", "scene.js", "poses.js"),
)
_BOK = (
    *("microlens_center_list.mat", "lens_types.mat", "correspondencesAll_<frame>.mat"),
    *("image_center.txt", "pattern_size.txt"),
)
_RAYS = frozenset({Reads.RAYS})
_NOTHING = frozenset[Reads]()

FORMATS = {
    "opencv": Format(
        cameras=_CONVENTIONAL, files=("<camera>.npz", "<camera>.yml", "stereo-<pair>.npz", "stereo-<pair>.yml")
    ),
    "opencv-multiview": Format(cameras=_CONVENTIONAL, least_cameras=2, targets=Targets.ONE, files=("multiview.npz",)),
    "mrcal": Format(cameras=_CONVENTIONAL, targets=Targets.BOARD, files=("corners.vnl", "<camera>.cameramodel")),
    "kalibr": Format(cameras=_CONVENTIONAL, targets=Targets.ONE, files=("target.yaml", "camchain.yaml", "corners.csv")),
    "colmap": Format(
        cameras=_CONVENTIONAL,
        targets=Targets.ONE,
        files=tuple(f"text/{name}.txt" for name in _MODEL) + tuple(f"binary/{name}.bin" for name in _MODEL),
    ),
    "lensboy": Format(cameras=_CONVENTIONAL, reads=_NOTHING, files=("<camera>.json",)),
    "vision-calibration": Format(cameras=_CONVENTIONAL, files=("<camera>.json",)),
    "libpleno": Format(
        cameras=_PLENOPTIC,
        targets=Targets.BOARD,
        files=tuple(f"<camera>/{name}" for name in _LIBPLENO),
    ),
    "raytrix": Format(cameras=_PLENOPTIC, reads=_NOTHING, files=("<camera>.xml",)),
    "pip": Format(cameras=_PLENOPTIC, reads=_NOTHING, files=("<camera>.MLAconfig.xml",)),
    "bok": Format(
        cameras=_PLENOPTIC,
        targets=Targets.BOARD,
        files=tuple(f"<camera>/{name}" for name in _BOK),
    ),
    "lftoolbox": Format(cameras=_PLENOPTIC, files=("<camera>.grid.json",)),
    "plenopticam": Format(cameras=_PLENOPTIC, files=("<camera>.json",)),
    "parquet": Format(cameras=_ANY, files=tuple(f"{name}.parquet" for name in _TABLES)),
    "npz": Format(cameras=_ANY, files=tuple(f"{name}.npz" for name in _TABLES)),
    "rays": Format(cameras=_ANY, reads=_RAYS, files=("<camera>.rays.npz", "<camera>.rays.exr")),
    "stmap": Format(cameras=_CONVENTIONAL, reads=_RAYS, files=("<camera>.undistort.exr", "<camera>.distort.exr")),
    "omni-lut": Format(
        cameras=_CONVENTIONAL,
        reads=_RAYS,
        files=("<camera>.ray_enter.exr", "<camera>.ray_exit.exr", "<camera>.usda"),
    ),
    "depth": Format(cameras=_ANY, reads=_RAYS | {Reads.SCENE}, files=("<camera>/<frame>.depth.exr",)),
    "lightfield": Format(
        cameras=_PLENOPTIC,
        reads=frozenset({Reads.CORNERS, Reads.IMAGES}),
        files=("<camera>/<frame>.lightfield.npz",),
    ),
}
"""Format -> its facts, in the order of `pipeline export --list`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedExports:
    """Exports that a stage asks for.

    Attributes
    ----------
    formats : tuple of str
        Names of formats, in the order of the stage.
    position : str
        Kind of position of a point: exact, chief, saddle or centroid.
    noise : dict
        Fields of `exports.noise.Noise`.
    """

    formats: tuple[str, ...] = ()
    position: str = EXACT
    noise: dict[str, float | int] = field(default_factory=dict)
