"""Design of a plenoptic camera from its requirements: positions of array and sensor, pitch, focal lengths, stop.

Paraxial and in closed form; `plugins.design.judgement` judges by real rays. The scheme is that of Michels and Koch,
"Ray Tracing-Guided Design of Plenoptic Cameras" (2022, arXiv 2203.04660): main lens and sensor are given, the rest
follows from the required depth of field. Lengths count along the axis: T from exit pupil to array, B from array to
sensor, d from exit pupil to the main lens's image of an object, a = d - T from the array to it.

- Micro-images touch where F-numbers match, P / B = D / T, with the exit pupil D (Ng et al., "Light Field Photography
  with a Hand-held Plenoptic Camera", 2005). The image of the pupil through a vertex is then as wide as the pitch P, so
  that P = n p for n pixels p; centres are P (1 + B / T) apart, which leaves a gap of P B / T.
- Blur behind a microlens is P |1 - B / f - B / a| (Perwass and Wietzke, 2012), at most c pixels while the vergence B /
  a is within c / n of 1 - B / f. N types whose ranges join reach over 2 N c / n of vergence, from B / a of the near end
  to that of the far end. The virtual depth v = a / B is least at the far end; a point has about v^2 micro-images.
- An unfocused camera has f = B. A view of one pixel has a pupil of p T / B, whose blur p T |a| / (B d) on the array is
  at most c P while d is between T^2 / (T + B n c) and T^2 / (T - B n c): T is the harmonic mean of both.
- Views that move by S microlenses per pixel meet at d = T / (1 + S P B / (p T)): Michels, Maeckelmann and Koch, "Mind
  the Exit Pupil Gap", 2024, arXiv 2402.12891; Hahne et al., "Refocusing distance of a standard plenoptic camera", 2016.
"""

import dataclasses
import math
from dataclasses import dataclass

from pipeline.camera.focusing.depth_of_field import foci
from pipeline.camera.focusing.focus_request import widest_stop_mm, with_stop
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.optics.first_order import FirstOrder, first_order
from pipeline.optics.prescription import Prescription

LEAST_DEPTH = 2.0
"""Least virtual depth from which every point has two micro-images along each axis (Perwass and Wietzke 2012)."""
_SIGNIFICANT = 9
"""Significant digits of designed lengths, as a stage states them: the judged camera is the written one."""

