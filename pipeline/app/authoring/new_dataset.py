"""A new dataset: a rig, a target, and poses that fill the cameras' field of view and depth of field."""

import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.app.authoring.poses import PLENOPTIC_SHARES, SHARES, BoardPose, CameraField, Wish, poses_that_fill
from pipeline.app.stages import asset_path, chosen, require_free, sound, stage_or_library_path, unwritten, write_sound
from pipeline.camera.focusing.depth_of_field import view_of
from pipeline.engine.files import chosen_place
from pipeline.entry_points import offered, plugged_in
from pipeline.errors import UsageError
from pipeline.frames import inverse
from pipeline.records.declared import attributes_of
from pipeline.scene.dataset import Dataset
from pipeline.scene.load import Loaded, load
from pipeline.scene.usd.problems import StageError
from pipeline.scene.write.text import identifier
from pipeline.targets.patterns.pattern import TargetError
from pipeline.targets.target import Target

_FAR_MM = 1e5
"""Distance at which a target is parked until it has poses [mm]: a hundred metres, behind no lens and inside none."""
_LIBRARY_FOLDER = {"camera": "rigs", "target": "targets"}
"""Kinds of library parts that contain a camera or a target."""
_CODES_PER_S = 24
"""Time codes per second in all stages that are written [1/s]."""
_FINE = 1e4
"""Fractions of a time code to which samples around a held pose are rounded outwards [1]: no exposure sees motion."""
_CELLS = 8, 6
"""Cells of the image in which the points of all frames are counted, along x and y."""
_Frame = tuple[np.ndarray, str]
"""World_from_target of one frame, and a comment."""
_Pose = tuple[int, tuple[float, float], np.ndarray, str]
"""Time code of a frame, time codes relative to it between which the pose is held, world_from_target, and a comment."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _DatasetText:
    """Contents of a new dataset: paths of `cameras` below the rig, and `values`, lengths of the target [mm]."""

    name: str
    doc: str
    rig: str
    target: str
    cameras: tuple[str, ...]
    values: dict[str, float]
    # Time codes before and after a frame for which its pose is held, while a shutter may be open
    held: tuple[float, float] = (0.0, 0.0)

    def text(self, frames: Sequence[_Frame]) -> str:
        """The stage, with one frame per pose."""
        cameras = ", ".join(f"</{self.name}/Rig{camera}>" for camera in self.cameras)
        values = "".join(f"        uniform double {name} = {value:.6g}\n" for name, value in self.values.items())
        step = math.floor(self.held[1] - self.held[0]) + 1  # no frame begins while another is held
        codes = range(1, step * len(frames) + 1, step)
        listed = f"    uniform int[] plen:frames = {list(codes)}\n" if step > 1 else ""
        poses = [(code, self.held, *frame) for code, frame in zip(codes, frames, strict=True)]
        return f'''#usda 1.0
(
    defaultPrim = "{self.name}"
    doc = """{self.doc}"""
    endTimeCode = {codes[-1]}
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = {_CODES_PER_S}
    upAxis = "Y"
)

def PlenDataset "{self.name}" (
    kind = "assembly"
)
{{
    rel plen:cameras = {f"[{cameras}]" if len(self.cameras) > 1 else cameras}
{listed}    uniform int plen:seed = 1
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
{values}        quatd xformOp:orient.timeSamples = {{
{_samples(poses, _quaternion)}        }}
        double3 xformOp:translate.timeSamples = {{
{_samples(poses, _translation, with_comments=True)}        }}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
    }}
}}
'''


def new_dataset(
    out: Path, rig: Path, target: Path, wish: Wish, camera: str | None, tell: Callable[[str], None]
) -> Loaded:
    """Write a dataset whose poses fill the fields of view and the depths of field of cameras, and read it again.

    Rig and target are files, or names of the library such as `rigs/conventional_100mm.usda`. All cameras of the rig see
    each pose unless one is named. `tell` reports each pose as soon as it is found, or chosen, and the coverage of all.
    StageError if the rig or the target does not pass `check`; UsageError if a part is missing, the file cannot be
    written, or the target is too large for the cameras.
    """
    require_free(out)
    best_of = plugged_in("pose", "best") if wish.of > 1 else None
    plan = _plan(out, rig, target, camera)
    dataset = _read(out, plan)
    fields, poses = _filled(_fields(dataset, wish), tell)
    if best_of:
        poses = best_of(fields, poses, wish.count, tell)
        for number, pose in enumerate(poses, 1):
            tell(f"pose {number} of {wish.count}: {_comment(pose)}")
    if wish.fit:
        board: Any = fields[0].target
        values = {attribute: getattr(board.pattern, name) for name, attribute in _lengths(board).items()}
        plan = dataclasses.replace(plan, values=values)
    world_from_camera = inverse(np.array(dataset.frames[0].camera_from_world[dataset.cameras[0].name]))
    frames = [(world_from_camera @ pose.vision_from_target, _comment(pose)) for pose in poses]
    lines = [*_summary([entry.name for entry in dataset.cameras], fields, poses), *_limit(fields)]
    plan = dataclasses.replace(plan, doc=_documentation(lines, fields), held=_held(dataset))
    loaded = write_sound(plan.text(frames), out)
    for line in lines:
        tell(line)
    return loaded


def _plan(out: Path, rig: Path, target: Path, camera: str | None) -> _DatasetText:
    """The dataset before its poses are known; UsageError if the rig has no camera, or the target file no target."""
    rig_stage = sound(stage_or_library_path(rig))
    target_stage = sound(stage_or_library_path(target))
    names = [entry.name for entry in rig_stage.cameras]
    if not names or not target_stage.targets:
        kind, path = ("camera", rig) if not names else ("target", target)
        raise UsageError(f"{path} holds no {kind}", hint=f"`pipeline library {_LIBRARY_FOLDER[kind]}` lists some")
    if rig_stage.dataset:
        raise UsageError(f"{rig} is a dataset", hint="name a stage of one or more cameras without a PlenDataset")
    numbers = range(len(names)) if camera is None else [chosen(rig, "camera", names, camera)]
    return _DatasetText(
        name=identifier(out.stem if out.stem != "dataset" else out.resolve().parent.name),
        doc="",
        rig=asset_path(rig, out),
        target=asset_path(target, out),
        cameras=tuple("/" + rig_stage.cameras[number].prim_path.strip("/").partition("/")[2] for number in numbers),
        values={},
    )


def _fields(dataset: Dataset, wish: Wish) -> list[CameraField]:
    """The cameras of a dataset before its target, in the states of its first frame."""
    camera_from_world = dataset.frames[0].camera_from_world
    cameras = [entry for entry in dataset.cameras if entry.name in camera_from_world]
    vision_from_world = [np.array(camera_from_world[entry.name]) for entry in cameras]
    first_from_world = vision_from_world[0]
    target = dataset.targets[0].target
    return [
        CameraField(camera=entry.camera, target=target, wish=wish, vision_from_first=vision @ inverse(first_from_world))
        for entry, vision in zip(cameras, vision_from_world, strict=True)
    ]


def _held(dataset: Dataset) -> tuple[float, float]:
    """Time codes, relative to the frame's own, of the first and last instant at which a shutter is open."""
    open_s = [entry.shutter.motion_s(entry.camera.sensor.size_px) for entry in dataset.cameras if entry.shutter]
    fractions = _CODES_PER_S * _FINE * np.ravel(open_s)
    first = math.floor(np.min(fractions, initial=0.0))
    last = math.ceil(np.max(fractions, initial=0.0))
    return first / _FINE, last / _FINE


