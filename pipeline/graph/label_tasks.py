"""The tasks that label the pixels of a camera, a camera in its own light whatever its channels."""

from dataclasses import replace

import numpy as np

from pipeline.engine.output.deliver import Source
from pipeline.engine.planning.graph import TaskGraph
from pipeline.frames import inverse
from pipeline.graph.adding import add, add_tiles
from pipeline.graph.frame_tasks import exposure_of
from pipeline.graph.poses import Things, matrix, target_poses
from pipeline.graph.tiles import image_bands
from pipeline.scene.dataset import CameraEntry, Dataset, Frame
from pipeline.tasks.params import frames
from pipeline.tasks.params.labels import BOXES, LABELS, PREVIEW, Labels, Named, NextFrame

_IN_WORLD = {"position", "normal"}
"""Labels in the frame of the world."""


def add_labels(graph: TaskGraph, files: dict[str, Source], dataset: Dataset, entry: CameraEntry, bare: Things) -> None:
    """Add the labels of a camera in all frames, if any are asked for; `bare` are things without colours."""
    ordered = sorted(dataset.frames, key=lambda frame: frame.number)
    followers = dict(zip([frame.number for frame in ordered], ordered[1:], strict=False))
    for frame in dataset.frames if entry.labels else ():
        whole = _labels_of(dataset, entry, frame, followers.get(frame.number), bare)
        name, together = f"{entry.name}/{frame.number:04d}", f"labels/{entry.name}"
        reads = {"camera": f"focus/{entry.name}"}
        parts = [replace(whole, rows=rows) for rows in image_bands(entry.asked.sensor, entry.image_samples)]
        tiles = add_tiles(graph, f"labels_tile/{name}", parts, reads, together)
        if tiles:
            whole = replace(whole, view=None, world_from_vision=None, later=None, tiles=len(tiles))
        task = add(graph, f"labels/{name}", whole, tiles or reads, None if tiles else together)
        outputs = (LABELS, PREVIEW, *([BOXES] if "targets" in entry.labels else []))
        files |= {f"frames/{frame.number:04d}/{entry.name}/{file}": (task, file) for file in outputs}


def _labels_of(dataset: Dataset, entry: CameraEntry, frame: Frame, later: Frame | None, bare: Things) -> Labels:
    occluders = [each for each in dataset.occluders if each.prim_path in frame.world_from_occluder]
    paths = [each.prim_path for each in dataset.targets] + [each.prim_path for each in occluders]
    instances = [each.prim_path for each in dataset.targets] + [each.instance or each.prim_path for each in occluders]
    mattes = {"prim": ("CryptoObject", paths), "instance": ("CryptoAsset", instances)}
    view = frames.PlacedView(
        targets=bare.targets(target_poses(dataset, frame, entry.name), named=False),
        occluders=bare.occluders(frame, entry.name),
    )
    shares = tuple(target.name for target in dataset.targets) if "targets" in entry.labels else ()
    wants_flow = later is not None and "flow" in entry.labels
    in_world = bool(_IN_WORLD & set(entry.labels))
    vision_from_world = np.array(frame.camera_from_world[entry.name])
    return Labels(
        exposure=replace(exposure_of(entry), channel=None),
        tokens=entry.labels,
        names=Named(
            targets=shares,
            mattes={matte: tuple(names) for token, (matte, names) in mattes.items() if token in entry.labels},
        ),
        view=view,
        world_from_vision=matrix(inverse(vision_from_world)) if in_world else None,
        later=_next(dataset, entry, frame, later, bare) if wants_flow and later else None,
    )


def _next(dataset: Dataset, entry: CameraEntry, frame: Frame, later: Frame, bare: Things) -> NextFrame:
    poses = target_poses(dataset, later, entry.name)
    there = [each.prim_path for each in dataset.occluders if each.prim_path in later.world_from_occluder]
    moved = dict(zip(there, bare.occluders(later, entry.name), strict=True))
    now = [each.prim_path for each in dataset.occluders if each.prim_path in frame.world_from_occluder]
    return NextFrame(
        targets=tuple(matrix(poses[target.name]) for target in dataset.targets),
        occluders=tuple(moved.get(path) for path in now),
    )
