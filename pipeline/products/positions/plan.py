"""Plan of frames/FRAME/CAMERA/positions.exr: J on the tangent planes of all targets."""

import numpy as np

from pipeline.frames import apply
from pipeline.products.draft import Draft, light_of
from pipeline.products.positions.params import PlaneAsked, Positions
from pipeline.products.things import matrix, target_poses
from pipeline.scene.dataset import TargetEntry
from pipeline.truth.planes import plane_name


def plan_positions(draft: Draft) -> None:
    """Add the position images of the cameras whose method reads them."""
    for entry, frame in draft.frames:
        if entry.truth.method != "image":
            continue
        poses = target_poses(draft.dataset, frame, entry.name)
        planes = [plane for target in draft.dataset.targets for plane in _tangent_planes(target, poses[target.name])]
        params = Positions(
            planes=tuple(planes),
            extent=entry.extent,
            sampling=entry.sampling,
            light=light_of(entry),
            square_px=entry.square_px,
        )
        reads = {"camera": draft.camera(entry)}
        task = draft.add(f"positions/{entry.full_name}/{frame.number:04d}", params, reads)
        draft.files[f"frames/{frame.number:04d}/{entry.folder}/positions.exr"] = (task, "positions.exr")


def _tangent_planes(entry: TargetEntry, vision_from_target: np.ndarray) -> list[PlaneAsked]:
    """Every tangent plane of a target, including those that face away."""
    points = entry.target.points()
    return [
        PlaneAsked(
            name=plane_name(entry.name, number, len(points.frames)),
            vision_from_target=matrix(vision_from_target @ plane.target_from_plane),
            points_mm=apply(vision_from_target, points.position_mm[plane.members]).tolist(),
        )
        for number, plane in enumerate(points.planes())
    ]
