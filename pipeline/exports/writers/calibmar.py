"""CalibMar: the camera in air, and the one port before it, as the YAML file that its dialogs import.

A flat port is a pane of parallel planes, a dome a shell of concentric spheres, in the frame of the camera in air.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.camera.figures.equivalent_pinhole import Projection, pinhole
from pipeline.camera.parts.camera import Camera
from pipeline.exports.material import ExportCamera, Material
from pipeline.files.jsonfile import Json
from pipeline.formats import Cameras, ExportError, Format, Origin, Reads, Unit
from pipeline.optics.windows import parted

FORMAT = Format(
    consumer="CalibMar: underwater housings",
    note="pinhole of the lens without its port, OPENCV or FULL_OPENCV; FLATPORT, DOMEPORT or NONE",
    source="read: MDSKiel/calibmar d137ee5, report.cpp, and models_refrac.h of its COLMAP",
    cameras=Cameras.CONVENTIONAL,
    reads=frozenset({Reads.RAYS}),
    files=("<camera>.yaml",),
    origin=Origin.HALF,
    unit=Unit.M,
)

_SAME_MM = 1e-9
"""Distance of planes from parallel across the port, and of centres of spheres, that is rounding [mm]."""
_RAYS = "export rays, which hold any camera"


def write(material: Material, folder: Path) -> None:
    """Write a file per camera; ExportError: there is more before a lens than a flat port or a dome."""
    for camera in material.cameras:
        material.write_text(folder / f"{camera.name}.yaml", _lines(camera))


def _lines(camera: ExportCamera) -> Iterator[str]:
    seen = camera.rays.sight.camera
    windows, lens = parted(seen.prescription)
    in_air = pinhole(replace(seen, prescription=lens, spectrum=()))
    if in_air is None or any(seen.sensor.tilt_deg):
        raise ExportError(f"the pinhole of CalibMar is not like {camera.name} without its windows", hint=_RAYS)
    name, numbers = "NONE", list[float]()
    if windows:
        name, numbers = _port(camera, seen, np.array(in_air.centre_mm))
    f, (width, height) = in_air.distorted.principal_distance_px, camera.size_px
    model, coefficients = _model(in_air.distorted)
    middle = camera.rays.positions(np.array(in_air.distorted.principal_point_px)).tolist()
    yield f"model: {model}"
    yield f"parameters: {[f, f, *middle, *coefficients]}"
    yield f"non_svp_model: {name}"
    yield f"non_svp_parameters: {numbers}"
    yield f"width: {width}"
    yield f"height: {height}"
    yield f"# overall_rms: {in_air.distorted.rms_px!r}"


def _model(projection: Projection) -> tuple[str, list[float]]:
    *four, k3 = projection.distortion
    return ("FULL_OPENCV", [*four, k3, 0.0, 0.0, 0.0]) if k3 else ("OPENCV", four)


def _port(camera: ExportCamera, seen: Camera, centre_mm: np.ndarray) -> tuple[str, list[float]]:
    """The port before a camera whose centre of projection in air is given, in metres; ExportError: it is none."""
    windows: list[Json] = camera.built.record["lens"]["windows"]
    surfaces = seen.prescription.surfaces[: len(windows[0]["surfaces"])]
    is_round = all(s.conic == 0 and not (s.even_coefficients or s.odd_coefficients or s.is_cylinder) for s in surfaces)
    if len(windows) > 1 or len(surfaces) != 2 or not is_round:
        what = f"CalibMar knows one flat port or dome, and {camera.name} looks through something else"
        raise ExportError(what, hint=_RAYS)
    outer, inner = ({key: np.array(value, float) for key, value in face.items()} for face in windows[0]["surfaces"])
    indices = [surfaces[1].index, surfaces[0].index, seen.prescription.index_in_front]
    if np.isinf(outer["radius_mm"]) and np.isinf(inner["radius_mm"]):
        off_mm = np.linalg.norm(np.cross(outer["axis"], inner["axis"])) * surfaces[0].semi_diameter_mm
        along = [float(inner["axis"] @ place) for place in (centre_mm, inner["vertex_mm"], outer["vertex_mm"])]
        lengths_mm, start = np.diff(along), inner["axis"].tolist()
        name = "FLATPORT"
    else:
        centres = [face["vertex_mm"] - face["radius_mm"] * face["axis"] for face in (outer, inner)]
        off_mm = np.linalg.norm(centres[0] - centres[1])
        lengths_mm = np.diff([0.0, float(inner["radius_mm"]), float(outer["radius_mm"])])
        name, start = "DOMEPORT", ((centres[1] - centre_mm) / 1e3).tolist()
    if not (off_mm < _SAME_MM and min(lengths_mm) > 0):
        what = (
            f"CalibMar knows panes with parallel faces and domes with concentric ones; that of {camera.name} is neither"
        )
        raise ExportError(what, hint=_RAYS)
    return name, [*start, *(lengths_mm / 1e3).tolist(), *indices]
