"""A new dataset: a rig, a target, and poses that fill what the camera sees."""

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.app.authoring.assets import asset, found
from pipeline.app.authoring.poses import Field, Pose, Wish, poses_that_fill
from pipeline.app.authoring.stage_text import DatasetText, Placed
from pipeline.app.chosen import chosen
from pipeline.app.importing import require_free, unwritten, write_whole
from pipeline.errors import UsageError
from pipeline.frames import inverse
from pipeline.scene.dataset import Dataset, TargetEntry
from pipeline.scene.load import Loaded, load
from pipeline.scene.read.targets import PATTERNS
from pipeline.scene.usd.problems import StageError
from pipeline.scene.write.text import identifier
from pipeline.targets.target import Target

_FAR_MM = 1e5
"""Distance at which a target waits for its poses [mm]: a hundred metres, behind no lens and inside none."""
_FITTED = 0.5
"""Diagonal of a fitted target over that of the image, at the middle of the depth of field [1]: it may move and tilt."""
_WITH = {"camera": "rigs", "target": "targets"}
"""Kinds of parts of the library that hold one."""
_CELLS = 8, 6
"""Cells of the image in which the points of all frames are counted, along x and y."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NewDataset:
    """A dataset that was written, as it was read again; sentences tell a person what its poses fill."""

    lines: list[str]
    loaded: Loaded


def new_dataset(
    out: Path, rig: Path, target: Path, wish: Wish, camera: str | None = None, *, fit: bool = False
) -> NewDataset:
    """Write a dataset whose poses fill the field of view and the depth of field of a camera.

    Parameters
    ----------
    out : Path
        New .usda file.
    rig, target : Path
        Stages: files, or names of the library such as `rigs/conventional_100mm.usda`.
    camera : str, optional
        Name of the camera of the rig; needed where it has several.
    fit : bool
        Whether the lengths of the target are scaled so that it fills half of the image.

    Raises
    ------
    StageError
        The rig or the target does not pass `check`.
    UsageError
        A part is missing, the file cannot be written, or the target is too large for the camera.
    """
    require_free(out)
    parts = load(found(rig)), load(found(target))
    for part in parts:
        if part.errors:
            raise StageError(part.problems)
    names = [entry.name for entry in parts[0].cameras]
    if not names or not parts[1].targets:
        kind, path = ("camera", rig) if not names else ("target", target)
        raise UsageError(f"{path} holds no {kind}", hint=f"`pipeline library {_WITH[kind]}` lists some that do")
    seen_by = parts[0].cameras[chosen(rig, "camera", names, camera)]
    plan = DatasetText(
        name=identifier(out.stem if out.stem != "dataset" else out.resolve().parent.name),
        doc=_documentation(wish),
        rig=asset(rig, out),
        target=asset(target, out),
        camera="/" + seen_by.prim_path.strip("/").partition("/")[2],
        values={},
    )
    if fit:
        entry = parts[1].targets[0]
        plan = plan.with_values(_fitted(Field(seen_by.camera, entry.target), entry, wish.blur_px))
    return _written(out, plan, wish)


def _written(out: Path, plan: DatasetText, wish: Wish) -> NewDataset:
    away = np.eye(4)
    away[2, 3] = -_FAR_MM
    dataset = _read(out, plan.text([Placed(world_from_target=away, comment="")]))
    entry, target, frame = dataset.cameras[0], dataset.targets[0], dataset.frames[0]
    poses = poses_that_fill(entry.camera, target.target, wish)
    world_from_camera = inverse(np.array(frame.camera_from_world[entry.name]))
    placed = [
        Placed(world_from_target=world_from_camera @ pose.vision_from_target, comment=_comment(pose)) for pose in poses
    ]
    loaded = write_whole(plan.text(placed), out)
    sensor = entry.camera.sensor
    return NewDataset(lines=_summary(sensor.width_px, sensor.height_px, poses), loaded=loaded)


def _read(out: Path, text: str) -> Dataset:
    """The records of a stage that is not written yet, as if it lay where it will."""
    handle, name = tempfile.mkstemp(prefix=".", suffix=".usda", dir=out.resolve().parent)
    path = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        loaded = load(path)
    finally:
        path.unlink()
    if loaded.dataset is None:
        raise StageError(unwritten(loaded.problems, path, out))
    return loaded.dataset


def _documentation(wish: Wish) -> str:
    return (
        f"{wish.count} poses all over the image and the depth of field of the camera; points blur to"
        f" {wish.blur_px:g} px at most, and tilts are as large as that lets them be.\n\n"
        f"Written by pipeline new dataset with seed {wish.seed}; edit it as you like."
    )


def _fitted(field: Field, entry: TargetEntry, blur_px: float) -> dict[str, float]:
    """Lengths of a target, by attribute, with which it fills half of the image."""
    target = entry.target
    if not isinstance(target, Target):
        raise UsageError(f'"{entry.name}" is a mesh, which has no lengths to scale')
    (near, far), middle = field.depth_mm(blur_px), field.middle_px
    # Half of the way to the corner of the image: light reaches it in any camera, and the field is wide there already.
    half_way, centre = (field.place_mm(x, (near + far) / 2) for x in (middle / 2, middle))
    scale = _FITTED * 2 * float(np.hypot(*(half_way - centre)[:2])) / field.radius_mm
    names = next(names for kind, names in PATTERNS.values() if kind is type(target.pattern))
    lengths = [name for name in names if name.endswith("_mm")]
    return {names[name]: scale * getattr(target.pattern, name) for name in lengths}


def _comment(pose: Pose) -> str:
    middle = np.nanmean(pose.seen_px, axis=0)
    where = f"around ({middle[0]:.0f}, {middle[1]:.0f}) px, {pose.vision_from_target[2, 3]:.1f} mm away"
    return f"{where}, tilted by {pose.tilt_deg:.0f} degrees; {pose.seen} of {len(pose.seen_px)} points"


def _summary(width_px: int, height_px: int, poses: list[Pose]) -> list[str]:
    """Lines that tell how much of the image and of the depths the poses fill."""
    seen = np.concatenate([pose.seen_px[np.isfinite(pose.seen_px[:, 0])] for pose in poses])
    cells = np.floor((seen + 0.5) / np.array([width_px, height_px]) * _CELLS).astype(int)
    filled = len({tuple(cell) for cell in np.clip(cells, 0, np.array(_CELLS) - 1)})
    depths, tilts = [float(pose.vision_from_target[2, 3]) for pose in poses], [pose.tilt_deg for pose in poses]
    return [
        f"{len(poses)} poses, {len(seen)} points seen in {filled} of {_CELLS[0] * _CELLS[1]} cells of the image",
        f"middles of the target {min(depths):.1f} to {max(depths):.1f} mm before the stop,"
        f" tilts {min(tilts):.0f} to {max(tilts):.0f} degrees",
    ]
