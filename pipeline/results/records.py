"""Records of a finished output folder: cameras, targets, and views with poses and correspondences, from the files that
its manifest lists and from nothing else.
"""

import json
from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.channel_names import body_and_channel, folder_of
from pipeline.engine.output import manifest
from pipeline.errors import UsageError
from pipeline.files.jsonfile import Json, read_json
from pipeline.files.tables import Table, read_table
from pipeline.frames import distorted
from pipeline.motion import Shutter
from pipeline.records.shapes import Float64
from pipeline.results.rows import (
    MICROLENS,
    Backdrop,
    CorrespondenceRows,
    as_pandas,
    joined,
    rows_of,
    with_backdrop,
)

_BUILD = "`pipeline build STAGE` fills a folder, and writes its manifest.json last"


@dataclass(frozen=True, slots=True)
class BuiltFolder:
    """The output folder of a finished build."""

    path: Path
    stage: str  # the stage that was built, as the manifest names it
    digests: dict[str, str]  # SHA-256 of every file, by its posix path below the folder

    @property
    def files(self) -> Set[str]:
        """POSIX paths below the folder."""
        return self.digests.keys()

    def file(self, name: str) -> Path | None:
        """Path of a file; None if the build has none of this name."""
        return self.path / name if name in self.files else None

    def table(self, name: str) -> Table:
        """A table of the build; UsageError if it has vanished, DamagedFile if it cannot be read."""
        return read_table(self.present(name))

    def record(self, name: str) -> Json:
        """A JSON file of the build; raises as `table`."""
        content: Json = read_json(self.present(name))
        return content

    def present(self, name: str) -> Path:
        """Path of a file that the build made; UsageError if it has vanished."""
        path = self.path / name
        if not path.is_file():
            raise UsageError(
                f"{path} is missing, though manifest.json lists it", hint="build the stage again: lost files come back"
            )
        return path


def finished_folder(out: str | Path) -> BuiltFolder:
    """The output folder of a build; UsageError if it is none, is unfinished, or has another version."""
    path = Path(out)
    if path.suffix in (".usda", ".usdc", ".usd") and not path.is_dir():
        raise UsageError(f"{out} is a stage, and no output folder", hint=_BUILD)
    if not path.is_dir():
        raise UsageError(f"{out} is no folder", hint=_BUILD)
    listed = manifest.read(path)
    if listed.stage is None:
        raise UsageError(f"{out} holds no finished build: {_reason(listed.data)}", hint=_hint(path))
    if not any(name.endswith("camera.json") for name in listed.files):
        raise UsageError(f"{out} holds a preview, without truth", hint="build the stage without --preview")
    digests = {name: entry.sha256 for name, entry in listed.files.items()}
    return BuiltFolder(path=path, stage=str(listed.stage), digests=digests)


