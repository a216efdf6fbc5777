"""libpleno, COMPOTE and BLADE: observations with centres and blur-aware features, and JSON for a calibration to start.

One folder per camera. observations.bin.gz holds centres and features, as COMPOTE's own files; corners.bin.gz centres
and corners without blur radii. Layouts: pleno/geometry/observation.cpp, pleno/io/cfg/ of comsee-research/libpleno.
"""

import gzip
import math
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.exports.material import ExportCamera, Material
from pipeline.exports.micro_images import GridMesh
from pipeline.files.jsonfile import write_json
from pipeline.files.tables import write_table
from pipeline.fits.thin_lens import ThinLens
from pipeline.formats import Board, Cameras, Centre, Format, Microlenses, Origin, Pose, Rotation, Targets, Unit

FORMAT = Format(
    consumer="libpleno, COMPOTE, BLADE",
    source="proof: projections of comsee-research/libpleno 48db282. Read: camera.js, in its pleno/io/cfg/",
    cameras=Cameras.PLENOPTIC,
    targets=Targets.BOARD,
    files=(
        "<camera>/observations.bin.gz",
        "<camera>/corners.bin.gz",
        "<camera>/centers.csv",
        "<camera>/features.csv",
        "<camera>/camera.js",
        "<camera>/intrinsics.js",
        "<camera>/params.js",
        "<camera>/scene.js",
        "<camera>/poses.js",
    ),
    origin=Origin.ZERO,
    board=Board.RIGHT_DOWN,
    pose=Pose.TARGET_FROM_CAMERA,
    centre=Centre.PRINCIPAL_POINT,
    rotation=Rotation.COLUMNS,
    unit=Unit.MM,
    microlenses=Microlenses.MICRO_IMAGE_GRID,
)

_CENTRE = [("k", "<i4"), ("l", "<i4"), ("u", "<f8"), ("v", "<f8")]
_CORNER = [*_CENTRE, ("cluster", "<i4"), ("frame", "<i4")]
_FEATURE = [*_CENTRE, ("rho", "<f8"), ("cluster", "<i4"), ("frame", "<i4")]
_NO_DISTORTION = {"model": 0, "radial": [[0.0] * 3], "tangential": [[0.0] * 2], "depth": [[0.0] * 3]}
_KAPPA = 0.8
"""Initial value of its kappa, the spread of a point over its blur radius: about the result of calibrations [1]."""
_GEOMETRIES = {"square": 0, "hexagonal": 1, "hexagonal-columns": 2}


def write(material: Material, folder: Path) -> None:
    """Write the files of every camera."""
    for camera in material.cameras:
        camera_folder = folder / camera.name
        camera_folder.mkdir()
        centres = _centres(camera)
        observations = _observations(material, camera)
        sharp = observations[np.isfinite(observations["rho"])]
        _pack(camera_folder / "observations.bin.gz", centres, np.zeros(0, _CORNER), sharp)
        corners = observations[[name for name, _ in _CORNER]].astype(_CORNER)
        _pack(camera_folder / "corners.bin.gz", centres, corners, np.zeros(0, _FEATURE))
        for name, rows in (("centers", centres), ("features", sharp)):
            columns = {column: rows[column] for column in rows.dtype.names or ()}
            write_table(camera_folder / f"{name}.csv", (), columns)
        about = {"about": list(material.remarks)}
        model = camera.thin_lens
        write_json(camera_folder / "camera.js", {**about, **_camera(camera, model)})
        write_json(camera_folder / "intrinsics.js", {**about, **_camera(camera, model), **_intrinsics(camera, model)})
        write_json(camera_folder / "params.js", {**about, **_parameters(camera, model)})
        board = material.board
        grid = {"lph": board.square_mm, "pose": _pose(np.eye(3), [0.0, 0.0, 0.0])}
        grid |= {"x_grid": board.columns, "y_grid": board.rows}
        write_json(camera_folder / "scene.js", {**about, "checkerboards": [grid]})
        poses = [
            {"frame": view.frame, "pose": _pose(view.pose.rotation, view.pose.translation.tolist())}
            for view in material.of(camera)
            if view.pose
        ]
        write_json(camera_folder / "poses.js", {**about, "poses": poses})


def _centres(camera: ExportCamera) -> np.ndarray:
    images, _ = camera.array
    rows = np.zeros(len(images.types), _CENTRE)
    rows["k"], rows["l"] = images.microlenses.T
    rows["u"], rows["v"] = images.centres.T
    return rows


def _observations(material: Material, camera: ExportCamera) -> np.ndarray:
    """All observations of a camera, with NaN where a blur radius is unknown."""
    parts = []
    for view in material.of(camera):
        observations = view.observations
        assert observations.microlenses is not None
        rows = np.zeros(len(observations.ids), _FEATURE)
        rows["k"], rows["l"] = observations.microlenses.T
        rows["u"], rows["v"] = observations.positions.T
        rows["rho"], rows["cluster"], rows["frame"] = observations.rho_px, observations.ids, view.frame
        parts.append(rows)
    return np.concatenate(parts)


