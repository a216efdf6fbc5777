"""The content of a build, gathered from its records into what writers take, in our conventions."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from pipeline.camera.figures.equivalent_pinhole import Sightings
from pipeline.channel_names import folder_of
from pipeline.exports.material import (
    CameraRays,
    ExportCamera,
    ExportTarget,
    ExportView,
    Grid,
    Material,
    Observations,
)
from pipeline.exports.micro_images import MicroImages
from pipeline.exports.row_pinhole import row_pinhole
from pipeline.formats import EXACT, OURS, ExportError
from pipeline.frames import apply
from pipeline.results.answers import SeenScene
from pipeline.results.output import Output
from pipeline.results.records import BuiltCamera, BuiltPinhole, BuiltTarget, BuiltView
from pipeline.spelling import did_you_mean

if TYPE_CHECKING:
    from pipeline.results.ready_camera import ReadyCamera  # loads the tracer, which few formats need

_REGULAR_MM = 1e-9
"""Deviation of nominal points from a grid [mm]: rounding of sums, nothing else."""
POSITIONS = {EXACT: "x_px", "chief": "chief_x_px", "saddle": "saddle_x_px", "centroid": "centroid_x_px"}
"""Which position of a point is exported -> its column; CONVENTIONS.md, Other positions of the same point."""


def gather(
    output: Output, sight: Callable[[str], "ReadyCamera"], scene: Callable[[], SeenScene], position: str = EXACT
) -> Material:
    """The content of a build in our conventions, unit mm.

    `sight`: makes the camera of a name ready, when its rays are asked for.
    Raises ExportError: the stage did not ask for that position.
    """
    views = [
        _view(view, target, position)
        for camera in output.cameras.values()
        for view in camera.views
        for target in output.targets.values()
    ]
    remarks: tuple[str, ...] = (f"exported from a build of {output.stage} by plenoptic-pipeline",)
    if position != EXACT:
        remarks = (*remarks, f"positions: {position}, not those of J")
    if any(camera.shutter for camera in output.cameras.values()):
        remarks = (
            *remarks,
            "before a shutter positions are those at the times of their lines, poses and cameras of the time code",
        )
    material = Material(
        stage=output.stage,
        remarks=remarks,
        cameras=tuple(_camera(camera, sight) for camera in output.cameras.values()),
        targets=tuple(map(_target, output.targets.values())),
        views=tuple(views),
        frames={camera.name: tuple(view.frame for view in camera.views) for camera in output.cameras.values()},
        scene=scene,
    )
    # Fitted at most once, and only for formats that ask for it
    fits = {camera.name: cache(partial(_row_pinhole, camera, material)) for camera in material.cameras}
    cameras = tuple(replace(camera, row_pinhole=fits[camera.name]) for camera in material.cameras)
    return replace(material, cameras=cameras)


def _row_pinhole(camera: ExportCamera, material: Material) -> BuiltPinhole | str:
    """The pinhole of the rows of a camera, or the reason why there is none."""
    if camera.built.is_plenoptic or camera.pinhole is None:
        return "no pinhole stands for this camera"
    targets = []
    for view in material.of(camera):
        if len(view.observations.ids):
            targets.append(Sightings(view.observations.positions, _points_mm(camera, view, material)))
    return row_pinhole(camera.pinhole, targets)


def _points_mm(camera: ExportCamera, view: ExportView, material: Material) -> np.ndarray:
    """Points of observations in the vision frame, (n, 3); before a shutter those at their own times."""
    if camera.built.shutter:
        rows = view.built.correspondences[view.observations.rows]
        return np.stack([rows.camera_x_mm, rows.camera_y_mm, rows.camera_z_mm], axis=1)
    points_mm = material.target(view.target).points[view.observations.ids]
    return apply(view.built.poses.camera_from_target[view.target], points_mm)


def chosen(material: Material, names: tuple[str, ...]) -> Material:
    """A material of the cameras and targets of these names; all cameras where none is named, likewise targets.

    Raises ExportError: there is neither of that name.
    """
    names_of_build = [camera.name for camera in material.cameras] + [target.name for target in material.targets]
    for name in names:
        if name not in names_of_build:
            hint = did_you_mean(name, names_of_build) or f"it has {', '.join(names_of_build)}"
            raise ExportError(f"the build has no camera and no target {name!r}", hint=hint)
    cameras = tuple(camera for camera in material.cameras if camera.name in names) or material.cameras
    targets = tuple(target for target in material.targets if target.name in names) or material.targets
    chosen_names = {camera.name for camera in cameras} | {target.name for target in targets}
    views = tuple(view for view in material.views if {view.camera, view.target} <= chosen_names)
    frames = {camera.name: material.frames[camera.name] for camera in cameras}
    return replace(material, cameras=cameras, targets=targets, views=views, frames=frames)


def grid_of(nominal: np.ndarray) -> Grid | None:
    """The regular grid that points form, in our target frame and counted from its top left, or None."""
    x = np.unique(np.round(nominal[:, 0], 9))
    y = np.unique(np.round(nominal[:, 1], 9))
    columns, rows = len(x), len(y)
    if columns * rows != len(nominal) or min(columns, rows) < 2:
        return None
    steps = (x[-1] - x[0]) / (columns - 1), (y[-1] - y[0]) / (rows - 1)
    row, column = np.divmod(np.arange(len(nominal)), columns)
    regular = np.stack([x[0] + column * steps[0], y[-1] - row * steps[1]], axis=1)
    if not np.allclose(nominal[:, :2], regular, rtol=0, atol=_REGULAR_MM) or np.ptp(nominal[:, 2]) > _REGULAR_MM:
        return None
    across, down = map(float, steps)
    step_mm = across if abs(across - down) < _REGULAR_MM else None
    return Grid(columns=columns, rows=rows, column_step=across, row_step=down, step_mm=step_mm)


def _camera(camera: BuiltCamera, sight: Callable[[str], "ReadyCamera"]) -> ExportCamera:
    return ExportCamera(
        name=camera.name,
        size_px=camera.size_px,
        pitch_mm=camera.pitch_mm,
        pinhole=camera.pinhole_with_distortion,
        plain_pinhole=camera.pinhole,
        axis=np.array(camera.record["optical_axis_px"]),
        rays=CameraRays(built=camera, ready=partial(sight, camera.name), convention=OURS),
        micro_images=_micro_images(camera),
        built=camera,
    )


def _micro_images(camera: BuiltCamera) -> MicroImages | None:
    rows = camera.micro_images
    if rows is None:
        return None
    focal_mm = np.array([kind["focal_length_mm"] for kind in camera.record["mla"]["types"]])
    return MicroImages(
        layout=camera.record["mla"]["layout"],
        microlenses=np.stack([rows.microlens_k, rows.microlens_l], axis=1),
        types=rows.microlens_type,
        centres=np.stack([rows.centre_x_px, rows.centre_y_px], axis=1),
        focal_lengths_mm=focal_mm,
        own_types=np.arange(len(focal_mm)),
    )


def _target(target: BuiltTarget) -> ExportTarget:
    return ExportTarget(
        name=target.name,
        kind=target.kind,
        parameters=target.parameters,
        points=target.points_mm,
        nominal=target.nominal_mm,
        grid=grid_of(target.nominal_mm),
        is_flat=target.is_flat,
    )


def _view(view: BuiltView, target: BuiltTarget, position: str) -> ExportView:
    """A view with the rows of a target that have a position of this kind; ExportError if the build has none."""
    table = view.correspondences
    numbers = np.flatnonzero(table.target == target.name)
    rows = table[numbers]
    column = POSITIONS[position]
    if column not in (rows.dtype.names or ()):
        raise ExportError(
            f"the build has no positions {position!r}", hint=f'build it with plen:truth:columns = ["{position}"]'
        )
    positions = np.stack([rows[column], rows[column.replace("x_px", "y_px")]], axis=1)
    has_position = np.isfinite(positions).all(axis=1)
    rows, positions = rows[has_position], positions[has_position]
    return ExportView(
        camera=view.camera,
        target=target.name,
        frame=view.frame,
        image=f"frames/{view.frame:04d}/{folder_of(view.camera)}/image.png",
        built=view,
        camera_from_target=view.poses.pinhole_from_target.get(target.name),
        camera_from_world=view.poses.pinhole_from_world,
        observations=Observations(
            rows=numbers[has_position],
            ids=rows.point_id,
            positions=positions,
            microlenses=np.stack([rows.microlens_k, rows.microlens_l], axis=1) if view.is_plenoptic else None,
            rho_px=rows.rho_px,
        ),
    )