def _filled(fields: list[CameraField], tell: Callable[[str], None]) -> tuple[list[CameraField], list[BoardPose]]:
    """The fields and poses that fill them; with `fit`, their target is scaled to the largest size that has poses."""
    first = fields[0]
    poses = list[BoardPose]()
    if first.wish.of > 1:
        tell(f"{first.wish.count} poses are chosen of {first.wish.of * first.wish.count}, which are looked for now")
    if fit := first.wish.fit:
        _lengths(first.target)  # a mesh is refused at once
    shares = PLENOPTIC_SHARES if first.camera.microlenses else SHARES
    for share in shares if fit else shares[-1:]:
        poses.clear()
        try:
            target = _scaled(first.target, first.scale_to_fill(share)) if fit else first.target
            fields = [dataclasses.replace(field, target=target) for field in fields]
            for pose in poses_that_fill(fields, margins=(True,) if fit else (True, False)):
                poses.append(pose)
                if first.wish.of == 1:
                    tell(f"pose {len(poses)} of {first.wish.count}: {_comment(pose)}")
            break
        except (UsageError, TargetError) as error:
            if share == shares[-1]:
                if fit and isinstance(error, TargetError):
                    raise UsageError(
                        error.message, hint="leave out --fit: it scales patterns, and shapes stay"
                    ) from error
                raise
            tell(f"{error.message}: a smaller one is tried")
    return fields, poses


def _read(out: Path, plan: _DatasetText) -> Dataset:
    """The records of a stage that is not written yet, as if it lay at its destination; its target is far away."""
    away = np.eye(4)
    away[2, 3] = -_FAR_MM
    path = out.with_name(f".{os.getpid()}.usda")
    try:
        with chosen_place("write", out):
            path.write_text(plan.text([(away, "")]), encoding="utf-8")
        loaded = load(path)
    finally:
        path.unlink(missing_ok=True)
    if loaded.dataset is None:
        raise StageError(unwritten(loaded.problems, path, out))
    return loaded.dataset


def _documentation(lines: list[str], fields: Sequence[CameraField]) -> str:
    """Text of the stage about its poses."""
    blur = " and ".join(dict.fromkeys(f"{field.blur_px:g} px" for field in fields))
    views = [view_of(field.camera) is not field.camera for field in fields if field.camera.microlenses]
    where = "" if not views else " in views of one pixel" if all(views) else " behind microlenses"
    filled = f"Poses all over the image and the depth of field; points blur to {blur} at most{where}."
    seed = f"Written by pipeline new dataset with seed {fields[0].wish.seed}; edit it as you like."
    return "\n".join([filled, "", *lines, "", seed])


