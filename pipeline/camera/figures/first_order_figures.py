"""First-order figures of a camera: plain values for camera.json, and a pinhole for viewers of USD, which know no
lenses.

Positions are vision z [mm]. No ray is traced but those of the field of view; `camera.figures.equivalent_pinhole` is
fitted to real rays, for numbers.
"""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.camera.figures.field_curves import field_of_view_deg
from pipeline.camera.focusing.depth_of_field import Focus, foci, middle_focus, view_of
from pipeline.camera.focusing.focus_request import matched_stop_mm
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.lattice import extent_mm, lattice
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.frames import VISION_FROM_CAMERA, apply
from pipeline.optics.first_order import FirstOrder, Pupil, first_order
from pipeline.optics.prescription import Prescription
from pipeline.optics.table import placed
from pipeline.optics.windows import MARK, parted
from pipeline.records.plain import Json
from pipeline.records.shapes import Float64


def report(camera: Camera) -> Json:
    """Figures of a focused camera, from `depth_of_field.focused`, in the order of camera.json."""
    lens = first_order(camera.prescription)
    sensor = camera.sensor
    focus_of_types = foci(camera)
    to_sensor = lens.exit_pupil.z_mm + camera.sensor_distance_mm
    principal_mm = lens.principal_distance_mm(camera.sensor_distance_mm)
    acceptance: Json = {"shape": sensor.acceptance}  # with the numbers that this shape has
    if sensor.acceptance == "cosine":
        acceptance |= {"power": sensor.acceptance_power}
    if sensor.acceptance == "cone":
        angles = {"half_angle_deg": sensor.acceptance_half_angle_deg, "roll_off_deg": sensor.acceptance_roll_off_deg}
        acceptance |= angles
    depths = [focus.depth_of_field_mm for focus in focus_of_types]
    front_mm = -camera.prescription.vertices_from_stop_mm[0]  # with a narrow stop even points in the lens are sharp
    figures: Json = {
        "resolution": list(sensor.size_px),
        "pixel_pitch_mm": sensor.pitch_mm,
        "pixel_acceptance": acceptance,
        "sensor_mm": list(sensor.size_mm),
        "sensor_distance_mm": camera.sensor_distance_mm,
        **({"sensor_tilt_deg": list(sensor.tilt_deg)} if any(sensor.tilt_deg) else {}),
        "lens": _lens(camera, lens, to_sensor),
        "principal_distance_mm": math.inf if lens.entrance_pupil.is_infinite else principal_mm,
        "principal_distance_px": math.inf if lens.entrance_pupil.is_infinite else principal_mm / sensor.pitch_mm,
        "optical_axis_px": list(sensor.axis_px),
        "field_of_view_deg": field_of_view_deg(camera),
        "depth_of_field_mm": [max(front_mm, min(near for near, _ in depths)), max(far for _, far in depths)],
        "near_far_mm": [camera.near_mm, camera.far_mm],
    }
    if camera.microlenses:
        figures["mla"] = _array(camera, camera.microlenses, lens, focus_of_types)
    return figures


def lens_report(prescription: Prescription) -> Json:
    """Figures of a lens for an object at infinity."""
    lens = first_order(prescription)
    entrance, exit_ = lens.entrance_pupil, lens.exit_pupil
    return {
        "efl_mm": lens.efl_mm,
        "bfd_mm": lens.bfd_mm,
        "f_number": lens.f_number,
        "focal_points_mm": [lens.front_focus_mm, lens.rear_focus_mm],
        "entrance_pupil": _pupil(entrance),
        "exit_pupil": _pupil(exit_),
        "principal_planes_mm": [lens.front_principal_mm, lens.rear_principal_mm],
        "stop_diameter_mm": 2 * prescription.stop.semi_diameter_mm,
        "length_mm": prescription.vertices_mm[-1],
        "surfaces": len(prescription.surfaces),
    }


def _pupil(pupil: Pupil) -> Json:
    """Position and diameter of a pupil, infinite for one at infinity."""
    if pupil.is_infinite:
        return {"z_mm": math.copysign(math.inf, pupil.z_mm), "diameter_mm": math.inf}
    return {"z_mm": pupil.z_mm, "diameter_mm": pupil.diameter_mm}


