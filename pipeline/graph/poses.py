"""Poses of everything in the frame of a camera, and the JSON file of each target."""

import math

import numpy as np

from pipeline.files.jsonfile import Json, json_bytes
from pipeline.records.plain import to_plain
from pipeline.scene.dataset import Dataset, Frame, TargetEntry
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.points import TargetPoints
from pipeline.targets.target import Target, plain_from_target


def vision_from_target(frame: Frame, camera: str, target: str) -> np.ndarray:
    """Pose of a target in a camera's vision frame, (4, 4) [mm]."""
    return np.array(frame.camera_from_world[camera]) @ np.array(frame.world_from_target[target])


def vision_from_occluder(frame: Frame, camera: str, prim_path: str) -> np.ndarray:
    """Transform of an occluder's mesh to a camera's vision frame, (4, 4) [mm]."""
    return np.array(frame.camera_from_world[camera]) @ np.array(frame.world_from_occluder[prim_path])


def vision_from_lamp(frame: Frame, camera: str, prim_path: str) -> np.ndarray:
    """Pose of a lamp in a camera's vision frame, (4, 4) [mm]."""
    return np.array(frame.camera_from_world[camera]) @ np.array(frame.world_from_lamp[prim_path])


def target_poses(dataset: Dataset, frame: Frame, camera: str) -> dict[str, np.ndarray]:
    """vision_from_target of all targets of a dataset, by name."""
    return {target.name: vision_from_target(frame, camera, target.name) for target in dataset.targets}


def targets_json(entry: TargetEntry) -> bytes:
    """The content of targets/<target>.json; only warped boards have points away from their nominal coordinates."""
    target = entry.target
    plain = plain_from_target(target)
    facts = {"order": MeshTarget.ORDER, "parameters": {}, "surface": {"kind": "mesh"}}
    if isinstance(target, Target):
        facts = {"order": target.pattern.ORDER, "parameters": plain["pattern"], "surface": plain["surface"]}
    return json_bytes(
        {
            "kind": target.kind,
            "frame": "target frame: origin at the pattern centre, x right, y up, z towards the viewer, mm",
            **facts,
            "mesh_sag_mm": max(patch.mesh_sag_mm() for patch in target.patches()),
            "points": _points(target.points()),
        }
    )


def _points(points: TargetPoints) -> list[Json]:
    """Id, kind, nominal and actual place and normal of every point, and the radius of its disc if it has one."""
    rows = []
    for index, kind in enumerate(points.kinds):
        places = {"nominal_mm": points.nominal_mm, "actual_mm": points.position_mm, "normal": points.axes[:, :, 2]}
        row = {"id": index, "kind": kind, **{name: to_plain(values[index].tolist()) for name, values in places.items()}}
        radius = float(points.radius_mm[index])
        rows.append(row if math.isnan(radius) else {**row, "radius_mm": radius})
    return rows