def _lengths(target: Any) -> dict[str, str]:
    """Names of the lengths of a pattern, and their attributes."""
    if not isinstance(target, Target):
        raise UsageError("a mesh has no lengths to scale", hint="leave out --fit")
    return {name: attribute for name, attribute in attributes_of(type(target.pattern)).items() if name.endswith("_mm")}


def _scaled(target: Any, scale: float) -> Any:
    """The target with scaled lengths of its pattern, as a stage states them; its surface is unchanged."""
    lengths = {name: float(f"{scale * getattr(target.pattern, name):.6g}") for name in _lengths(target)}
    return dataclasses.replace(target, pattern=dataclasses.replace(target.pattern, **lengths))


def _comment(pose: BoardPose) -> str:
    """Position, depth, tilt and visible points of a pose in words."""
    middle = np.nanmean(pose.seen_px[0], axis=0)
    where = f"around ({middle[0]:.0f}, {middle[1]:.0f}) px, {pose.away_mm:.1f} mm away"
    return f"{where}, tilted by {pose.tilt_deg:.0f} degrees; {pose.fewest_visible} of {pose.seen_px.shape[1]} points"


def _summary(names: list[str], fields: Sequence[CameraField], poses: list[BoardPose]) -> list[str]:
    """Lines about the coverage of the poses, and, by a plug-in, the uncertainty of a calibration by them."""
    depths = [pose.away_mm for pose in poses]
    tilts = [pose.tilt_deg for pose in poses]
    lines = [
        f"middles of the target {min(depths):.1f} to {max(depths):.1f} mm before the stop,"
        f" tilts {min(tilts):.0f} to {max(tilts):.0f} degrees"
    ]
    seen_px = np.stack([pose.seen_px for pose in poses], axis=1)
    predict = plugged_in("pose", "prediction") if "prediction" in offered("pose") else lambda *_: [[]] * len(fields)
    for name, field, points_px, predicted in zip(names, fields, seen_px, predict(fields, poses), strict=True):
        points_px = points_px[np.isfinite(points_px[:, :, 0])]
        cells = np.floor((points_px + 0.5) / (2 * field.middle_px + 1) * _CELLS).astype(int)
        filled = len(np.unique(np.clip(cells, 0, np.array(_CELLS) - 1), axis=0))
        counts = f"{len(points_px)} points seen in {filled} of {_CELLS[0] * _CELLS[1]} cells of the image"
        lines.append(f"{name}: {counts}" if len(names) > 1 else f"{len(poses)} poses, {counts}")
        lines += predicted
    return lines


def _limit(fields: Sequence[CameraField]) -> list[str]:
    """A line on what limits a calibration by such poses, the field of view or the depth of field, and its remedy."""
    field = min(fields, key=lambda field: field.steepest_deg)
    if field.steepest_deg >= field.wish.most_tilt_deg:
        limit = "the field of view limits that: more poses help by the root of their number"
        return [] if field.camera.microlenses else [limit]
    near, far = field.depth_mm
    blur_px = 2 * field.blur_px
    wider = dataclasses.replace(field, wish=dataclasses.replace(field.wish, blur_px=blur_px))
    if wider.steepest_deg <= field.steepest_deg:  # no target stands farther than some times the nearest
        return [f"poses from {near:.1f} to {far:.1f} mm limit tilts to {field.steepest_deg:.0f} degrees"]
    remedy = f"--blur {blur_px:g}" if field.camera.microlenses else f"a stop half as wide, or --blur {blur_px:g},"
    limit = f"the depth of field, {near:.1f} to {far:.1f} mm, limits tilts to {field.steepest_deg:.0f} degrees"
    return [f"{limit}: {remedy} allows {min(wider.steepest_deg, field.wish.most_tilt_deg):.0f}"]


def _samples(poses: Sequence[_Pose], format_pose: Callable[[np.ndarray], str], *, with_comments: bool = False) -> str:
    """Lines of a `timeSamples` block; a pose that is held has several samples, of which the first has the comment."""
    lines = []
    for code, held, world_from_target, comment in poses:
        remark = f"  # {comment}" if with_comments and comment else ""
        for time in sorted({code, *(round(code + away, 4) for away in held)}):
            lines.append(f"            {time:.10g}: {format_pose(world_from_target)},{remark}\n")
            remark = ""
    return "".join(lines)


def _translation(pose: np.ndarray) -> str:
    return f"({', '.join(f'{x:.6f}'.rstrip('0').rstrip('.') for x in pose[:3, 3] + 0.0)})"


def _quaternion(pose: np.ndarray) -> str:
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True) + 0.0
    return f"({', '.join(f'{part:.15g}' for part in (w, x, y, z))})"
