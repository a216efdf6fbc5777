"""COCO: points of targets as keypoints with boxes, for learned detectors."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.exports.material import ExportCamera, ExportView, Material
from pipeline.files.jsonfile import Json, write_json
from pipeline.formats import Cameras, Format, Origin, Reads
from pipeline.plugins.formats.maps.traced import distances_mm, traced

FORMAT = Format(
    consumer="pycocotools, detectors that learn keypoints",
    note="flag 2: at least half of a point's light arrives, 1: less, 0: there is no row",
    source="run: pycocotools 2.0.11",
    cameras=Cameras.CONVENTIONAL,
    reads=frozenset({Reads.CORNERS, Reads.RAYS, Reads.SCENE}),
    files=("coco.json",),
    origin=Origin.HALF,
)
_VISIBLE = 0.5
"""Least share of the light of a point that counts as visible [1]."""


def write(material: Material, folder: Path) -> None:
    """Write one file: an image per camera and frame, a category per target."""
    sizes = {camera.name: camera.size_px for camera in material.cameras}
    images = {view.image: view.camera for view in material.views}
    names = [target.name for target in material.targets]
    paths = list(images)
    content: Json = {"info": {"description": "\n".join(material.remarks)}, "licenses": []}
    content["images"] = [
        {"id": number, "file_name": image, "width": sizes[camera][0], "height": sizes[camera][1]}
        for number, (image, camera) in enumerate(images.items(), 1)
    ]
    content["categories"] = [
        {"id": number, "name": target.name, "supercategory": target.kind, "skeleton": []}
        | {"keypoints": [str(point) for point in range(len(target.points))]}
        for number, target in enumerate(material.targets, 1)
    ]
    views = [view for view in material.views if len(view.observations.ids)]
    boxes = [box for camera in material.cameras for box in _boxes(material, camera, folder)]
    content["annotations"] = [
        {"id": number, "image_id": paths.index(view.image) + 1, "category_id": names.index(view.target) + 1}
        | _annotation(view, len(material.target(view.target).points))
        | box
        for number, (view, box) in enumerate(zip(views, boxes, strict=True), 1)
    ]
    write_json(folder / "coco.json", content)


def _boxes(material: Material, camera: ExportCamera, folder: Path) -> Iterator[Json]:
    """Box around the pixels whose rays meet a target first, and their number, of each view that shows points."""
    scene = material.scene()
    with traced(camera, folder) as pixels:
        for view in material.of(camera):
            if not len(view.observations.ids):
                continue
            alone_mm = distances_mm(camera, scene, view.frame, pixels.rays, view.target)
            rows, columns = np.nonzero(alone_mm <= distances_mm(camera, scene, view.frame, pixels.rays))
            if not len(rows):  # its light goes around what stands before it
                rows, columns = np.rint(view.built.correspondences[view.observations.rows][["y_px", "x_px"]].tolist()).T
            low, high = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()])
            yield {"bbox": [*low.tolist(), *(high - low + 1).tolist()], "area": len(rows)}


def _annotation(view: ExportView, points: int) -> Json:
    """Keypoints of a target, three numbers each."""
    rows = view.observations
    positions = rows.positions
    visibility = view.built.correspondences.visibility[rows.rows]
    keypoints = np.zeros((points, 3))
    keypoints[rows.ids] = np.column_stack([positions, np.where(visibility >= _VISIBLE, 2, 1)])
    flat = [number for x, y, flag in keypoints.tolist() for number in (x, y, int(flag))]
    return {"keypoints": flat, "num_keypoints": len(rows.ids), "iscrowd": 0}
