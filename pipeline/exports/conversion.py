"""A material in the conventions of a format, and in its folder, held to the files that the format states.

Only here offsets, axes, units and numberings are applied.
"""

from collections.abc import Callable
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import formats
from pipeline.exports.material import (
    CentralModel,
    ExportCamera,
    ExportTarget,
    ExportView,
    Material,
    StatedPose,
)
from pipeline.exports.micro_images import MicroImageGrid, micro_image_grid, retyped
from pipeline.exports.noise import Noise
from pipeline.files.jsonfile import write_json
from pipeline.formats import Board, CameraAxes, Centre, Convention, Format, Microlenses, Origin, Pose, Rotation, Unit
from pipeline.frames import apply, inverse, rigid, rotation_vector
from pipeline.results.records import BuiltPinhole

ModelOf = Callable[[ExportCamera, tuple[str, ...]], CentralModel]
"""The central model of a camera, from the names of the models that a format knows."""
_AXES = {
    Board.OURS: np.eye(3),
    Board.NONE: np.eye(3),
    Board.RIGHT_DOWN: np.diag([1.0, -1.0, -1.0]),
    Board.KALIBR: np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}
"""Axes of the target frame of a format, by rows, in our target frame."""
_STATED = (*(field.name for field in fields(Convention)), "consumer", "source", "note")
"""Facts of a format under `conventions` of export.json: what its numbers mean, who reads them, and how we know. Its
other fields only choose what is exported.
"""
_CAMERA_AXES = {CameraAxes.VISION: np.eye(4), CameraAxes.OPENGL: np.diag([1.0, -1.0, -1.0, 1.0])}
"""Axes of the camera of a format, by rows, in the vision frame."""


def write_format(name: str, material: Material, folder: Path, position: str, noise: Noise) -> None:
    """Write the files of a format, and export.json, into an empty folder.

    `position`, `noise`: only noted in export.json; the material holds positions of that kind, with that noise, already.
    Raises ExportError: the format cannot hold this material.
    Raises ValueError: its module wrote other files than the format states.
    """
    module = formats.module_of(name)
    format_: Format = module.FORMAT
    # A format may have a camera model of its own, by a function of this name: see docs/export_format.md.
    own_model: ModelOf | None = getattr(module, "central_model", None)
    material = with_central_models(material, format_, own_model)
    module.write(converted(material, format_), folder)
    files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    side_car: dict[str, Any] = {"stage": material.stage, "format": name, "position": position}
    side_car |= _pinhole_facts(material, format_)
    if central := {camera.name: asdict(camera.central) for camera in material.cameras if camera.central}:
        side_car["central_models"] = central
    side_car["noise"] = None if noise.is_none else asdict(noise)
    side_car["conventions"] = {fact: str(getattr(format_, fact)) for fact in _STATED}
    side_car["files"] = files
    write_json(folder / formats.SIDE_CAR, side_car)
    plenoptic = {camera.name: camera.built.is_plenoptic for camera in material.cameras}
    stated_paths = format_.paths(plenoptic, material.frames, len(material.targets))
    if sorted([*files, formats.SIDE_CAR]) != stated_paths:
        raise ValueError(f"{name} states the files {stated_paths}, and wrote {files}")


def _pinhole_facts(material: Material, format_: Format) -> dict[str, Any]:
    """Facts in export.json about the pinholes to which a format refers; empty if it refers to none."""
    facts: dict[str, Any] = {}
    if format_.centre in (Centre.PINHOLE, Centre.FITTED_TO_ROWS) and format_.pose is not Pose.NONE:
        facts["residuals_of_equivalent_pinholes_px"] = {
            camera.name: {key: model and {"rms": model.rms_px, "max": model.max_px} for key, model in _pinholes(camera)}
            for camera in material.cameras
        }
    if format_.centre is Centre.FITTED_TO_ROWS:
        facts["pinholes_of_rows"] = _row_pinholes(material)
        results = {camera.name: camera.row_pinhole() for camera in material.cameras}
        if reasons := {name: result for name, result in results.items() if isinstance(result, str)}:
            facts["without_pinhole_of_rows"] = reasons
    return facts


