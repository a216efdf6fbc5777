"""Focus as intent: a camera that says what it shall do, and the camera whose parts stand so that it does.

Paraxial; positions are vision z [mm]. The sensor moves, with the microlens array a fixed distance before it, and the
lens stays; or else the sensor stays and groups of the lens move, see `camera.focusing.group_travel`. Where the sensor
moves, far objects have their images nearest to the lens, so the last vertex bounds what can be reached. The stop is set
to an F-number, or to match the microlenses.
"""

import dataclasses
import math
from dataclasses import dataclass

from pipeline.camera.focusing.group_travel import moved, shift_mm
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.errors import PipelineError
from pipeline.optics.first_order import FirstOrder, first_order
from pipeline.optics.prescription import Prescription


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusRequest:
    """A camera before it is focused; fields that it shares with `Camera` mean the same."""

    prescription: Prescription
    sensor: Sensor
    microlenses: MicrolensArray | None = None
    circle_of_confusion_px: float = 1.0
    near_mm: float | None = None
    far_mm: float | None = None
    weight: str = "irradiance"
    # Distance from stop to sensor; None: `focus_distance_mm` decides. With `focus_groups` both are given.
    sensor_distance_mm: float | None = None
    focus_distance_mm: float | None = None  # object distance from the stop that shall be in focus; may be inf
    focus_type: int | None = None  # microlens type that this holds for; None: the one of middle focal length
    # Groups of the lens that move together to meet the focus distance; empty: sensor and array do
    focus_groups: tuple[str, ...] = ()
    # Whether the stop gets the diameter with which the exit pupil's image through a microlens vertex is as wide as the
    # MLA pitch
    match_stop: bool = False

    @property
    def type(self) -> int | None:
        """The microlens type that the focus distance refers to; None for a conventional camera."""
        if self.microlenses is None:
            return None
        focal = self.microlenses.focal_lengths_mm
        middle = sorted(range(len(focal)), key=focal.__getitem__)[len(focal) // 2]
        return middle if self.focus_type is None else self.focus_type


def solved(camera: Camera | FocusRequest) -> Camera:
    """The camera that does what is asked; a `Camera` asks for nothing.

    Raises CameraError: it cannot be done; the hint says what can.
    """
    if isinstance(camera, Camera):
        return camera
    placed = Camera(
        prescription=moved(camera.prescription, camera.focus_groups, group_shift(camera)),
        sensor=camera.sensor,
        sensor_distance_mm=sensor_distance(camera),
        microlenses=camera.microlenses,
        circle_of_confusion_px=camera.circle_of_confusion_px,
        near_mm=camera.near_mm,
        far_mm=camera.far_mm,
        weight=camera.weight,
    )
    return with_matched_stop(placed) if camera.match_stop else placed


def sensor_distance(request: FocusRequest) -> float:
    """Distance from the stop to the sensor that brings the requested object distance into focus. [mm]"""
    wanted = request.focus_distance_mm
    if wanted is None or request.focus_groups:
        if request.sensor_distance_mm is None:
            raise CameraError(
                "neither a sensor distance nor a focus distance is given",
                hint="give one of them; with focus_groups both",
            )
        return request.sensor_distance_mm
    near, far = reachable(request)
    if not (near < wanted < far or wanted == far == math.inf):
        place = f"{wanted:g} mm from the stop" if math.isfinite(wanted) else "infinity"
        what = f"no position of the sensor brings {place} into focus"
        reach = f"between {near:.6g} and {far:.6g} mm" if math.isfinite(far) else f"beyond {near:.6g} mm"
        raise CameraError(what, hint=f"within reach: distances {reach}")
    array = request.microlenses
    film = -first_order(request.prescription).image_mm(wanted) - _image_behind_film(request)
    return film + (_principal_mm(array, request.type)[1] if array else 0.0)


def group_shift(request: FocusRequest) -> float:
    """Movement of the groups, + towards the sensor, that brings the requested object distance into focus. [mm]"""
    wanted = request.focus_distance_mm
    if not request.focus_groups or wanted is None:
        return 0.0
    array, film = request.microlenses, sensor_distance(request)
    image = film - (_principal_mm(array, request.type)[1] if array else 0.0) + _image_behind_film(request)
    film -= array.reach_mm if array else 0.0
    return shift_mm(request.prescription, request.focus_groups, film, image, wanted)


def reachable(request: FocusRequest) -> tuple[float, float]:
    """Object distances that can be brought into focus: nearest and farthest, ends excluded but inf. [mm]

    The nearest object stands before the lens and its front focus; for the farthest one the sensor, or the array,
    touches the last vertex.
    """
    lens, vertices = first_order(request.prescription), request.prescription.vertices_from_stop_mm
    if not 0 < lens.efl_mm < math.inf:
        power = "without power" if math.isinf(lens.efl_mm) else f"with the focal length {lens.efl_mm:g} mm"
        raise CameraError(f"a lens {power} has no real image to focus")
    nearest = max(lens.front_focus_mm, -vertices[0])
    array = request.microlenses
    before_film = array.reach_mm - _principal_mm(array, request.type)[1] if array else 0.0
    least_image = vertices[-1] + before_film + _image_behind_film(request)
    if least_image <= -lens.rear_focus_mm:
        return nearest, math.inf
    farthest = lens.object_mm(-least_image)
    if farthest <= nearest:
        raise CameraError(
            "no object distance can be focused: its image would lie inside the lens",
            hint="is the microlens distance, or a thickness of the lens, too large?",
        )
    return nearest, farthest


def _image_behind_film(request: FocusRequest) -> float:
    """Distance of the main-lens image in focus behind the sensor, or the microlens' front principal plane. [mm]"""
    array = request.microlenses
    if array is None or request.type is None:
        return 0.0
    focal = array.focal_lengths_mm[request.type]
    behind_mm = _principal_mm(array, request.type)[0]
    vergence = 1 - behind_mm / focal
    if vergence == 0:
        what = f"microlenses of {focal:g} mm, as far from the sensor, see infinity sharp wherever the sensor stands"
        raise CameraError(what, hint="author plen:camera:sensorDistance")
    return behind_mm / vergence


def _principal_mm(array: MicrolensArray, kind: int | None) -> tuple[float, float]:
    """Rear and front principal plane of a microlens type before the sensor. [mm]"""
    return array.principal_mm[kind or 0]


def matched_stop_mm(lens: FirstOrder, array: MicrolensArray, sensor_distance_mm: float) -> float:
    """Stop diameter with which the exit pupil's image through a microlens vertex is as wide as the MLA pitch. [mm]

    Of microlenses with faces, the vertex is that of the principal planes of type 0.
    """
    behind_mm, ahead_mm = array.principal_mm[0]
    to_array = lens.exit_pupil.z_mm + sensor_distance_mm - ahead_mm
    return to_array / behind_mm * array.pitch_mm / abs(lens.exit_pupil.magnification)


def with_matched_stop(camera: Camera) -> Camera:
    """The camera with its stop matched to its microlenses.

    Raises CameraError: there are no microlenses, or the edge of another surface would limit the light on the axis.
    """
    array, prescription = camera.microlenses, camera.prescription
    if array is None:
        raise CameraError("a camera without microlenses has no stop that matches them", hint="match_stop=False")
    diameter = matched_stop_mm(first_order(prescription), array, camera.sensor_distance_mm)
    widest = widest_stop_mm(prescription, camera.sensor_distance_mm - array.principal_mm[0][1])
    if diameter > widest:
        what = (
            f"microlenses of pitch {array.pitch_mm:g} mm, {array.distance_mm:g} mm before the sensor, match a stop of"
        )
        hint = (
            f"within reach: stops of up to {widest:.4g} mm; a larger distance or a smaller pitch matches a smaller one"
        )
        raise CameraError(f"{what} {diameter:.4g} mm, wider than the lens lets through", hint=hint)
    return with_stop(camera, diameter)


def stopped_down(camera: Camera, f_number: float) -> Camera:
    """The camera with its stop set to an F-number of its lens, focus unchanged.

    The F-number is that of camera.json, for objects at infinity: focal length over the diameter of the entrance pupil.
    What the microlenses see is the working F-number at their plane.

    Raises CameraError: the lens does not open so far: the edge of another surface would limit the light on the axis.
    """
    lens = first_order(camera.prescription)
    diameter = lens.f_number / f_number * 2 * camera.prescription.stop.semi_diameter_mm
    ahead = camera.microlenses.principal_mm[0][1] if camera.microlenses else 0.0
    widest = widest_stop_mm(camera.prescription, camera.sensor_distance_mm - ahead)
    if diameter > widest:
        what = f"F/{f_number:g} needs a stop of {diameter:.4g} mm, wider than the lens lets through"
        raise CameraError(what, hint=f"the lens opens to F/{math.ceil(f_number * diameter / widest * 1e3) / 1e3:g}")
    try:
        return with_stop(camera, diameter)
    except PipelineError as error:
        raise CameraError(f"F/{f_number:g} needs a stop of {diameter:.4g} mm: {error.what}") from None


def with_stop(camera: Camera, diameter_mm: float) -> Camera:
    """The camera with another diameter of the circle around its stop."""
    prescription = camera.prescription
    surfaces = list(prescription.surfaces)
    surfaces[prescription.stop_index] = dataclasses.replace(prescription.stop, semi_diameter_mm=diameter_mm / 2)
    return dataclasses.replace(camera, prescription=dataclasses.replace(prescription, surfaces=tuple(surfaces)))


def widest_stop_mm(prescription: Prescription, film_mm: float) -> float:
    """Diameter at the stop of the paraxial cone from the axis of the film that all other surfaces let through."""
    surfaces, heights = prescription.surfaces, [0.0] * len(prescription.surfaces)
    height, slope = film_mm - prescription.vertices_from_stop_mm[-1], 1.0  # slope: times the index
    for i in reversed(range(len(surfaces))):
        heights[i] = height
        in_front = surfaces[i - 1].index if i else 1.0
        slope -= height * surfaces[i].power_per_mm(in_front)
        height += slope * surfaces[i - 1].thickness_mm / in_front if i else 0.0
    at_stop = abs(heights[prescription.stop_index])
    others = [(s, abs(y)) for s, y in zip(surfaces, heights, strict=True) if not s.is_stop and y]
    return 2 * min((s.semi_diameter_mm * at_stop / y for s, y in others), default=math.inf)


def shown_f_number(f_number: float) -> str:
    """An F-number in the name of a file: f8, f2.8."""
    return f"f{f_number!r}".removesuffix(".0")
