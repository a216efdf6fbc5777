"""COCO: points of targets as keypoints with boxes, for detectors that learn."""

from pathlib import Path

import numpy as np

from pipeline.exports.material import ExportView, Material
from pipeline.files.jsonfile import Json, write_json
from pipeline.formats import Cameras, Format, Origin

FORMAT = Format(
    consumer="pycocotools, detectors that learn keypoints",
    note="flag 2: at least half of a point's light arrives, 1: less, 0: there is no row",
    source="run: pycocotools 2.0.11",
    cameras=Cameras.CONVENTIONAL,
    files=("coco.json",),
    origin=Origin.HALF,
)
_VISIBLE = 0.5
"""Least share of the light of a point that counts as visible [1]."""


def write(material: Material, folder: Path) -> None:
    """Write one file: an image per camera and frame, a category per target."""
    sizes = {camera.name: camera.size_px for camera in material.cameras}
    images = {view.image: view.camera for view in material.views}
    names, places = [target.name for target in material.targets], list(images)
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
    content["annotations"] = [
        {"id": number, "image_id": places.index(view.image) + 1, "category_id": names.index(view.target) + 1}
        | _annotation(view, len(material.target(view.target).points))
        for number, view in enumerate((view for view in material.views if len(view.observations.ids)), 1)
    ]
    write_json(folder / "coco.json", content)


def _annotation(view: ExportView, points: int) -> Json:
    """Keypoints of a target, three numbers each, and the box around those that have a row."""
    rows, places = view.observations, view.observations.positions
    visibility = view.built.correspondences.visibility[rows.rows]
    keypoints = np.zeros((points, 3))
    keypoints[rows.ids] = np.column_stack([places, np.where(visibility >= _VISIBLE, 2, 1)])
    size = np.ptp(places, axis=0)
    box = [*places.min(axis=0).tolist(), *size.tolist()]
    flat = [number for x, y, flag in keypoints.tolist() for number in (x, y, int(flag))]
    return {"keypoints": flat, "num_keypoints": len(rows.ids), "bbox": box, "area": float(size.prod()), "iscrowd": 0}
