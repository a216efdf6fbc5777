"""vision-calibration (calibration-rs): a planar dataset per camera as JSON, as `PlanarDataset.to_payload` writes it."""

from pathlib import Path

from pipeline.exports.material import Material
from pipeline.files.jsonfile import write_json
from pipeline.formats import Board, Cameras, ExportError, Format, Origin, Unit

FORMAT = Format(
    consumer="vision-calibration (calibration-rs): run_planar_intrinsics, run_scheimpflug_intrinsics",
    note="Observation.from_payload takes each entry obs of views",
    source="run: vision-calibration 0.9.0",
    cameras=Cameras.CONVENTIONAL,
    files=("<camera>.json",),
    origin=Origin.ZERO,
    board=Board.RIGHT_DOWN,
    unit=Unit.M,
)

_LEAST = 4
"""Fewest points of a view: a homography needs four."""


def write(material: Material, folder: Path) -> None:
    """Write a file per camera."""
    for target in material.targets:
        if not target.is_flat:
            raise ExportError(f"vision-calibration supports only flat targets, and {target.name} is bent")
    for camera in material.cameras:
        views = []
        for view in material.of(camera):
            points = material.target(view.target).points[view.observations.ids]
            observed = view.observations.positions
            if len(points) >= _LEAST:
                views.append({"obs": {"points_3d": points.tolist(), "points_2d": observed.tolist()}, "meta": None})
        write_json(folder / f"{camera.name}.json", {"about": list(material.remarks), "views": views})
