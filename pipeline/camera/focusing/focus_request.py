"""Focus as intent: a camera that states its focus, and the camera whose parts are placed to meet it.

Paraxial; positions are vision z [mm]. Either the sensor moves, with the microlens array at a fixed distance in front of
it, or the sensor stays and named groups of the lens move together along the axis. If the sensor moves, distant objects
have their images nearest to the lens, so the last vertex bounds the range. A shift of groups is positive towards the
sensor. It opens the air in front of each moving block of surfaces and closes the air behind it, so travel ends where
surfaces touch within their clear apertures, or where the last vertex meets the sensor. A block with nothing in front of
it travels at most ten focal lengths. The stop is set to an F-number, or matched to the microlenses.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.errors import PipelineError
from pipeline.optics.first_order import FirstOrder, first_order, paraxial_ray
from pipeline.optics.prescription import Prescription, PrescriptionError, least_gap_mm

KEPT = 1024
"""Cameras whose focus a process remembers: three cameras with a state in each of 200 frames are fewer."""
_LONGEST = 10.0
"""Travel of a block with nothing in its way, in focal lengths [1]: longer than any mount."""
_STEPS = 400
"""Equal parts of the travel that are searched for a solution: two within one part would both be missed."""
_BISECTIONS = 100
"""Most bisections of such a part: a double has 53 bits, and the search ends when the bracket has no middle."""


def moved(prescription: Prescription, names: tuple[str, ...], shift_mm: float) -> Prescription:
    """The lens with groups shifted along the axis.

    Raises CameraError: there is no such group, it holds the stop, or it ends within an element.
    """
    surfaces = list(prescription.surfaces)
    for last, sign in _gaps(prescription, names):
        thickness = surfaces[last].thickness_mm + sign * shift_mm
        surfaces[last] = dataclasses.replace(surfaces[last], thickness_mm=thickness)
    return dataclasses.replace(prescription, surfaces=tuple(surfaces))


def travel_mm(prescription: Prescription, names: tuple[str, ...], film_mm: float) -> tuple[float, float]:
    """Least and greatest shift of groups before a plane (sensor or array) `film_mm` behind the stop."""
    forwards = backwards = _LONGEST * abs(first_order(prescription).efl_mm)
    for last, sign in _gaps(prescription, names):
        gap = least_gap_mm(*prescription.surfaces[last : last + 2])
        if sign > 0:
            forwards = min(forwards, gap)
        else:
            backwards = min(backwards, gap)
    if _moving(prescription, names)[-1]:
        backwards = min(backwards, film_mm - prescription.vertices_from_stop_mm[-1])
    return -forwards, backwards


def shift_mm(
    prescription: Prescription, names: tuple[str, ...], film_mm: float, image_mm: float, object_mm: float
) -> float:
    """The smallest shift that images the object at vision z onto the plane `image_mm` behind the stop.

    Raises CameraError: there is none; the hint states the distances within reach.
    """
    low, high = travel_mm(prescription, names, film_mm)

    def miss(shift: float) -> float:
        """Height of the paraxial ray in the image plane after a shift, which is 0 for a solution."""
        return _miss(moved(prescription, names, shift), object_mm, image_mm)

    # Bracket solutions by changes of sign, and bisect.
    shifts = np.linspace(low, high, _STEPS + 1).tolist()
    misses = [miss(shift) for shift in shifts]
    brackets = [
        (a, b) for (a, fa), (b, fb) in pairwise(zip(shifts, misses, strict=True)) if fa == 0 or (fa < 0) != (fb < 0)
    ]
    solutions = [_bisected(miss, a, b) for a, b in brackets]
    if solutions:
        return min(solutions, key=abs)
    moving = f'"{", ".join(names)}" between {low:.4g} and {high:.4g} mm from where it stands'
    raise _out_of_reach(moving, object_mm, *_in_reach(prescription, names, shifts, image_mm))


def _out_of_reach(moving: str, object_mm: float, near_mm: float, far_mm: float) -> CameraError:
    """The error that no position of `moving` focuses an object; nearest and farthest distances that one does focus."""
    distance = f"{object_mm:g} mm from the stop" if math.isfinite(object_mm) else "infinity"
    reach = f"between {near_mm:.6g} and {far_mm:.6g} mm" if math.isfinite(far_mm) else f"beyond {near_mm:.6g} mm"
    hint = "within reach: " + ("no object at all" if math.isinf(near_mm) else f"distances {reach}")
    return CameraError(f"no position of {moving} brings {distance} into focus", hint=hint)


def _gaps(prescription: Prescription, names: tuple[str, ...]) -> Iterator[tuple[int, float]]:
    """Surfaces whose thickness changes, each with the sign of the change."""
    moving = _moving(prescription, names)
    for i, (before, behind) in enumerate(pairwise(moving)):
        if before == behind:
            continue
        if prescription.surfaces[i].is_before_glass:
            raise CameraError(f"between surfaces {i + 1} and {i + 2} there is glass, and only one of them would move")
        yield i, -1.0 if before else 1.0


def _moving(prescription: Prescription, names: tuple[str, ...]) -> list[bool]:
    """Whether each surface moves with these groups; CameraError: there is no such group, or it holds the stop."""
    groups = {group.name: group for group in prescription.groups}
    for name in names:
        if name not in groups:
            hint = f"its groups: {', '.join(groups)}" if groups else "a PlenLensGroup below the lens names surfaces"
            raise CameraError(f'the lens has no group "{name}"', hint=hint)
    members = {i for name in names for i in groups[name].members}
    if prescription.stop_index in members:
        message = "the stop would move with its group, and it is the origin of the camera"
        raise CameraError(message, hint="name the groups before or behind it")
    return [i in members for i in range(len(prescription.surfaces))]


def _miss(lens: Prescription, object_mm: float, image_mm: float) -> float:
    """Height at the image plane of a paraxial ray from the axial object point; 0 if the two are conjugate."""
    vertices = lens.vertices_from_stop_mm
    index = lens.index_in_front
    # Trace a ray of height 1 at the first vertex, also from infinity; from an object in the vertex one of slope 1.
    to_vertex = object_mm + vertices[0]
    height, slope = (1.0, index / to_vertex) if to_vertex else (0.0, 1.0)
    heights, slope = paraxial_ray(lens.surfaces, height, slope, index)
    return heights[-1] + (image_mm - vertices[-1]) * slope


def _bisected(miss: Callable[[float], float], low: float, high: float) -> float:
    """Root of `miss` in a bracket by bisection."""
    at_low = miss(low)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        if (miss(middle) < 0) == (at_low < 0) and at_low != 0:
            low = middle
        else:
            high = middle
    return min((low, high), key=lambda shift: abs(miss(shift)))


def _in_reach(
    prescription: Prescription, names: tuple[str, ...], shifts: list[float], image_mm: float
) -> tuple[float, float]:
    """Nearest and farthest object distances that the groups bring into focus; inf and inf: none."""
    distances = []
    for shift in shifts:
        lens = moved(prescription, names, shift)
        try:
            figures = first_order(lens)
        except PrescriptionError:
            continue  # afocal just there
        # Behind the rear focus the image is that of a real object, before it of one beyond infinity.
        distance = figures.object_mm(-image_mm) if -image_mm < figures.rear_focus_mm else math.inf
        if figures.efl_mm > 0 and distance > -lens.vertices_from_stop_mm[0]:
            distances.append(distance)
    return min(distances, default=math.inf), max(distances, default=math.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusRequest:
    """A camera before it is focused; fields shared with `Camera` have the same meaning."""

    prescription: Prescription
    sensor: Sensor
    microlenses: MicrolensArray | None = None
    circle_of_confusion_px: float = 1.0
    near_mm: float | None = None
    far_mm: float | None = None
    weight: str = "irradiance"
    # Distance from stop to sensor; None: `focus_distance_mm` decides. With `focus_groups` both are given.
    sensor_distance_mm: float | None = None
    focus_distance_mm: float | None = None  # object distance from the stop to be in focus; may be inf
    focus_type: int | None = None  # microlens type that this holds for; None: the one of middle focal length
    # Groups of the lens that move together to meet the focus distance; empty: sensor and array do
    focus_groups: tuple[str, ...] = ()
    # Whether to set the stop so that the exit pupil's image through a microlens vertex is as wide as the MLA pitch
    match_stop: bool = False

    @property
    def type(self) -> int | None:
        """The microlens type to which the focus distance refers; None for a conventional camera."""
        if self.microlenses is None:
            return None
        focal = self.microlenses.focal_lengths_mm
        middle = sorted(range(len(focal)), key=focal.__getitem__)[len(focal) // 2]
        return middle if self.focus_type is None else self.focus_type


@functools.lru_cache(maxsize=KEPT)
def solved(camera: Camera | FocusRequest) -> Camera:
    """The camera that meets a request; a `Camera` is returned as it is. CameraError, with a remedy: none does."""
    if isinstance(camera, Camera):
        return camera
    shared = ("sensor", "microlenses", "circle_of_confusion_px", "near_mm", "far_mm", "weight")
    placed = Camera(
        prescription=moved(camera.prescription, camera.focus_groups, group_shift(camera)),
        sensor_distance_mm=sensor_distance(camera),
        **{name: getattr(camera, name) for name in shared},
    )
    return with_matched_stop(placed) if camera.match_stop else placed


def sensor_distance(request: FocusRequest) -> float:
    """Distance from the stop to the sensor that brings the requested object distance into focus. [mm]"""
    object_mm = request.focus_distance_mm
    if object_mm is None or request.focus_groups:
        if request.sensor_distance_mm is None:
            raise CameraError(
                "neither a sensor distance nor a focus distance is given",
                hint="give one of them; with focus_groups both",
            )
        return request.sensor_distance_mm
    near, far = reachable(request)
    if not (near < object_mm < far or object_mm == far == math.inf):
        raise _out_of_reach("the sensor", object_mm, near, far)
    array = request.microlenses
    film = -first_order(request.prescription).image_mm(object_mm) - _image_behind_film(request)
    return film + (_principal_mm(array, request.type)[1] if array else 0.0)


def group_shift(request: FocusRequest) -> float:
    """Shift of the groups, + towards the sensor, that brings the requested object distance into focus. [mm]"""
    object_mm = request.focus_distance_mm
    if not request.focus_groups or object_mm is None:
        return 0.0
    array = request.microlenses
    film = sensor_distance(request)
    image = film - (_principal_mm(array, request.type)[1] if array else 0.0) + _image_behind_film(request)
    film -= array.reach_mm if array else 0.0
    return shift_mm(request.prescription, request.focus_groups, film, image, object_mm)


def reachable(request: FocusRequest) -> tuple[float, float]:
    """Nearest and farthest object distances that can be brought into focus, both excluded unless inf. [mm]

    The nearest object stands before the lens and its front focus; for the farthest one the sensor, or the array,
    touches the last vertex.
    """
    lens = first_order(request.prescription)
    vertices = request.prescription.vertices_from_stop_mm
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
    if array is None or request.type is None or array.is_unfocused(request.sensor.pitch_mm):
        return 0.0
    behind_mm = _principal_mm(array, request.type)[0]
    return behind_mm / (1 - behind_mm / array.focal_lengths_mm[request.type])


def _principal_mm(array: MicrolensArray, kind: int | None) -> tuple[float, float]:
    """Rear and front principal plane of a microlens type before the sensor. [mm]"""
    return array.principal_mm[kind or 0]


def matched_stop_mm(lens: FirstOrder, array: MicrolensArray, sensor_distance_mm: float) -> float:
    """Stop diameter that images the exit pupil through a microlens vertex to the width of the MLA pitch. [mm]

    For microlenses with faces, the vertex is that of the principal planes of type 0.
    """
    behind_mm, ahead_mm = array.principal_mm[0]
    to_array = lens.exit_pupil.z_mm + sensor_distance_mm - ahead_mm
    return to_array / behind_mm * array.pitch_mm / abs(lens.exit_pupil.magnification)


def with_matched_stop(camera: Camera) -> Camera:
    """The camera with its stop matched to its microlenses; CameraError: another surface limits the light."""
    array, prescription = camera.microlenses, camera.prescription
    if array is None:
        raise CameraError("a camera without microlenses has no stop that matches them", hint="match_stop=False")
    diameter = matched_stop_mm(first_order(prescription), array, camera.sensor_distance_mm)
    widest = widest_stop_mm(prescription, camera.sensor_distance_mm - array.principal_mm[0][1])
    if diameter > widest:
        message = (
            f"microlenses of pitch {array.pitch_mm:g} mm, {array.distance_mm:g} mm before the sensor, match a stop of"
        )
        hint = (
            f"within reach: stops of up to {widest:.4g} mm; a larger distance or a smaller pitch matches a smaller one"
        )
        raise CameraError(f"{message} {diameter:.4g} mm, wider than the lens lets through", hint=hint)
    return with_stop(camera, diameter)


def stopped_down(camera: Camera, f_number: float) -> Camera:
    """The camera with its stop set to an F-number, focus unchanged.

    The F-number is that of camera.json, for objects at infinity: focal length over the diameter of the entrance pupil.
    The light at the microlenses is limited by the working F-number at their plane.

    Raises CameraError: the lens is not that fast: the edge of another surface would limit the light on the axis.
    """
    lens = first_order(camera.prescription)
    if lens.entrance_pupil.is_infinite:
        raise CameraError(
            f"a telecentric lens has no F/{f_number:g}: its entrance pupil is at infinity",
            hint="set its stop by plen:semiDiameter; camera.json states the working F-number",
        )
    diameter = lens.f_number / f_number * 2 * camera.prescription.stop.semi_diameter_mm
    ahead = camera.microlenses.principal_mm[0][1] if camera.microlenses else 0.0
    widest = widest_stop_mm(camera.prescription, camera.sensor_distance_mm - ahead)
    if diameter > widest:
        message = f"F/{f_number:g} needs a stop of {diameter:.4g} mm, wider than the lens lets through"
        raise CameraError(message, hint=f"the lens opens to F/{math.ceil(f_number * diameter / widest * 1e3) / 1e3:g}")
    try:
        return with_stop(camera, diameter)
    except PipelineError as error:
        raise CameraError(f"F/{f_number:g} needs a stop of {diameter:.4g} mm: {error.message}") from None


def with_stop(camera: Camera, diameter_mm: float) -> Camera:
    """The camera with another diameter of the circle around its stop."""
    prescription = camera.prescription
    surfaces = list(prescription.surfaces)
    surfaces[prescription.stop_index] = dataclasses.replace(prescription.stop, semi_diameter_mm=diameter_mm / 2)
    return dataclasses.replace(camera, prescription=dataclasses.replace(prescription, surfaces=tuple(surfaces)))


def widest_stop_mm(prescription: Prescription, film_mm: float) -> float:
    """Diameter at the stop of the widest paraxial cone from the axis of the film that all other surfaces pass."""
    # Trace the marginal ray of slope 1 backwards: slope times index. Its height at each rim bounds the cone.
    surfaces = prescription.surfaces
    heights = [0.0] * len(prescription.surfaces)
    height = film_mm - prescription.vertices_from_stop_mm[-1]
    slope = 1.0
    for i in reversed(range(len(surfaces))):
        heights[i] = height
        in_front = surfaces[i - 1].index if i else 1.0
        slope -= height * surfaces[i].power_per_mm(in_front)
        height += slope * surfaces[i - 1].thickness_mm / in_front if i else 0.0
    at_stop = abs(heights[prescription.stop_index])
    rims = [(s, abs(y)) for s, y in zip(surfaces, heights, strict=True) if not s.is_stop and y]
    return 2 * min((s.semi_diameter_mm * at_stop / y for s, y in rims), default=math.inf)


def f_number_in_name(f_number: float) -> str:
    """An F-number in the name of a file: f8, f2.8."""
    return f"f{f_number!r}".removesuffix(".0")
