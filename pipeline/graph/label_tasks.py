"""The tasks that label the pixels of a camera, in its own light whatever its channels."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from pipeline.camera.parts.spectrum import alone
from pipeline.engine.output.deliver import Source
from pipeline.engine.planning.graph import TaskGraph
from pipeline.frames import inverse
from pipeline.graph.adding import add
from pipeline.graph.frame_tasks import exposure_of
from pipeline.graph.poses import Things, matrix, target_poses
from pipeline.graph.tiles import image_bands
from pipeline.render.lighting.records import Material
from pipeline.scene.dataset import CameraEntry, Dataset, Frame
from pipeline.tasks.params.frames import PaintedView
from pipeline.tasks.params.labels import BOXES, LABELS, PREVIEW, Channels, Labels, LabelsTile


def add_labels(graph: TaskGraph, files: dict[str, Source], dataset: Dataset, entry: CameraEntry, bare: Things) -> None:
    """Add the labels of a camera in all frames, if any are asked for; `bare` are things without colours."""
    exposure, asked = replace(exposure_of(entry), channel=None), set(entry.labels)
    ordered = sorted(dataset.frames, key=lambda frame: frame.number)
    for frame, later in pairwise([*ordered, None]) if asked else ():
        assert frame is not None  # only what follows the last one is
        world_from_vision = inverse(np.array(frame.camera_from_world[entry.name]))
        materials = bare.lighting(frame, entry.name, 0)
        whole = LabelsTile(
            exposure=exposure,
            channels=_channels(dataset, entry, frame),
            view=PaintedView(
                targets=bare.targets(target_poses(dataset, frame, entry.name), named=False),
                occluders=bare.occluders(frame, entry.name),
                background=0.0,
                lighting=replace(materials, lamps=()) if materials and _lets_pass(dataset) else None,
                lights=(alone(entry.wavelength_nm),),
            ),
            world_from_vision=matrix(world_from_vision) if {"position", "normal"} & asked else None,
        )
        if later and "flow" in asked:
            poses, moved = target_poses(dataset, later, entry.name), bare.occluders(later, entry.name)
            there = dict(zip(_paths(dataset, later), moved, strict=True))
            targets = tuple(matrix(poses[target.name]) for target in dataset.targets)
            whole = replace(whole, next_targets=targets, next_occluders=tuple(map(there.get, _paths(dataset, frame))))
        name, tiles = f"{entry.name}/{frame.number:04d}", {}
        for number, rows in enumerate(image_bands(entry.asked.sensor, entry.image_samples)):
            params, reads = replace(whole, rows=rows), {"camera": f"focus/{entry.name}"}
            if whole.view.lighting:
                reads |= {picture.name: f"picture/{picture.name}" for picture in dataset.pictures}
            tile = add(graph, f"labels_tile/{name}/{number:04d}", params, reads, f"labels/{entry.name}/{number}")
            tiles[f"tile{number}"] = tile
        joined = Labels(exposure=exposure, channels=whole.channels, tiles=len(tiles))
        task, outputs = add(graph, f"labels/{name}", joined, tiles), (LABELS, PREVIEW, BOXES)
        delivered = outputs if "targets" in asked else outputs[:2]
        files |= {f"frames/{frame.number:04d}/{entry.name}/{file}": (task, file) for file in delivered}


def _lets_pass(dataset: Dataset) -> bool:
    """Whether something may not be opaque."""
    finishes, solid = [each.finish for each in dataset.occluders if each.finish], Material().opacity
    return any(material.opacity != solid for finish in finishes for material in finish.materials)


def _paths(dataset: Dataset, frame: Frame) -> list[str]:
    """Prims of the occluders that are visible in a frame."""
    return [each.prim_path for each in dataset.occluders_in(frame)]


def _channels(dataset: Dataset, entry: CameraEntry, frame: Frame) -> Channels:
    prims = (*(each.prim_path for each in dataset.targets), *_paths(dataset, frame))
    instances = {each.prim_path: each.instance for each in dataset.occluders if each.instance}
    mattes = {"prim": ("CryptoObject", prims), "instance": ("CryptoAsset", tuple(instances.get(p, p) for p in prims))}
    return Channels(
        tokens=entry.labels,
        targets=tuple(target.name for target in dataset.targets) if "targets" in entry.labels else (),
        mattes=dict(matte for token, matte in mattes.items() if token in entry.labels),
    )
