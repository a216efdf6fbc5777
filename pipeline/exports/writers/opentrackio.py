"""OpenTrackIO: a sample of each camera and frame, with the lens of that frame as OpenLensIO 1.0 has it.

The pose is that of the middle of the sensor, and the entrance pupil, where the pinhole stands, is before it. Distortion
is that of OpenCV in millimetres on the sensor: U of section 4.1 takes coefficients with every second one in a
denominator, which is 1 here, and decentring ones in 1/mm by equation 16.
"""

import math
from pathlib import Path

import numpy as np

from pipeline.exports.material import ExportCamera, Material
from pipeline.files.jsonfile import Json, write_json
from pipeline.formats import Cameras, Format, Origin, Unit
from pipeline.frames import inverse

FORMAT = Format(
    consumer="OpenTrackIO 1.0 and OpenLensIO 1.0: Unreal Engine and other programs of virtual production",
    note="the stage's z is y of a world with Y up, and its y is -z; x is x",
    source="proof: the schema of SMPTE/ris-osvp-metadata-camdkit f9f9480. Read: OpenLensIO 1.0.1, its equations",
    cameras=Cameras.CONVENTIONAL,
    files=("<camera>/<frame>.json",),
    origin=Origin.IMAGE_CENTRE,
    unit=Unit.M,
)

_STAGE_FROM_WORLD = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""The stage of OpenTrackIO has x right, y forward and z up."""
_CAMERA_FROM_VISION = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""And so has its camera."""


def write(material: Material, folder: Path) -> None:
    """Write a file per camera and frame."""
    for camera in material.cameras:
        lens, before_mm = _lens(camera)
        poses = {view.frame: view.camera_from_world for view in material.of(camera)}
        (folder / camera.name).mkdir()
        for frame, pose in poses.items():
            assert pose is not None  # a pinhole fits
            sample = {
                "protocol": {"name": "OpenTrackIO", "version": [1, 0, 0]},
                "static": _static(camera),
                "lens": lens,
                "transforms": [_transform(pose, before_mm)],
            }
            write_json(folder / camera.name / f"{frame:04d}.json", sample)


def _static(camera: ExportCamera) -> Json:
    width, height = camera.size_px
    size = {"width": width * camera.pitch_mm, "height": height * camera.pitch_mm}
    lens = {"model": camera.built.record["lens"]["name"]}
    sensor = {"activeSensorPhysicalDimensions": size, "activeSensorResolution": {"width": width, "height": height}}
    return {"camera": sensor, "lens": lens}


def _lens(camera: ExportCamera) -> tuple[Json, float]:
    """The lens of a camera, and how far the pinhole stands before the sensor [mm]."""
    pinhole, record = camera.model, camera.built.record
    focal_mm = pinhole.principal_distance_px * camera.pitch_mm
    k1, k2, p1, p2, k3 = camera.brown
    offset_mm = pinhole.principal_point_px * camera.pitch_mm
    before_mm = float(record["sensor_distance_mm"] + record["pinhole"]["centre_mm"][2])
    radial = [k1 / focal_mm**2, 0.0, k2 / focal_mm**4, 0.0, k3 / focal_mm**6, 0.0]
    bent = {"model": "Brown-Conrady U-D", "radial": radial, "tangential": [p1 / focal_mm, p2 / focal_mm]}
    focus_mm = record["lens"]["focus_distance_mm"]
    lens: Json = {
        "pinholeFocalLength": focal_mm,
        "entrancePupilOffset": before_mm * 1e-3,
        "fStop": record["lens"]["f_number"],
        "projectionOffset": {"x": float(offset_mm[0]), "y": float(offset_mm[1])},
        "distortion": [bent],
    }
    is_near = focus_mm is not None and 0 < focus_mm < math.inf
    return (lens | {"focusDistance": focus_mm * 1e-3} if is_near else lens), before_mm


def _transform(camera_from_world: np.ndarray, before_mm: float) -> Json:
    """Place of the sensor [m], and pan, tilt and roll about z, x and y [deg], by the pose of the pinhole."""
    from scipy.spatial.transform import Rotation as Turn

    world_from_camera = inverse(camera_from_world)
    turn = _STAGE_FROM_WORLD @ world_from_camera[:3, :3] @ _CAMERA_FROM_VISION.T
    place = _STAGE_FROM_WORLD @ (world_from_camera @ [0.0, 0.0, -before_mm * 1e-3, 1.0])[:3]
    angles = (Turn.from_matrix(turn).as_euler("ZXY", degrees=True) + 0.0).tolist()
    return {
        "translation": dict(zip("xyz", place.tolist(), strict=True)),
        "rotation": dict(zip(("pan", "tilt", "roll"), angles, strict=True)),
    }