def _pinholes(camera: ExportCamera) -> tuple[tuple[str, BuiltPinhole | None], ...]:
    """The equivalent pinholes of a camera, by their keys in export.json."""
    return ("without_distortion", camera.plain_pinhole), ("with_distortion", camera.pinhole)


def _row_pinholes(material: Material) -> dict[str, Any]:
    """The pinholes of the rows in our conventions, by the keys of camera.json; null where rows determine none."""
    pinholes: dict[str, Any] = {}
    for camera in material.cameras:
        result = camera.row_pinhole()
        record = None if isinstance(result, str) else asdict(result)
        if record:
            record["residual_px"] = {"rms": record.pop("rms_px"), "max": record.pop("max_px")}
        pinholes[camera.name] = record
    return pinholes


def with_central_models(material: Material, format_: Format, model_of: ModelOf | None = None) -> Material:
    """A material with the central models of its cameras, and with poses to their centres, if a format states these, or
    knows models for cameras that no pinhole fits.

    `model_of`: by default `central.central_model`.
    Raises ExportError: none fits a camera.
    """
    is_needed = {camera.name: format_.centre is Centre.CENTRAL or not camera.pinhole for camera in material.cameras}
    if not format_.models or not any(is_needed.values()):
        return material
    from pipeline.exports.central import central_model  # loads the tracer

    of_camera = model_of or central_model
    models = {camera.name: of_camera(camera, format_.models) for camera in material.cameras if is_needed[camera.name]}
    views = []
    for view in material.views:
        if view.camera not in models:
            views.append(view)
            continue
        to_centre = rigid(np.eye(3), -models[view.camera].centre_mm)
        from_target = to_centre @ view.built.poses.camera_from_target[view.target]
        world = to_centre @ view.built.poses.camera_from_world
        views.append(replace(view, camera_from_target=from_target, camera_from_world=world))
    cameras = tuple(replace(camera, central=models.get(camera.name)) for camera in material.cameras)
    return replace(material, cameras=cameras, views=tuple(views))


def converted(material: Material, convention: Convention) -> Material:
    """A material as a format counts it; ExportError if microlenses cannot be numbered as the format does it."""
    if convention.centre is Centre.FITTED_TO_ROWS:
        material = _by_rows(material)
    grids = {camera.name: _grid(material, camera, convention) for camera in material.cameras}
    cameras = {camera.name: camera for camera in material.cameras}
    frames = {target.name: board_from_target(target, convention) for target in material.targets}
    return replace(
        material,
        remarks=(*material.remarks, *meaning(convention)),
        cameras=tuple(
            replace(_camera(camera, convention, grids[camera.name]), pose=_from_other(material, number, convention))
            for number, camera in enumerate(material.cameras)
        ),
        targets=tuple(_target(target, convention, frames[target.name]) for target in material.targets),
        views=tuple(
            _view(view, cameras[view.camera], convention, frames[view.target], grids[view.camera])
            for view in material.views
        ),
    )


def _by_rows(material: Material) -> Material:
    """A material whose cameras are the pinholes of their rows, where these determine one, and its poses to these."""
    pinholes = {camera.name: camera.pinhole for camera in material.cameras}
    for camera in material.cameras:
        result = camera.row_pinhole()
        if not isinstance(result, str):
            pinholes[camera.name] = result
    shifts = {
        camera.name: rigid(np.eye(3), camera.pinhole.centre_mm - pinhole.centre_mm)
        for camera in material.cameras
        if camera.pinhole and (pinhole := pinholes[camera.name])
    }

    def shifted(camera: str, pose: np.ndarray | None) -> np.ndarray | None:
        return None if pose is None else shifts.get(camera, np.eye(4)) @ pose

    return replace(
        material,
        cameras=tuple(replace(camera, pinhole=pinholes[camera.name]) for camera in material.cameras),
        views=tuple(
            replace(
                view,
                camera_from_target=shifted(view.camera, view.camera_from_target),
                camera_from_world=shifted(view.camera, view.camera_from_world),
            )
            for view in material.views
        ),
    )


