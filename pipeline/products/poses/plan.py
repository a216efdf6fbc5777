"""Plan of frames/FRAME/CAMERA/poses.json, and of baselines.csv."""

import numpy as np

from pipeline.products.draft import Draft
from pipeline.products.poses.params import BASELINES, Baselines, FramePoses, PosedFrame, RigFrame, poses_file
from pipeline.products.things import matrix, poses_at_lines, target_poses
from pipeline.scene.dataset import CameraEntry, Frame


def plan_poses(draft: Draft) -> None:
    """Add the poses of all cameras, and the baselines between them if a frame has several."""
    dataset = draft.dataset
    for entry in dataset.cameras:
        frames = dataset.frames_of(entry)
        params = FramePoses(camera=entry.name, frames=tuple(_posed(draft, entry, frame) for frame in frames))
        task = draft.add(f"frame_poses/{entry.name}", params, {"pinhole": f"pinhole/{entry.name}"})
        for frame in frames:
            draft.files[f"frames/{frame.number:04d}/{entry.name}/poses.json"] = (task, poses_file(frame.number))
    if any(len(frame.camera_from_world) > 1 for frame in dataset.frames):
        names = tuple(camera.name for camera in dataset.cameras)
        baselines = Baselines(cameras=names, frames=tuple(_rig(names, frame) for frame in dataset.frames))
        reads = {f"pinhole{i}": f"pinhole/{name}" for i, name in enumerate(names)}
        draft.files["baselines.csv"] = (draft.add("baselines", baselines, reads), BASELINES)


def _posed(draft: Draft, entry: CameraEntry, frame: Frame) -> PosedFrame:
    return PosedFrame(
        number=frame.number,
        camera_from_world=matrix(np.array(frame.camera_from_world[entry.name])),
        targets={name: matrix(pose) for name, pose in target_poses(draft.dataset, frame, entry.name).items()},
        at_lines=poses_at_lines(draft.dataset, frame, entry),
    )


def _rig(names: tuple[str, ...], frame: Frame) -> RigFrame:
    poses = [frame.camera_from_world.get(name) for name in names]
    plain = tuple(None if pose is None else matrix(np.array(pose)) for pose in poses)
    return RigFrame(number=frame.number, camera_from_world=plain)