def _pack(path: Path, *sections: np.ndarray) -> None:
    """Write sections one after the other, each with its count before it; packed, little-endian, in one gzip stream."""
    data = b"".join(len(rows).to_bytes(8, "little") + rows.tobytes() for rows in sections)
    path.write_bytes(gzip.compress(data, mtime=0))


def _camera(camera: ExportCamera, model: ThinLens) -> dict[str, Any]:
    width, height = camera.size_px
    return {
        "mia": {"mesh": _mesh(camera.array[1])},
        "sensor": {"scale": camera.pitch_mm, "width": width, "height": height},
        "main_lens": {"aperture": model.f_number, "f": model.focal_mm},
        "dist_focus": model.focus_mm,
        "I": len(model.focal_lengths_mm),
        "mode": model.mode,
    }


def _size(mesh: GridMesh) -> tuple[int, int]:
    """Columns and rows of a mesh.

    Microlenses are counted against their micro-images, (columns - 1 - k, rows - 1 - l). Every other line is shifted, so
    the number of lines has to be even: an odd one gets a further line without observations.
    """
    columns = mesh.columns + mesh.columns % 2 if mesh.layout == "hexagonal-columns" else mesh.columns
    rows = mesh.rows + mesh.rows % 2 if mesh.layout == "hexagonal" else mesh.rows
    return columns, rows


def _intrinsics(camera: ExportCamera, model: ThinLens) -> dict[str, Any]:
    """The same camera in the form of a calibration's `intrinsics.js`: no initial value is left to be estimated.

    It looks along z, its main lens in the origin, array and sensor behind it; a pixel is u = W - 1 - x / scale of the
    sensor's own x. The micro-image (k, l) lies on the line from the origin through its microlens.
    """
    _, mesh = camera.array
    scale = camera.pitch_mm
    last = np.array(camera.size_px) - 1
    corner = -(last - camera.axis) * scale
    sensor = _pose(np.eye(3), [*corner.tolist(), -(model.main_lens_mm + model.sensor_mm)])
    size = {"width": camera.size_px[0], "height": camera.size_px[1]}
    per_px = scale * model.ratio
    return {
        "sensor": {"scale": scale, **size, "pose": sensor},
        "main_lens": {
            "aperture": model.f_number,
            "f": model.focal_mm,
            "diameter": model.focal_mm / model.f_number,
            "pose": _pose(np.eye(3), [0.0, 0.0, 0.0]),
        },
        "mla": {
            "focal_lengths": model.focal_lengths_mm.tolist(),
            "mesh": {
                **_mesh(mesh),
                "pitch": [[value * per_px for value in mesh.pitch_px]],
                "pose": _array_pose(mesh, camera.axis, per_px, model.main_lens_mm),
            },
        },
        **{name: dict(_NO_DISTORTION) for name in ("distortions", "distortions_inverse")},
        "D": model.main_lens_mm,
        "d": model.sensor_mm,
        "pp": [camera.axis.tolist()],
    }


def _array_pose(mesh: GridMesh, axis: np.ndarray, per_px: float, distance_mm: float) -> dict[str, Any]:
    """Pose of the array, whose nodes are those of the micro-images seen from the main lens, turned by 180 deg."""
    columns, rows = _size(mesh)
    across, down = mesh.step_px
    shift = mesh.pitch_px[0] / 2 if mesh.layout == "hexagonal" else 0  # node (0, 0) is shifted in rows alone
    first = (axis - mesh.image_position(across * (columns - 1) + shift, down * (rows - 1))) * per_px
    cos, sin = math.cos(mesh.angle_rad), math.sin(mesh.angle_rad)
    turn = [[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]
    return _pose(turn, [*first.tolist(), -distance_mm])


def _pose(columns: Any, translation: list[float]) -> dict[str, Any]:
    return {"rotation": columns, "translation": [translation]}


def _mesh(mesh: GridMesh) -> dict[str, Any]:
    """Matrices are lists of columns. libpleno moves columns 1, 3, … up where a mesh moves 0, 2, … down."""
    down = mesh.pitch_px[1] / 2 if mesh.layout == "hexagonal-columns" else 0
    cos, sin = math.cos(mesh.angle_rad), math.sin(mesh.angle_rad)
    columns, rows = _size(mesh)
    return {
        "geometry": _GEOMETRIES[mesh.layout],
        "width": columns,
        "height": rows,
        "pitch": [list(mesh.pitch_px)],
        "pose": _pose([[cos, sin], [-sin, cos]], mesh.image_position(0, down).tolist()),
    }


def _parameters(camera: ExportCamera, model: ThinLens) -> dict[str, Any]:
    """Internal parameters: PlenopticCamera::params of libpleno."""
    pitch_mm = sum(camera.array[1].pitch_px) / 2 * camera.pitch_mm
    half = [pitch_mm * model.ratio * model.sensor_mm / (2 * f) for f in model.focal_lengths_mm.tolist()]
    return {
        "m": -model.sensor_mm * model.focal_mm / (2 * model.main_lens_mm),
        "scale": camera.pitch_mm,
        "q": [value - pitch_mm / 2 for value in half],
        "q_prime": half,
        "dc": pitch_mm,
        "dC": pitch_mm * model.ratio,
        "lambda": model.ratio,
        "kappa": _KAPPA,
        "N": model.f_number,
        "I": len(half),
    }