_JOINED = 1 - 1e-6
"""Separation of adjacent ranges over that at which they just touch [1]: rounding leaves no gap between types."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlenopticWish:
    """Demands on a plenoptic camera: a depth range, or a magnification in its middle."""

    # From the stop; far may be inf. None: `magnification` decides
    near_mm: float | None = None
    far_mm: float | None = None
    magnification: float | None = None  # of the main lens, counted positive
    types: int = 3  # focal lengths of microlenses, 1 or 3
    unfocused: bool = False  # microlenses as far from the sensor as their focal length: plenoptic 1.0
    image_px: float = 20.0  # diameter of a micro-image
    layout: str = "hexagonal"
    f_number: float | None = None  # for objects at infinity; None: what follows
    virtual_depth: float | None = None  # the least one; None: what follows from the F-number, or else 2
    blur_px: float = 1.0  # circle of confusion

    @property
    def step(self) -> float:
        """Half the vergence over which a type is sharp."""
        return _JOINED * self.blur_px / self.image_px


@dataclass(frozen=True, slots=True, kw_only=True)
class PlenopticDesign:
    """A designed camera and the performance that formulas promise. Ranges are vision z [mm]; the far end may be inf."""

    camera: Camera
    f_number: float
    depth_of_field_mm: tuple[tuple[float, float], ...]  # per type; of an unfocused camera one, that of its views
    virtual_depths: tuple[float, float] | None  # least and greatest; None of an unfocused camera
    gap_px: float  # between micro-images

    @property
    def array(self) -> MicrolensArray:
        """The microlenses of the camera."""
        assert self.camera.microlenses is not None
        return self.camera.microlenses

    @property
    def range_mm(self) -> tuple[float, float]:
        """The union of the ranges of all types."""
        nears, fars = zip(*self.depth_of_field_mm, strict=True)
        return min(nears), max(fars)

    def airy_px(self, wavelength_nm: float) -> float:
        """Diameter of the first dark ring behind a microlens, 2.44 wavelengths times its F-number B / P."""
        ring_mm = 2.44e-6 * wavelength_nm * self.array.distance_mm / self.array.pitch_mm
        return ring_mm / self.camera.sensor.pitch_mm


@dataclass(frozen=True, slots=True)
class _Solution:
    """Distances along the axis and pupil [mm]; `vergence` is B / a of the far end, 0 for an unfocused camera."""

    to_array: float
    gap: float
    pupil: float
    vergence: float


def designed(prescription: Prescription, sensor: Sensor, wish: PlenopticWish) -> PlenopticDesign:
    """Design a camera; CameraError: demands contradict each other, or none meets them; the hint states a remedy."""
    _check(wish)
    lens = first_order(prescription)
    solution = (_unfocused if wish.unfocused else _focused)(lens, wish.image_px * sensor.pitch_mm, wish)
    film_mm = solution.to_array - lens.exit_pupil.z_mm
    if film_mm <= prescription.vertices_from_stop_mm[-1]:
        raise CameraError(
            f"the microlenses would stand {film_mm:.4g} mm behind the stop, inside the lens",
            hint="--near farther from the lens, a smaller --magnification, or more --types or --blur",
        )
    stop_mm = solution.pupil / abs(lens.exit_pupil.magnification)
    widest_mm = widest_stop_mm(prescription, film_mm)
    if stop_mm > widest_mm:
        raise _too_wide(lens, wish, stop_mm / widest_mm, 2 * prescription.stop.semi_diameter_mm / widest_mm)
    pitch_mm = _rounded(wish.image_px * sensor.pitch_mm)
    width_mm, height_mm = (_rounded(size + 2 * pitch_mm) for size in sensor.size_mm)
    gap_mm = _rounded(solution.gap)
    array = MicrolensArray(
        pitch_mm=pitch_mm,
        focal_lengths_mm=tuple(gap_mm if wish.unfocused else f for f in _focal_lengths(solution, wish)),
        width_mm=width_mm,
        height_mm=height_mm,
        distance_mm=gap_mm,
        layout=wish.layout,
    )
    camera = Camera(
        prescription=prescription,
        sensor=sensor,
        sensor_distance_mm=_rounded(film_mm + solution.gap),
        microlenses=array,
        circle_of_confusion_px=wish.blur_px,
    )
    camera = with_stop(camera, _rounded(stop_mm))
    depths = None
    if not wish.unfocused:
        depths = 1 / solution.vergence, 1 / (solution.vergence - 2 * wish.types * wish.step)
    return PlenopticDesign(
        camera=camera,
        f_number=first_order(camera.prescription).f_number,
        depth_of_field_mm=tuple(focus.depth_of_field_mm for focus in foci(camera)),
        virtual_depths=depths,
        gap_px=wish.image_px * solution.gap / solution.to_array,
    )


def refocused_mm(lens: FirstOrder, camera: Camera, shift: float) -> float:
    """Vision z of the plane in focus where views move by `shift` microlenses per pixel; inf: infinity or beyond.

    A view moves with its pixel: right in the micro-image, right in the picture of vertices upright as the image.
    """
    array = camera.microlenses
    assert array is not None
    to_array = lens.exit_pupil.z_mm + camera.sensor_distance_mm - array.distance_mm
    ratio = shift * array.pitch_mm * array.distance_mm / (camera.sensor.pitch_mm * to_array)
    return _object(lens, to_array / (1 + ratio)) if ratio > -1 else math.inf


def _too_wide(lens: FirstOrder, wish: PlenopticWish, excess: float, as_it_is: float) -> CameraError:
    """Error about a stop `excess` times as wide as the lens transmits, and its own `as_it_is` times."""
    widest = math.ceil(1000 * lens.f_number * as_it_is) / 1000
    message = f"micro-images of {wish.image_px:g} px would need F/{lens.f_number * as_it_is / excess:.3g}"
    if wish.f_number is not None or wish.magnification is not None:
        hint = f"--f-number {widest:g} or more"
    elif wish.unfocused:  # the pupil grows as the square of their number
        hint = f"at most {_down(wish.image_px / math.sqrt(excess))} px per micro-image, a deeper range, or less --blur"
    else:
        hint = "a deeper range, or less --blur, --virtual-depth or --types"
    return CameraError(f"{message}; the lens opens to F/{widest:g}", hint=hint)


def _check(wish: PlenopticWish) -> None:
    """CameraError for demands that contradict each other, whatever the lens."""
    has_range = wish.near_mm is not None and wish.far_mm is not None
    if (wish.near_mm is None) != (wish.far_mm is None) or has_range == (wish.magnification is not None):
        raise CameraError(
            "a design has a depth range or a magnification", hint="give --near and --far, or --magnification"
        )
    if wish.near_mm is not None and wish.far_mm is not None and not wish.near_mm < wish.far_mm:
        raise CameraError(
            f"a depth range from {wish.near_mm:g} to {wish.far_mm:g} mm", hint="--near is less than --far"
        )
    if wish.types not in (1, 3) or (wish.unfocused and wish.types != 1):
        raise CameraError(f"{wish.types} types of microlenses", hint="--types 1 or 3; unfocused microlenses have one")
    if wish.types == 3 and wish.layout == "square":
        raise CameraError("three types on squares have no arrangement", hint="--layout hexagonal, or --types 1")
    if wish.virtual_depth is not None and (wish.unfocused or (has_range and wish.f_number is not None)):
        message = "microlenses at their focal length have" if wish.unfocused else "a range and an F-number leave"
        raise CameraError(f"{message} no virtual depth to choose", hint="leave out --virtual-depth, or --f-number")
    if wish.unfocused and has_range and wish.f_number is not None:
        raise CameraError("the range of an unfocused camera decides its F-number", hint="leave out --f-number")


def _focused(lens: FirstOrder, pitch: float, wish: PlenopticWish) -> _Solution:
    """Solve P / B = D / T for a focused camera whose types reach over `span` of vergence B / a from its far end on, by
    the magnification in the middle, or by the range and either the least virtual depth or the F-number.
    """
    span = 2 * wish.types * wish.step
    depth = LEAST_DEPTH if wish.virtual_depth is None else wish.virtual_depth
    if 1 / depth <= span:
        raise CameraError(
            f"from virtual depth {depth:g} on, {wish.types} focal lengths and a blur of {wish.blur_px:g} px reach"
            " beyond infinity",
            hint=f"more than {2 * wish.types * wish.blur_px * depth:.3g} px per micro-image, or --blur below"
            f" {wish.image_px / (2 * wish.types * depth):.3g}",
        )
    if wish.near_mm is None or wish.far_mm is None:
        pupil = _pupil(lens, wish.f_number)
        middle = 1 / depth - span / 2
        to_array = _magnified(lens, wish) / (1 + pitch / (pupil * middle))
        return _Solution(to_array, pitch * to_array / pupil, pupil, 1 / depth)
    to_near, to_far = _image(lens, wish.near_mm), _image(lens, wish.far_mm)
    image_depth = to_near - to_far
    if wish.f_number is None:  # B / a is 1 / depth at the far end, and the span less at the near one
        gap = image_depth / (1 / (1 / depth - span) - depth)
        return _Solution(to_far - depth * gap, gap, pitch * (to_far - depth * gap) / gap, 1 / depth)
    # B deep = span a (a + deep) and B = P (to_far - a) / D: a of the far end is the positive root.
    pupil = _pupil(lens, wish.f_number)
    linear = image_depth * (span + pitch / pupil)
    constant = pitch * image_depth * to_far / pupil
    a = (math.sqrt(linear**2 + 4 * span * constant) - linear) / (2 * span)
    gap = pitch * (to_far - a) / pupil
    if a < LEAST_DEPTH * gap:
        least = _focused(lens, pitch, dataclasses.replace(wish, f_number=None))
        raise CameraError(
            f"at F/{wish.f_number:g} the far end has virtual depth {a / gap:.3g}: from less than {LEAST_DEPTH:g} on"
            " some points have one micro-image",
            hint=f"--f-number up to {_down(wish.f_number * pupil / least.pupil)}, or a deeper range",
        )
    return _Solution(to_far - a, gap, pupil, gap / a)


def _unfocused(lens: FirstOrder, pitch: float, wish: PlenopticWish) -> _Solution:
    """Solve P / B = D / T for microlenses at their focal length, by the magnification or the range of their views."""
    if wish.near_mm is None or wish.far_mm is None:
        pupil = _pupil(lens, wish.f_number)
        to_array = _magnified(lens, wish)
        return _Solution(to_array, pitch * to_array / pupil, pupil, 0.0)
    to_near, to_far = _image(lens, wish.near_mm), _image(lens, wish.far_mm)
    to_array = 2 / (1 / to_near + 1 / to_far)
    gap = to_array * (1 - to_array / to_near) / (wish.image_px * wish.blur_px)
    return _Solution(to_array, gap, pitch * to_array / gap, 0.0)


def _focal_lengths(solution: _Solution, wish: PlenopticWish) -> list[float]:
    """f of each type, ascending: the shortest one sees the near end, whose image has the least vergence."""
    sharp = [solution.vergence - wish.step * (2 * kind + 1) for kind in reversed(range(wish.types))]
    return [_rounded(solution.gap / (1 - vergence)) for vergence in sharp]


def _pupil(lens: FirstOrder, f_number: float | None) -> float:
    """Diameter of the exit pupil at an F-number, or of the lens as it is."""
    if lens.entrance_pupil.is_infinite:
        raise CameraError("a telecentric lens has no F-number at infinity", hint="give --near and --far alone")
    return lens.exit_pupil.diameter_mm * (1.0 if f_number is None else lens.f_number / f_number)


def _magnified(lens: FirstOrder, wish: PlenopticWish) -> float:
    """Distance from the exit pupil to the image at this magnification."""
    assert wish.magnification is not None
    return lens.exit_pupil.z_mm - lens.rear_focus_mm + wish.magnification * lens.efl_mm


def _image(lens: FirstOrder, object_mm: float) -> float:
    """Distance from the exit pupil to the real image of an object at vision z."""
    if object_mm <= lens.front_focus_mm:
        raise CameraError(
            f"{object_mm:g} mm before the stop nothing has a real image",
            hint=f"--near beyond the front focus, {lens.front_focus_mm:.4g} mm",
        )
    return lens.exit_pupil.z_mm - (lens.rear_focus_mm if math.isinf(object_mm) else lens.image_mm(object_mm))


def _object(lens: FirstOrder, behind_pupil_mm: float) -> float:
    """Vision z of the object whose image lies this far behind the exit pupil; inf: infinity or beyond."""
    image_mm = lens.exit_pupil.z_mm - behind_pupil_mm
    return lens.object_mm(image_mm) if image_mm < lens.rear_focus_mm else math.inf


def _rounded(length_mm: float) -> float:
    return float(f"{length_mm:.{_SIGNIFICANT}g}")


def _down(value: float) -> str:
    """A bound rounded inwards to three digits."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{math.floor(value / scale) * scale:.3g}"
