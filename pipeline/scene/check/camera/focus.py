"""Checks of the requested focus of a camera: whether it can be reached, and what its microlenses then see sharply."""

from collections import Counter
from collections.abc import Iterator

from pxr import Usd

from pipeline.camera.figures.first_order_figures import gaps_mm
from pipeline.camera.focusing.depth_of_field import foci, focused
from pipeline.camera.focusing.focus_request import FocusRequest, group_shift, sensor_distance, solved, stopped_down
from pipeline.camera.focusing.ideal_lens import PINHOLE
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.errors import PipelineError
from pipeline.scene.read.prims import lens_groups, read_camera
from pipeline.scene.usd.hints import of_reader
from pipeline.scene.usd.problems import Problem, did_you_mean
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import read, target

_SENSOR, _FOCUS = "plen:camera:sensorDistance", "plen:camera:focusDistance"
_GROUPS = "plen:camera:focusGroups"
_TYPE, _MATCH = "plen:camera:focusType", "plen:camera:stopMatch"
_MODEL, _DISTORTION = "plen:camera:model", "plen:camera:distortion"
_F_NUMBERS = "plen:image:fNumbers"


def check_request(camera: Usd.Prim) -> Iterator[Problem]:
    """Attributes of a Camera with PlenCameraAPI that contradict each other, its lens or its microlenses."""
    sensor, focus = camera.GetAttribute(_SENSOR), camera.GetAttribute(_FOCUS)
    if read(camera, _GROUPS):
        yield from _check_groups(camera)
    elif sensor.HasAuthoredValue() and focus.HasAuthoredValue():
        message = f'"{_SENSOR}" and "{_FOCUS}" both state the position of the sensor'
        yield problem(focus, "two-distances", message, hint=f"keep one; to drop the other write {_SENSOR} = None")
    elif not (sensor.HasAuthoredValue() or focus.HasAuthoredValue()):
        message = f'{camera.GetTypeName()} needs "{_SENSOR}" or "{_FOCUS}"'
        yield problem(camera, "missing-value", message, hint="it has no fallback: write it")
    array = target(camera, "plen:camera:microlenses", "PlenMicrolensArray")
    is_refractive = array and read(array, "plen:model") == "refractive"
    by_type = "plen:frontRadii" if is_refractive else "plen:focalLengths"
    focal_lengths, number = read(array, by_type) if array else None, read(camera, _TYPE)
    if focal_lengths and number is not None and number >= len(focal_lengths):
        message = f'"{_TYPE}" = {number}, but the array has {len(focal_lengths)} types, counted from 0'
        yield problem(camera.GetAttribute(_TYPE), "focus-type", message)


def _check_groups(camera: Usd.Prim) -> Iterator[Problem]:
    """Problems of focusing groups that the lens does not have."""
    lens = target(camera, "plen:camera:lens", "PlenLens")
    known = [group.GetName() for group in lens_groups(lens)] if lens else []
    for name in (read(camera, _GROUPS) or ()) if lens else ():
        if name not in known:
            hint = did_you_mean(name, known) or f"its groups: {', '.join(known) or 'none'}"
            yield problem(
                camera.GetAttribute(_GROUPS), "focus-groups", f'"{name}" is no PlenLensGroup of the lens', hint=hint
            )


def check_focus(camera: Usd.Prim) -> Iterator[Problem]:
    """A focus out of reach; then warnings about what the microlenses see."""
    if not target(camera, "plen:camera:sensor", "PlenSensor"):
        return
    try:
        record = read_camera(camera)
    except PipelineError as error:
        yield of_reader(camera.GetAttribute(_DISTORTION) if error.code == "distortion" else camera, error)
        return
    both = all(camera.GetAttribute(name).HasAuthoredValue() for name in (_SENSOR, _FOCUS))
    if both != bool(read(camera, _GROUPS)):
        return
    if any(_check_groups(camera)) or _bad_type(record):
        return
    found = _out_of_reach(record)
    if found:
        name, reason = found
        yield problem(camera.GetAttribute(name), "out-of-reach", reason.what, hint=reason.hint)
        return
    try:
        yield from _check_f_numbers(camera, solved(record))
        yield from _check_microlenses(camera, solved(record))
    except (PipelineError, ArithmeticError) as error:
        yield of_reader(camera, error)