def gaps_mm(ranges: list[tuple[float, float]]) -> list[list[float]]:
    """Gaps in the union of ranges, near to far."""
    gaps = list[list[float]]()
    reached = -math.inf
    for near, far in sorted(ranges):
        if -math.inf < reached < near:
            gaps.append([reached, near])
        reached = max(reached, far)
    return gaps


def _lens(camera: Camera, lens: FirstOrder, to_sensor: float) -> Json:
    """The block `lens` of camera.json; `to_sensor` is the distance from the exit pupil to the sensor [mm]."""
    in_focus = lens.object_mm(-camera.sensor_distance_mm)
    array = camera.microlenses
    matched = matched_stop_mm(lens, array, camera.sensor_distance_mm) if array else None
    figures = lens_report(camera.prescription)
    tilted = camera.film.vision_from_film
    index = camera.prescription.index_in_front
    return {
        **({"is_ideal": True} if camera.prescription.ideal else {}),
        **({"index_in_front": index} if index != 1 else {}),
        **{name: figures[name] for name in ("efl_mm", "bfd_mm", "f_number")},
        "working_f_number": to_sensor / lens.exit_pupil.diameter_mm,
        **{name: figures[name] for name in ("entrance_pupil", "exit_pupil", "principal_planes_mm")},
        "magnification": _magnification(lens, in_focus),
        "focus_distance_mm": in_focus,
        **({} if tilted is None else {"focus_plane_tilt_deg": focus_plane_tilt_deg(tilted, lens, in_focus)}),
        "stop_diameter_mm": figures["stop_diameter_mm"],
        "matched_stop_diameter_mm": matched,
        **_windows(camera.prescription),
    }


def _windows(prescription: Prescription) -> Json:
    """Surfaces of the windows, outermost first, and the entrance pupil of the lens behind them.

    Vertices are from the centre of the stop in the vision frame [mm]; `axis` points towards the scene. The pupil is
    that of the lens alone, about which a dome should be concentric.
    """
    windows, lens = parted(prescription)
    if not windows:
        return {}
    every_surface = []
    # The lens frame, of vertices and displacements, is that of USD's camera: its z axis runs towards the sensor.
    for surface, vertex_z_mm, displacement in placed(prescription):
        vision_from_undisplaced = VISION_FROM_CAMERA @ (np.eye(4) if displacement is None else displacement)
        vertex_mm = apply(vision_from_undisplaced, np.array([0.0, 0.0, vertex_z_mm]))
        towards_scene = -vision_from_undisplaced[:3, 2]
        every_surface.append(
            {
                "vertex_mm": (vertex_mm + 0.0).tolist(),  # + 0.0 turns -0.0 into 0.0
                "axis": (towards_scene + 0.0).tolist(),
                "radius_mm": surface.radius_mm,
                "index_behind": surface.index,
            }
        )
    figures = [
        {"name": group.name.removeprefix(MARK), "surfaces": [every_surface[i] for i in group.members]}
        for group in windows
    ]
    return {"windows": figures, "pupil_behind_windows_mm": first_order(lens).entrance_pupil.z_mm}


def focus_plane_tilt_deg(
    vision_from_film: Float64[np.ndarray, "4 4"], lens: FirstOrder, in_focus_mm: float
) -> list[float]:
    """Tilt angles of the plane in focus on a tilted sensor, measured like the sensor's own (Scheimpflug)."""
    # The lens is a collineation: a plane turned by theta has an image turned by theta', tan theta' = m / n tan theta,
    # because it magnifies m-fold across the axis and m^2 / n along it from a medium n.
    across_x, across_y, along = vision_from_film[:3, 2].tolist()
    x, y = -across_x, -across_y
    z = -along * lens.magnification(in_focus_mm) / lens.index_in_front
    return [math.degrees(math.atan2(-y, z)), math.degrees(math.asin(x / math.hypot(x, y, z)))]


def _magnification(lens: FirstOrder, object_mm: float) -> float:
    """Lateral magnification of the main lens; -inf for an object in its front focus, 0 for one at infinity."""
    if object_mm == lens.front_focus_mm:
        return -math.inf
    return lens.magnification(object_mm) + 0.0