def _reason(data: bytes | None) -> str:
    """Reason why the bytes of a manifest are not those of a finished build."""
    if data is None:
        return "it has no manifest.json"
    try:
        version = json.loads(data)["format"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return "its manifest.json is none of a build, or damaged"
    if version != manifest.FORMAT:
        return f"its manifest.json has format {version!r}, and this version reads {manifest.FORMAT}"
    return "its manifest.json is damaged"


def _hint(path: Path) -> str:
    """Hint for a folder without a manifest of ours: it may contain builds, or be in use by one."""
    below = sorted(folder.parent for folder in path.glob(f"*/{manifest.NAME}"))
    if below:
        return f"did you mean {below[0]}?" if len(below) == 1 else f"{below[0]} and {len(below) - 1} more lie below it"
    if (path / "frames").is_dir() or (path / "cameras").is_dir():
        return "its build runs, or was interrupted, or made single targets: build the whole stage"
    return _BUILD


if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltPinhole:
    """The equivalent pinhole of a camera, as in camera.json; `Pinhole` of camera/figures fits it.

    `centre_mm`: centre of projection in the vision frame, (3,) float64.
    `principal_point_px`: (2,) float64; (0, 0) is the centre of the top-left pixel.
    `distortion`: k1, k2, p1, p2, k3 of OpenCV, (5,) float64; for a tilted sensor all 14 with tauX and tauY. Zeros in
    the pinhole without distortion.
    `rms_px`, `max_px`: residual of the mean rays of the camera.
    """

    centre_mm: np.ndarray
    principal_distance_px: float
    principal_point_px: np.ndarray
    distortion: np.ndarray
    rms_px: float
    max_px: float

    @property
    def matrix(self) -> np.ndarray:
        """Camera matrix of OpenCV, (3, 3)."""
        (x, y), f = self.principal_point_px, self.principal_distance_px
        return np.array([[f, 0.0, x], [0.0, f, y], [0.0, 0.0, 1.0]])

    @property
    def tilt_rad(self) -> np.ndarray:
        """tauX and tauY, (2,)."""
        return self.distortion[12:14] if len(self.distortion) > 5 else np.zeros(2)

    def projected(self, points_mm: Float64[np.ndarray, "n 3"]) -> np.ndarray:
        """Image positions of points of the pinhole's frame, (n, 2) [px]; `cv2.projectPoints`."""
        uv = distorted(self.distortion, *(points_mm[:, :2] / points_mm[:, 2:]).T)
        return np.stack(uv, axis=1) * self.principal_distance_px + self.principal_point_px


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltPoses:
    """Poses of a view: transforms on column vectors, (4, 4) float64 [mm]; see CONVENTIONS.md, Frames.

    Camera poses lead to the vision frame, whose origin is the centre of the aperture stop: use them with rays. Pinhole
    poses lead to the pinhole's centre: use them with OpenCV; they are empty where no pinhole fits. Targets are keyed by
    name. Poses at lines, (2, 4, 4), are those at the first and at the last line of a camera with a shutter.
    """

    camera_from_world: np.ndarray
    camera_from_target: Mapping[str, np.ndarray]
    pinhole_from_world: np.ndarray | None
    pinhole_from_target: Mapping[str, np.ndarray]
    camera_from_target_at_lines: Mapping[str, np.ndarray]


@dataclass(frozen=True, kw_only=True)
class BuiltView:
    """A camera in a frame. `size_px` is the width and height of its image."""

    camera: str
    frame: int
    is_plenoptic: bool
    size_px: tuple[int, int]
    _folder: BuiltFolder = field(repr=False, compare=False)

    @cached_property
    def correspondences(self) -> CorrespondenceRows:
        """Rows of correspondences.csv, without the columns of microlenses where there are none.

        docs/outputs.md says what the columns mean.
        """
        table = self._folder.table(self._file("correspondences.csv"))
        rows = rows_of(table, frozenset() if self.is_plenoptic else MICROLENS)
        pictures = {(self.camera, self.frame): self.preview_path} if self.preview_path else {}
        return with_backdrop(rows, Backdrop({self.camera: self.size_px}, pictures))

    @cached_property
    def poses(self) -> BuiltPoses:
        record = self._folder.record(f"frames/{self.frame:04d}/{body_and_channel(self.camera)[0]}/poses.json")
        targets = record["targets"]
        pinhole = record["pinhole"]
        from_target = {name: pose["pinhole"] for name, pose in targets.items() if pose["pinhole"]}
        return BuiltPoses(
            camera_from_world=np.array(record["camera_from_world"]),
            camera_from_target={name: np.array(pose["camera_from_target"]) for name, pose in targets.items()},
            pinhole_from_world=np.array(pinhole["pinhole_from_world"]) if pinhole else None,
            pinhole_from_target={name: np.array(pose["pinhole_from_target"]) for name, pose in from_target.items()},
            camera_from_target_at_lines={
                name: np.array([lines["first"], lines["last"]])
                for name, pose in targets.items()
                if (lines := pose.get("camera_from_target_at_lines"))
            },
        )

    @property
    def image_path(self) -> Path | None:
        """image.exr; None where the build made none."""
        return self._folder.file(self._file("image.exr"))

    @property
    def preview_path(self) -> Path | None:
        """image.png; None where the build made none."""
        return self._folder.file(self._file("image.png"))

    @property
    def positions_path(self) -> Path | None:
        """positions.exr; None where the build made none."""
        return self._folder.file(self._file("positions.exr"))

    def _file(self, file: str) -> str:
        return f"frames/{self.frame:04d}/{folder_of(self.camera)}/{file}"

    def _repr_png_(self) -> bytes | None:
        """The preview, for a notebook; None where the build made none."""
        return None if self.preview_path is None else self.preview_path.read_bytes()


@dataclass(frozen=True, kw_only=True)
class BuiltCamera:
    """A camera of a build, or one of the channels of its sensor, as the files of the build describe it.

    `name`: `Rig.Camera`, or `Rig.Camera@red` of a channel.
    `record`: all of camera.json; docs/outputs.md describes its keys.
    `views`: sorted by frame.
    """

    name: str
    record: Json = field(repr=False)
    views: tuple[BuiltView, ...] = field(repr=False)
    _folder: BuiltFolder = field(repr=False, compare=False)

    @cached_property
    def correspondences(self) -> CorrespondenceRows:
        return joined([view.correspondences for view in self.views])

    @property
    def is_plenoptic(self) -> bool:
        """Whether a microlens array stands before the sensor."""
        return "mla" in self.record

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of its images."""
        width, height = self.record["resolution"]
        return width, height

    @property
    def shutter(self) -> Shutter | None:
        """Exposure times of its lines; None where a frame is an instant."""
        plain = self.record.get("shutter")
        if plain is None:
            return None
        times = {"opens_s": plain["opens_s"], "line_s": plain["line_offset_s"], "exposure_s": plain["exposure_s"]}
        return Shutter(scan_order=plain["scan_order"], **times)

    @property
    def pitch_mm(self) -> float:
        """Pixel pitch."""
        return float(self.record["pixel_pitch_mm"])

    @cached_property
    def pinhole(self) -> BuiltPinhole | None:
        """The equivalent pinhole without distortion; None where none fits."""
        return _pinhole(self.record["pinhole"], self.record["pinhole"])

    @cached_property
    def pinhole_with_distortion(self) -> BuiltPinhole | None:
        """The equivalent pinhole with distortion; None where none fits."""
        plain = self.record["pinhole"]
        return _pinhole(plain, plain and plain["with_distortion"])

    @property
    def white_path(self) -> Path | None:
        """white.exr; None where there is none."""
        return self._folder.file(self._file("white.exr"))

    @property
    def rays_path(self) -> Path | None:
        """rays.exr; None where there is none."""
        return self._folder.file(self._file("rays.exr"))

    @cached_property
    def micro_images(self) -> np.recarray | None:
        """Rows of micro_images.csv, one per microlens; None for a conventional camera."""
        return self._table("micro_images.csv")

    @cached_property
    def micro_image_outlines(self) -> np.recarray | None:
        """Rows of micro_image_outlines.csv; None for a conventional camera."""
        return self._table("micro_image_outlines.csv")

    def pandas(self) -> "pandas.DataFrame":
        """The correspondences of all frames as a data frame."""
        return as_pandas(self.correspondences)

    def _table(self, file: str) -> np.recarray | None:
        name = self._file(file)
        return rows_of(self._folder.table(name)) if self._folder.file(name) else None

    def _file(self, file: str) -> str:
        return f"cameras/{folder_of(self.name)}/{file}"


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltTarget:
    """A target of a build: name of the prim, pattern and pattern parameters, see docs/targets.md.

    Points and normals are (n, 3) float64 in the target frame: x right, y up, z towards the viewer. The row index is the
    point_id. Actual points differ from nominal ones on warped and measured boards.
    """

    name: str
    kind: str
    parameters: Json
    points_mm: np.ndarray
    nominal_mm: np.ndarray
    normals: np.ndarray
    is_flat: bool


def target(name: str, record: Json) -> BuiltTarget:
    points = record["points"]
    return BuiltTarget(
        name=name,
        kind=record["kind"],
        parameters=record["parameters"],
        points_mm=np.array([point["actual_mm"] for point in points]),
        nominal_mm=np.array([point["nominal_mm"] for point in points]),
        normals=np.array([point["normal"] for point in points]),
        is_flat=record["surface"]["kind"] == "flat",
    )


def _pinhole(plain: Json | None, model: Json | None) -> BuiltPinhole | None:
    """A pinhole of camera.json, where the models share one centre."""
    if plain is None or model is None:
        return None
    return BuiltPinhole(
        centre_mm=np.array(plain["centre_mm"]),
        principal_distance_px=model["principal_distance_px"],
        principal_point_px=np.array(model["principal_point_px"]),
        distortion=np.array(model.get("distortion", [0.0] * 5)),
        rms_px=model["residual_px"]["rms"],
        max_px=model["residual_px"]["max"],
    )