def meaning(convention: Convention) -> tuple[str, ...]:
    """Lines that say what the numbers of a file mean."""
    text = str(convention.origin)
    origin = f"the centre of the top-left pixel is ({text}, {text})"
    if convention.origin in (Origin.IMAGE_CENTRE, Origin.SHARE):
        origin = {Origin.SHARE: "shares of width and height, from a corner"}.get(convention.origin, text)
    lines = [f"image positions in px: {origin}; {convention.axes}"]
    if convention.unit is not Unit.NONE or convention.board is not Board.NONE:
        lines.append(f"lengths in {convention.unit}; target points: {convention.board}")
    if convention.pose is not Pose.NONE:
        lines.append(f"poses: {convention.pose}, by the {convention.centre}; rotation: {convention.rotation}")
        lines.append(f"axes of cameras: {convention.camera_axes}")
    if convention.microlenses is not Microlenses.NONE:
        lines.append(f"microlenses: {convention.microlenses}")
    return tuple(lines)


def board_from_target(target: ExportTarget, convention: Convention) -> np.ndarray:
    """The pose of our target frame in that of a format, (4, 4) [mm]."""
    is_upright = convention.board is Board.KALIBR and target.kind == "aprilgrid"
    turn = np.eye(3) if is_upright else _AXES[convention.board]
    origin = target.nominal[0]
    if convention.board in (Board.OURS, Board.NONE):
        origin = np.zeros(3)
    return rigid(turn, -turn @ origin)


def stated(a_from_b: np.ndarray, rotation: Rotation) -> StatedPose:
    """A pose, (4, 4), with its rotation in the form of a format."""
    return StatedPose(rotation=_FORMS[rotation](a_from_b), translation=a_from_b[:3, 3] + 0.0)


def quaternion(a_from_b: np.ndarray) -> np.ndarray:
    """w, x, y, z of a rotation, w not negative, (4,)."""
    vector = rotation_vector(a_from_b)
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle else vector
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis)])


_FORMS: dict[Rotation, Callable[[np.ndarray], np.ndarray]] = {
    Rotation.VECTOR: lambda pose: rotation_vector(pose) + 0.0,
    Rotation.MATRIX: lambda pose: pose[:3, :3] + 0.0,
    Rotation.COLUMNS: lambda pose: pose[:3, :3].T + 0.0,
    Rotation.QUATERNION: quaternion,
    Rotation.NONE: lambda pose: np.zeros(0),
}


def _grid(material: Material, camera: ExportCamera, convention: Convention) -> MicroImageGrid | None:
    """Numbers of the micro-images of a camera by column and row; None for a conventional one.

    If the format numbers micro-images, those outside of the image that see a point get numbers, too.
    """
    if camera.micro_images is None:
        return None
    views = material.of(camera) if convention.microlenses is Microlenses.MICRO_IMAGE_GRID else ()
    seeing = [view.observations.microlenses for view in views if view.observations.microlenses is not None]
    microlenses = np.concatenate([np.zeros((0, 2), np.int64), *seeing])
    return micro_image_grid(camera.micro_images, camera.size_px, microlenses)


def _camera(camera: ExportCamera, convention: Convention, grid: MicroImageGrid | None) -> ExportCamera:
    """A camera with image positions, microlenses and their types as a format counts them; its pose is added elsewhere.

    `grid`: numbers of its micro-images by column and row; None for a conventional camera.
    """
    # Convert all image positions: principal points, the optical axis, and those at which the camera has rays.
    models = dict[str, Any]()
    for name in ("pinhole", "plain_pinhole", "central"):
        if (model := getattr(camera, name)) is not None:
            point_px = convention.positions(model.principal_point_px, camera.size_px)
            models[name] = replace(model, principal_point_px=point_px)
    axis = convention.positions(camera.axis, camera.size_px)
    rays = replace(camera.rays, convention=convention)
    images = camera.micro_images
    camera = replace(camera, **models, axis=axis, rays=rays)
    if images is None or grid is None:
        return camera
    # Find the micro-image nearest to the middle of the image, while centres are positions of ours, and convert them.
    middle_px = (np.array(camera.size_px) - 1) / 2
    central = int(np.linalg.norm(images.centres - middle_px, axis=1).argmin())
    images = replace(images, centres=convention.positions(images.centres, camera.size_px))
    # Fit a regular mesh to the converted centres, while microlenses still have our numbers, by which it counts them.
    mesh = grid.mesh(images, central)
    # Number microlenses and types as the format does.
    if convention.microlenses is Microlenses.MICRO_IMAGE_GRID:
        images = grid.renumbered(images)
    elif convention.microlenses is Microlenses.FROM_CENTRAL:
        # The type of the central microlens becomes 0; the others follow in our order, and after the last our first.
        types = len(images.own_types)
        central_type = images.types[central]
        images = retyped(images, (np.arange(types) - central_type) % types, (images.types - central_type) % types)
    elif convention.microlenses is Microlenses.TYPES_FROM_ONE:
        images = replace(images, types=images.types + 1)
    return replace(camera, micro_images=images, mesh=mesh)