def _array(camera: Camera, array: MicrolensArray, lens: FirstOrder, focus_of_types: tuple[Focus, ...]) -> Json:
    """The block `mla` of camera.json."""
    behind_mm, ahead_mm = array.principal_mm[0]
    to_array = lens.exit_pupil.z_mm + camera.sensor_distance_mm - ahead_mm
    scale = 1 + behind_mm / to_array
    types = [
        {
            "focal_length_mm": focal,
            "principal_planes_mm": [ahead, behind],
            "focus_distance_mm": focus.focus_distance_mm,
            "depth_of_field_mm": list(focus.depth_of_field_mm),
            "virtual_depth": focus.virtual_depth,
            "magnification": _magnification(lens, focus.focus_distance_mm),
            "micro_image_magnification": _through_microlens(behind, lens, focal, ahead - camera.sensor_distance_mm),
        }
        for focal, focus, (behind, ahead) in zip(
            array.focal_lengths_mm, focus_of_types, array.principal_mm, strict=True
        )
    ]
    width_mm, height_mm = extent_mm(array)
    return {
        "layout": array.layout,
        "pitch_mm": array.pitch_mm,
        "cross_pitch_mm": array.pitches_mm[1],
        "extent_mm": [width_mm, height_mm],
        "count": len(lattice(array).k),
        "rotation_deg": array.rotation_deg,
        "offset_mm": [array.offset_x_mm, array.offset_y_mm],
        "tilt_deg": [array.tilt_x_deg, array.tilt_y_deg],
        "distance_mm": array.distance_mm,
        "sharp_in": "micro-images" if view_of(camera) is camera else "views",
        "model": array.model,
        "index": array.index,
        "thickness_mm": array.thickness_mm,
        "aperture": array.aperture,
        "disc_diameter_mm": array.disc_diameter_mm,
        "types": types,
        "depth_of_field_gaps_mm": gaps_mm([focus.depth_of_field_mm for focus in focus_of_types]),
        "micro_image_pitch_px": array.pitch_mm * scale / camera.sensor.pitch_mm,
        "f_number_mismatch": (to_array / lens.exit_pupil.diameter_mm) / (behind_mm / array.pitch_mm),
    }


def _through_microlens(behind_mm: float, lens: FirstOrder, focal: float, array_z: float) -> float:
    """Magnification from the in-focus object to the micro-image."""
    # The main lens's, -(F' - image) / EFL with the image B / v behind the array, times the microlens's v = 1 - B / f.
    # The product stays finite where v is 0 and the image in between lies at infinity.
    vergence = 1 - behind_mm / focal
    return -((lens.rear_focus_mm - array_z) * vergence + behind_mm) / lens.efl_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Viewfinder:
    """A pinhole in front of a film, in the position of the entrance pupil."""

    principal_mm: float  # distance from the pinhole to the film
    # Size of the film along x and y of the image; its middle, from the foot of the pinhole, x right and y up as the
    # viewer looks at the scene
    size_mm: tuple[float, float]
    offset_mm: tuple[float, float]
    focus_mm: float  # vision z in focus, of the middle microlens type; may be inf
    # Principal distance over the diameter of the entrance pupil: that of an equally wide thin lens
    f_number: float
    nearest_mm: float  # vision z of the first vertex: nothing nearer is visible


def viewfinder(camera: Camera) -> Viewfinder:
    """The viewfinder of a camera whose focus is solved; CameraError: its pupil is at infinity."""
    lens = first_order(camera.prescription)
    sensor = camera.sensor
    if lens.entrance_pupil.is_infinite:
        raise CameraError("a telecentric lens has its entrance pupil at infinity, and so no pinhole of a field of view")
    principal_mm = lens.principal_distance_mm(camera.sensor_distance_mm)
    focus_mm = middle_focus(camera)
    return Viewfinder(
        principal_mm=principal_mm,
        size_mm=sensor.size_mm,
        # Offsets say where the axis meets the image, x right and y down: the image's middle lies on the other side.
        offset_mm=(0.0 - sensor.offset_x_mm, 0.0 + sensor.offset_y_mm),
        focus_mm=focus_mm if focus_mm > 0 else math.inf,
        f_number=principal_mm / lens.entrance_pupil.diameter_mm,
        nearest_mm=-camera.prescription.vertices_from_stop_mm[0],
    )
