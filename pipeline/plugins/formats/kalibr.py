"""Kalibr: the target, the camera chain, and the corners in Kalibr's numbering of points.

Kalibr detects corners in images itself, so corners.csv is for comparison. Its YAML reader refuses integers where it
expects reals.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.exports.material import ExportCamera, ExportTarget, Material
from pipeline.files.tables import write_table
from pipeline.formats import Board, Cameras, Centre, ExportError, Format, Origin, Pose, Reads, Rotation, Targets, Unit
from pipeline.motion import Shutter
from pipeline.plugins.formats.filestorage import yaml_real

FORMAT = Format(
    consumer="Kalibr",
    note="Kalibr itself does not read corners.csv; eucm or ds where no pinhole fits",
    source="proof: ConfigReader.py of ethz-asl/kalibr 1f60227. Read: GridCalibrationTarget*, RollingShutter.hpp",
    cameras=Cameras.CONVENTIONAL,
    targets=Targets.ONE,
    reads=frozenset({Reads.CORNERS, Reads.RAYS}),
    files=("target.yaml", "camchain.yaml", "corners.csv"),
    origin=Origin.ZERO,
    board=Board.KALIBR,
    pose=Pose.CAMERA_FROM_PREVIOUS,
    centre=Centre.FITTED_TO_ROWS,
    rotation=Rotation.MATRIX,
    unit=Unit.M,
    models=("eucm", "double-sphere"),
)

_MODELS = {"eucm": "eucm", "double-sphere": "ds"}
"""Model name here -> camera_model, whose intrinsics begin with the coefficients, in the same order."""
_SLOPES = np.linspace(0.0, 8.0, 4001)[1:]
"""Slopes at which radii of two pinholes are compared, over the slope of a corner without distortion [1]; those inside
the image count.
"""
_LEAST = 3
"""Fewest rows and columns of a checkerboard that Kalibr accepts."""


def write(material: Material, folder: Path) -> None:
    """Write the three files."""
    material.write_text(folder / "target.yaml", _target(material))
    material.write_text(folder / "camchain.yaml", _chain(material))
    _write_corners(material, folder / "corners.csv")


def _target(material: Material) -> Iterator[str]:
    target = material.only_target
    if target.kind == "aprilgrid":
        yield from _aprilgrid(target)
        return
    board = material.board
    if min(board.columns, board.rows) < _LEAST:
        yield f"# Kalibr wants {_LEAST} rows and columns of inner corners at least"
    if target.kind == "circle-grid":
        yield from ("target_type: 'circlegrid'", f"targetCols: {board.columns}", f"targetRows: {board.rows}")
        yield from (f"spacingMeters: {yaml_real(board.column_step)}", "asymmetricGrid: False")
        return
    yield from ("target_type: 'checkerboard'", f"targetCols: {board.columns}", f"targetRows: {board.rows}")
    yield f"rowSpacingMeters: {yaml_real(board.row_step)}"
    yield f"colSpacingMeters: {yaml_real(board.column_step)}"


def _aprilgrid(target: ExportTarget) -> Iterator[str]:
    """Size of tags from their corners 0 and 1, gap from corner 1 to the next tag's corner 0, along the lowest row."""
    across = np.linalg.norm(np.diff(target.nominal[:3], axis=0), axis=1)
    yield from ("target_type: 'aprilgrid'", f"tagCols: {target.parameters['columns']}")
    yield f"tagRows: {target.parameters['rows']}"
    yield f"tagSize: {yaml_real(across[0])}"
    yield f"tagSpacing: {yaml_real(across[1] / across[0])}"


def _chain(material: Material) -> Iterator[str]:
    """Cameras one after the other, each with its pose from the one before."""
    for number, camera in enumerate(material.cameras):
        overlapping = [str(other) for other in range(len(material.cameras)) if other != number]
        yield f"cam{number}:"
        yield f"  cam_overlaps: [{', '.join(overlapping)}]"
        yield from (f"  {line}" for line in _camera(camera))
        if number and camera.pose:
            yield "  T_cn_cnm1:"
            yield from (f"  - [{', '.join(map(yaml_real, row))}]" for row in camera.pose.matrix)