def _bad_type(record: Camera | FocusRequest) -> bool:
    if not isinstance(record, FocusRequest) or record.microlenses is None:
        return False
    return (record.focus_type or 0) not in range(len(record.microlenses.focal_lengths_mm))


def _out_of_reach(record: Camera | FocusRequest) -> tuple[str, CameraError] | None:
    """The attribute that asks for too much, and the error."""
    name = _FOCUS
    try:
        if isinstance(record, FocusRequest):
            sensor_distance(record)
            name = _GROUPS if record.focus_groups else _FOCUS
            group_shift(record)
            name = _MATCH
            if record.microlenses:
                solved(record)
    except CameraError as error:
        return name, error
    except ArithmeticError:
        return name, CameraError("the lens has no first-order figures: it bends no light")
    return None


def check_planes(camera: Usd.Prim) -> Iterator[Problem]:
    """A problem of a camera without errors: no near and far planes can be derived from its focus."""
    try:
        focused(read_camera(camera))
    except CameraError as error:
        name = _FOCUS if camera.GetAttribute(_FOCUS).HasAuthoredValue() else _SENSOR
        yield problem(camera.GetAttribute(name), "near-far", error.what, hint=error.hint)
    except (PipelineError, ArithmeticError) as error:
        yield of_reader(camera, error)


def _check_f_numbers(camera: Usd.Prim, record: Camera) -> Iterator[Problem]:
    """Problems of F-numbers of white images that are stated twice, or for which the lens cannot open far enough."""
    attribute, f_numbers = camera.GetAttribute(_F_NUMBERS), read(camera, _F_NUMBERS) or ()
    if f_numbers and read(camera, _MODEL) == PINHOLE:
        message = f'"{_F_NUMBERS}" asks a pinhole to open to F/{f_numbers[0]:g}'
        yield problem(attribute, "out-of-reach", message, hint=f'write {_MODEL} = "thinLens", or no F-numbers')
        return
    for f_number in dict.fromkeys(f_numbers):
        try:
            stopped_down(record, f_number)
        except CameraError as error:
            yield problem(attribute, "out-of-reach", error.what, hint=error.hint)
    repeated = [f_number for f_number, count in Counter(f_numbers).items() if count > 1]
    if repeated:
        message = f'"{_F_NUMBERS}" lists F/{repeated[0]:g} more than once'
        yield problem(attribute, "repeated-f-number", message)


def _check_microlenses(camera: Usd.Prim, record: Camera) -> Iterator[Problem]:
    """Warnings about the microlens types of a camera, compared with each other."""
    array = record.microlenses
    if array is None or len(array.focal_lengths_mm) < 2:
        return
    prim = target(camera, "plen:camera:microlenses", "PlenMicrolensArray")
    attribute = prim.GetAttribute("plen:frontRadii" if array.model == "refractive" else "plen:focalLengths")
    if mixed := _mixed(array):
        yield problem(attribute, "mixed-microlenses", mixed, severity="warning")
    for near, far in gaps_mm([focus.depth_of_field_mm for focus in foci(record)]):
        circle = f"circle of confusion {record.circle_of_confusion_px:g} px"
        message = (
            f"no microlens type of this camera is sharp from {near:.1f} to {far:.1f} mm before the stop ({circle})"
        )
        hint = "bring the focal lengths closer together, or allow a larger plen:camera:circleOfConfusion"
        yield problem(camera, "depth-gap", message, hint=hint, severity="warning")


def _mixed(array: MicrolensArray) -> str | None:
    placed = list(zip(array.focal_lengths_mm, array.principal_mm, strict=True))
    longer = [focal for focal, (behind_mm, _) in placed if focal > behind_mm]
    others = [focal for focal, (behind_mm, _) in placed if focal <= behind_mm]
    if not longer or not others:
        return None
    galilean, keplerian = (", ".join(f"{focal:g}" for focal in group) for group in (longer, others))
    return (
        f"{array.distance_mm:g} mm before the sensor, microlenses of f = {galilean} mm are Galilean and those of"
        f" {keplerian} mm are not: they look at images on opposite sides of the array"
    )