def _from_other(material: Material, number: int, convention: Convention) -> StatedPose | None:
    """The pose of a camera from the first one, or from that before it, where a format states that."""
    origins = {Pose.CAMERA_FROM_FIRST: 0, Pose.CAMERA_FROM_PREVIOUS: max(number - 1, 0)}
    if convention.pose not in origins:
        return None
    other = material.cameras[origins[convention.pose]]
    turn = _CAMERA_AXES[convention.camera_axes]
    pose = material.second_from_first(other, material.cameras[number])
    return stated(_scaled(turn @ pose @ turn.T, convention.scale), convention.rotation)


def _target(target: ExportTarget, convention: Convention, frame: np.ndarray) -> ExportTarget:
    """A target with points and grid in the frame and unit of a format; `frame` is `board_from_target`."""
    scale = convention.scale
    grid = target.grid
    if grid is not None:
        grid = replace(grid, column_step=grid.column_step * scale, row_step=grid.row_step * scale)
    return replace(
        target,
        points=apply(frame, target.points) * scale + 0.0,
        nominal=apply(frame, target.nominal) * scale + 0.0,
        grid=grid,
    )


def _view(
    view: ExportView, camera: ExportCamera, convention: Convention, frame: np.ndarray, grid: MicroImageGrid | None
) -> ExportView:
    """A view with positions, microlenses and poses as the format counts them; `frame` is `board_from_target`."""
    scale = convention.scale
    observations = view.observations
    observations = replace(observations, positions=convention.positions(observations.positions, camera.size_px))
    if grid and observations.microlenses is not None and convention.microlenses is Microlenses.MICRO_IMAGE_GRID:
        observations = replace(observations, microlenses=grid.cells(observations.microlenses))
    world = None if view.camera_from_world is None else _scaled(view.camera_from_world, scale)
    view = replace(view, camera_from_world=world, observations=observations)
    camera_from_target = view.camera_from_target
    if convention.centre is Centre.PRINCIPAL_POINT:
        front_mm = camera.built.record["lens"]["principal_planes_mm"][0]
        to_front = rigid(np.eye(3), np.array([0.0, 0.0, -front_mm]))
        camera_from_target = to_front @ view.built.poses.camera_from_target[view.target]
    if camera_from_target is None:  # it is to a pinhole, and none fits
        return view
    pose = _scaled(camera_from_target @ inverse(frame), scale)
    if convention.pose not in (Pose.CAMERA_FROM_TARGET, Pose.TARGET_FROM_CAMERA):
        return replace(view, camera_from_target=pose)
    poses = view.built.poses
    from_stop = camera_from_target @ inverse(poses.camera_from_target[view.target])
    lines = poses.camera_from_target_at_lines.get(view.target, ())
    at_lines = (_scaled(from_stop @ line @ inverse(frame), scale) for line in lines)
    return replace(
        view,
        camera_from_target=pose,
        pose=_directed(pose, convention),
        at_lines=tuple(_directed(line, convention) for line in at_lines),
    )


def _directed(camera_from_target: np.ndarray, convention: Convention) -> StatedPose:
    """A pose in the unit of a format, in its direction and form."""
    turned = _CAMERA_AXES[convention.camera_axes] @ camera_from_target
    return stated(inverse(turned) if convention.pose is Pose.TARGET_FROM_CAMERA else turned, convention.rotation)


def _scaled(a_from_b: np.ndarray, scale: float) -> np.ndarray:
    return rigid(a_from_b[:3, :3], a_from_b[:3, 3] * scale)