def _camera(camera: ExportCamera) -> Iterator[str]:
    """Lines of one camera: its model, or a pinhole, whose k3 Kalibr does not know."""
    if model := camera.central:
        yield f"camera_model: {_MODELS[model.name]}"
        yield f"# no pinhole fits; residual of the rays of the image: {model.rms_px:.3g} px rms"
        distortion_name = "none"
        distortion = list[float]()
        intrinsics = [*model.coefficients.tolist(), *model.focal_px.tolist(), *model.principal_point_px.tolist()]
    else:
        f, _, cx, cy, k1, k2, p1, p2, k3 = camera.opencv
        yield "camera_model: pinhole"
        if k3:
            f, k1, k2, residual_px = _without_k3(camera)
            yield f"# radtan has no k3: f, k1 and k2 are nearest to the pinhole, {residual_px:.2g} px from it at most"
        distortion_name = "radtan"
        distortion = [k1, k2, p1, p2]
        intrinsics = [f, f, cx, cy]
    yield f"distortion_model: {distortion_name}"
    yield f"distortion_coeffs: [{', '.join(map(yaml_real, distortion))}]"
    yield f"intrinsics: [{', '.join(map(yaml_real, intrinsics))}]"
    yield f"resolution: [{camera.size_px[0]}, {camera.size_px[1]}]"
    yield f"rostopic: /{camera.name.replace('.', '/')}/image_raw"
    if camera.built.shutter:
        yield from _shutter(camera, camera.built.shutter)


def _without_k3(camera: ExportCamera) -> tuple[float, float, float, float]:
    """f, k1, k2 whose image radii are nearest to those of the pinhole with k3, and the largest difference [px]: a
    linear least-squares fit in f, f k1 and f k2, weighted by area.
    """
    f, _, cx, cy, k1, k2, _, _, k3 = camera.opencv
    width, height = camera.size_px
    farthest_px = np.hypot(max(cx, width - 1 - cx), max(cy, height - 1 - cy))
    slopes = _SLOPES * farthest_px / f
    # r(t) = f t (1 + k1 t^2 + k2 t^4 + k3 t^6) of the slope t
    radii_px = f * np.polyval([k3, 0, k2, 0, k1, 0, 1, 0], slopes)
    in_image = np.logical_and.accumulate((radii_px <= farthest_px) & (np.gradient(radii_px) > 0))
    slopes, radii_px = slopes[in_image], radii_px[in_image]
    powers = slopes[:, None] ** [1, 3, 5]
    weight = np.sqrt(radii_px)  # its square is the area of a ring
    fitted = np.linalg.lstsq(powers * weight[:, None], radii_px * weight, rcond=None)[0]
    residual_px = np.abs(powers @ fitted - radii_px).max()
    return float(fitted[0]), float(fitted[1] / fitted[0]), float(fitted[2] / fitted[0]), float(residual_px)


def _shutter(camera: ExportCamera, shutter: Shutter) -> Iterator[str]:
    """Delay from row to row of the image, downwards: Kalibr adds y times this to the time stamp of the image [s]."""
    if shutter.axis == 0:
        raise ExportError(
            f"{camera.name} scans {shutter.scan_order}, and Kalibr supports only lines that are rows",
            hint="choose other cameras with --only",
        )
    (stamp_s,) = shutter.middle_s(np.zeros((1, 2)), camera.size_px).tolist()
    yield f"# stamp of an image, after the time code of its frame: {stamp_s!r} s, the middle of the exposure of row 0"
    if shutter.line_s:
        yield f"line_delay: {yaml_real(shutter.line_by_px_s)}"


def _write_corners(material: Material, path: Path) -> None:
    names = [camera.name for camera in material.cameras]
    points = material.only_target.points
    rows = [
        (view.frame, names.index(view.camera), point, *position, *points[point].tolist())
        for view in material.views
        for point, position in zip(view.observations.ids.tolist(), view.observations.positions.tolist(), strict=True)
    ]
    head = ("frame", "camera", "point", "x_px", "y_px", "target_x_m", "target_y_m", "target_z_m")
    write_table(path, material.remarks, {name: [row[column] for row in rows] for column, name in enumerate(head)})
