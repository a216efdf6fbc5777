"""Reader and checks of a camera: its parts must fit together, and its focus must be in reach."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from pxr import Usd

from pipeline.camera.figures.first_order_figures import gaps_mm
from pipeline.camera.focusing.depth_of_field import foci, focused
from pipeline.camera.focusing.focus_request import FocusRequest, group_shift, sensor_distance, solved, stopped_down
from pipeline.camera.focusing.ideal_lens import PINHOLE, PRESCRIPTION, with_ideal_lens
from pipeline.camera.parts.camera import REPLICAS, Camera, Sampling
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.from_stop import pupil_fan
from pipeline.errors import PipelineError
from pipeline.optics.prescription import Prescription
from pipeline.scene.channels import check_channels, check_formulas, check_wavelength, illuminant_of, read_channels
from pipeline.scene.dataset import CameraEntry
from pipeline.scene.lens import index_source, lens_groups, read_prescription
from pipeline.scene.microlenses import (
    attribute_per_type,
    check_microlens_glass,
    check_near_microlenses,
    read_microlenses,
)
from pipeline.scene.sensor import (
    check_exposure,
    has_response,
    read_colorimetry,
    read_irradiation,
    read_response,
    read_sensor,
)
from pipeline.scene.shutters import check_shutter, read_shutter
from pipeline.scene.temperature import growth_of, mount_growth, scaled_array
from pipeline.scene.usd.poses import camera_name
from pipeline.scene.usd.problems import Problem, of_reader, problem, warning, written_at
from pipeline.scene.usd.readers import read_once
from pipeline.scene.usd.values import fields_of, need, read, target, target_paths
from pipeline.scene.windows import behind_fixed, check_windows
from pipeline.spelling import did_you_mean
from pipeline.truth.settings import TruthSettings

_MODELS = {"pinhole": "a pinhole", "thinLens": "a thin lens"}
"""Models of a lens in words, by the value of `plen:camera:model`."""

_SENSOR, _FOCUS = "plen:camera:sensorDistance", "plen:camera:focusDistance"
_GROUPS = "plen:camera:focusGroups"
_TYPE, _MATCH = "plen:camera:focusType", "plen:camera:stopMatch"
_MODEL, _DISTORTION = "plen:camera:model", "plen:camera:distortion"
_F_NUMBERS = "plen:image:fNumbers"


@read_once
def read_camera_entry(prim: Usd.Prim, root: Usd.Prim, seed: int) -> CameraEntry:
    """The entry of a Camera with PlenCameraAPI, named relative to a root; `seed` is that of the dataset."""
    lens = target(prim, "plen:camera:lens", "PlenLens")
    sensor = target(prim, "plen:camera:sensor", "PlenSensor")
    name = need(lens, "plen:name") or lens.GetName()
    model = need(prim, _MODEL)
    file, line = written_at(prim)
    return CameraEntry(
        name=camera_name(prim, root),
        prim_path=str(prim.GetPath()),
        lens_name=name if model == PRESCRIPTION else f"{name}, as {_MODELS[model]}",
        index_source=index_source(lens),
        asked=read_camera(prim),
        sampling=Sampling(seed=seed, **fields_of(prim, Sampling)),
        truth=TruthSettings(**fields_of(prim, TruthSettings)),
        labels=tuple(sorted(set(need(prim, "plen:image:labels")))),
        channels=read_channels(prim),
        colorimetry=read_colorimetry(sensor, illuminant_of(prim)),
        response=read_response(sensor) if has_response(sensor) else None,
        irradiation=read_irradiation(prim),
        shutter=read_shutter(prim),
        file=file,
        line=line,
        **fields_of(prim, CameraEntry),
    )


def read_camera(prim: Usd.Prim) -> Camera | FocusRequest:
    """The record of a Camera with its lens model; a request if it asks for a focus or a matched stop."""
    without_windows = with_ideal_lens(_read_camera(prim), need(prim, _MODEL), need(prim, _DISTORTION))
    return replace(without_windows, prescription=behind_fixed(prim, without_windows.prescription))


@read_once
def _read_camera(prim: Usd.Prim) -> Camera | FocusRequest:
    """The record with the prescribed lens, without windows."""
    lens = target(prim, "plen:camera:lens", "PlenLens")
    sensor_prim = target(prim, "plen:camera:sensor", "PlenSensor")
    array = target(prim, "plen:camera:microlenses", "PlenMicrolensArray")
    light_nm = need(prim, "plen:camera:wavelength")
    # Read the parts, with their lengths at the temperature of the lens.
    sensor = read_sensor(sensor_prim)
    microlenses = read_microlenses(array, need(prim, "plen:camera:microlensDistance"), light_nm) if array else None
    parts: dict[str, Any] = {
        "prescription": read_prescription(lens, light_nm),
        "sensor": replace(sensor, pitch_mm=sensor.pitch_mm * growth_of(sensor_prim, lens)),
        "microlenses": microlenses and scaled_array(microlenses, growth_of(array, lens)),
        **fields_of(prim, Camera),
    }
    # Without a focus distance or a matched stop the sensor distance settles the camera.
    growth = mount_growth(lens)
    focus_mm = read(prim, _FOCUS)
    match_stop = need(prim, _MATCH) != "none"
    if focus_mm is None and not match_stop:
        return Camera(sensor_distance_mm=need(prim, _SENSOR) * growth, **parts)
    groups = need(prim, _GROUPS)
    return FocusRequest(
        sensor_distance_mm=need(prim, _SENSOR) * growth if focus_mm is None or groups else None,
        focus_distance_mm=focus_mm,
        focus_type=read(prim, _TYPE),
        focus_groups=groups,
        match_stop=match_stop,
        **parts,
    )


def check_camera(camera: Usd.Prim) -> Iterator[Problem]:
    """Problems of a Camera with PlenCameraAPI as a whole."""
    for name in ("plen:camera:lens", "plen:camera:sensor", "plen:camera:microlenses"):
        relationship = camera.GetRelationship(name)
        count = len(target_paths(relationship))
        if count > 1:
            yield problem(relationship, "several-targets", f'"{name}" has {count} targets, a camera has one')
    for name in ("plen:truth:samples", "plen:image:samples"):
        yield from _check_samples(camera, name)
    yield from check_shutter(camera)
    contradictions = list(_check_request(camera))
    yield from contradictions
    lens = target(camera, "plen:camera:lens", "PlenLens")
    if lens:
        yield from check_wavelength(camera, lens)
        yield from check_formulas(camera, lens)
        yield from check_channels(camera, lens)
    if sensor := target(camera, "plen:camera:sensor", "PlenSensor"):
        yield from check_exposure(camera, sensor)
    if array := target(camera, "plen:camera:microlenses", "PlenMicrolensArray"):
        yield from check_microlens_glass(camera, array)
        yield from check_near_microlenses(camera, array)
    yield from check_windows(camera)
    try:
        prescription = read_prescription(lens, read(camera, "plen:camera:wavelength")) if lens else None
    except PipelineError as error:
        yield of_reader(camera, error)
        return
    if prescription:
        yield from _check_behind_lens(camera, prescription)
        yield from _check_near_far(camera, prescription)
        if sensor:
            yield from _check_focus(camera, not contradictions)


def _check_samples(camera: Usd.Prim, name: str) -> Iterator[Problem]:
    """A problem of a number of samples that is not a power of two in each replica."""
    samples = read(camera, name)
    if not isinstance(samples, int) or samples < REPLICAS:
        return
    per_replica, rest = divmod(samples, REPLICAS)
    if rest or per_replica & (per_replica - 1):
        power = REPLICAS * 2 ** (per_replica.bit_length() - 1)
        message = f'"{name}" = {samples} is not {REPLICAS} times a power of two'
        yield problem(camera.GetAttribute(name), "samples", message, hint=f"take {power} or {2 * power}")


def _check_behind_lens(camera: Usd.Prim, prescription: Prescription) -> Iterator[Problem]:
    """A problem of a sensor, or a microlens array, within the lens."""
    sensor_mm = read(camera, _SENSOR)
    if sensor_mm is None:
        return
    last_mm = prescription.vertices_from_stop_mm[-1]
    array_mm = sensor_mm - (read(camera, "plen:camera:microlensDistance") or 0.0)
    if array_mm <= last_mm:
        is_sensor = sensor_mm <= last_mm
        part, behind_mm = ("sensor", sensor_mm) if is_sensor else ("microlens array", array_mm)
        message = (
            f"the {part} is {behind_mm:.6g} mm behind the stop, inside the lens, whose last vertex is"
            f" {last_mm:.6g} mm behind it"
        )
        attribute = camera.GetAttribute(_SENSOR if is_sensor else "plen:camera:microlensDistance")
        yield problem(attribute, "inside-lens", message)


def _check_near_far(camera: Usd.Prim, prescription: Prescription) -> Iterator[Problem]:
    """Problems of the near and the far plane: in the wrong order, or within the lens."""
    near_mm, far_mm = read(camera, "plen:camera:near"), read(camera, "plen:camera:far")
    first_mm = -prescription.vertices_from_stop_mm[0]
    if near_mm is not None and far_mm is not None and not near_mm < far_mm:
        message = f"the near plane ({near_mm:g} mm) is not nearer than the far plane ({far_mm:g} mm)"
        yield problem(camera.GetAttribute("plen:camera:near"), "near-far", message)
    for name, plane_mm in (("plen:camera:near", near_mm), ("plen:camera:far", far_mm)):
        if plane_mm is not None and plane_mm <= first_mm:
            inside = f"inside the lens, whose first vertex is {first_mm:g} mm before the stop"
            yield problem(camera.GetAttribute(name), "inside-lens", f'"{name}" = {plane_mm:g} mm lies {inside}')


def _check_request(camera: Usd.Prim) -> Iterator[Problem]:
    """Problems of focus attributes that contradict each other, the lens or its microlenses."""
    sensor, focus = camera.GetAttribute(_SENSOR), camera.GetAttribute(_FOCUS)
    if groups := read(camera, _GROUPS):
        lens = target(camera, "plen:camera:lens", "PlenLens")
        names = [group.GetName() for group in lens_groups(lens)] if lens else groups
        for name in [name for name in groups if name not in names]:
            hint = did_you_mean(name, names) or f"its groups: {', '.join(names) or 'none'}"
            message = f'"{name}" is no PlenLensGroup of the lens'
            yield problem(camera.GetAttribute(_GROUPS), "focus-groups", message, hint=hint)
    elif sensor.HasAuthoredValue() and focus.HasAuthoredValue():
        message = f'"{_SENSOR}" and "{_FOCUS}" both state the position of the sensor'
        yield problem(focus, "two-distances", message, hint=f"keep one; to drop the other write {_SENSOR} = None")
    elif not (sensor.HasAuthoredValue() or focus.HasAuthoredValue()):
        message = f'{camera.GetTypeName()} needs "{_SENSOR}" or "{_FOCUS}"'
        yield problem(camera, "missing-value", message, hint="it has no fallback: write it")
    array = target(camera, "plen:camera:microlenses", "PlenMicrolensArray")
    count = len(read(array, attribute_per_type(array)) or ()) if array else 0
    number = read(camera, _TYPE)
    if count and number is not None and number >= count:
        message = f'"{_TYPE}" = {number}, but the array has {count} types, counted from 0'
        yield problem(camera.GetAttribute(_TYPE), "focus-type", message)


def _check_focus(camera: Usd.Prim, is_consistent: bool) -> Iterator[Problem]:
    """A problem of a focus out of reach, or warnings about F-numbers and microlenses."""
    try:
        record = read_camera(camera)
    except PipelineError as error:
        yield of_reader(_attribute_at_fault(camera, error), error)
        return
    has_both = all(camera.GetAttribute(name).HasAuthoredValue() for name in (_SENSOR, _FOCUS))
    if not is_consistent or has_both != bool(read(camera, _GROUPS)):
        return
    # Solve the request step by step; an error is reported at the attribute of its step.
    step = _FOCUS
    try:
        if isinstance(record, FocusRequest):
            sensor_distance(record)
            step = _GROUPS if record.focus_groups else _FOCUS
            group_shift(record)
            step = _MATCH
            if record.microlenses:
                solved(record)
    except CameraError as error:
        yield problem(camera.GetAttribute(step), "out-of-reach", error.message, hint=error.hint)
        return
    except ArithmeticError:
        message = "the lens has no first-order figures: it bends no light"
        yield problem(camera.GetAttribute(step), "out-of-reach", message)
        return
    except PipelineError as error:  # an afocal lens
        yield of_reader(_attribute_at_fault(camera, error), error)
        return
    try:
        yield from _check_f_numbers(camera, solved(record))
        yield from _check_microlenses(camera, solved(record))
    except (PipelineError, ArithmeticError) as error:
        yield of_reader(_attribute_at_fault(camera, error), error)


def _attribute_at_fault(camera: Usd.Prim, error: PipelineError | ArithmeticError) -> Usd.Prim | Usd.Attribute:
    """The attribute to blame for an error of a record; by default the camera."""
    if isinstance(error, PipelineError) and error.code == "distortion":
        return camera.GetAttribute(_DISTORTION)
    if isinstance(error, PipelineError) and error.code == "sensor-tilt":
        return target(camera, "plen:camera:sensor", "PlenSensor").GetAttribute("plen:tilt")
    return camera


def check_planes(camera: Usd.Prim) -> Iterator[Problem]:
    """A problem of a camera without errors: its focus yields no near and far planes, or its field of view reaches
    beside planes that a method needs.
    """
    try:
        fan = pupil_fan(focused(read_camera(camera)).prescription)
        for name in ("plen:truth:method", "plen:truth:rays") if fan.is_wide else ():
            if need(camera, name) not in ("direct", False):
                message = (
                    f"the lens sees {math.degrees(fan.widest_rad):.4g} degrees off its axis, and position images, on"
                    " planes across it, end before 90"
                )
                hint = 'take plen:truth:method = "direct"; the export `rays` has the line of every pixel'
                yield problem(camera.GetAttribute(name), "wide-angle", message, hint=hint)
    except CameraError as error:
        name = _FOCUS if camera.GetAttribute(_FOCUS).HasAuthoredValue() else _SENSOR
        yield problem(camera.GetAttribute(name), "near-far", error.message, hint=error.hint)
    except (PipelineError, ArithmeticError) as error:
        yield of_reader(camera, error)


def _check_f_numbers(camera: Usd.Prim, record: Camera) -> Iterator[Problem]:
    """Problems of the F-numbers of further white images: out of reach of the lens, or listed twice."""
    attribute = camera.GetAttribute(_F_NUMBERS)
    f_numbers = read(camera, _F_NUMBERS) or ()
    if f_numbers and read(camera, _MODEL) == PINHOLE:
        message = f'"{_F_NUMBERS}" asks a pinhole to open to F/{f_numbers[0]:g}'
        yield problem(attribute, "out-of-reach", message, hint=f'write {_MODEL} = "thinLens", or no F-numbers')
        return
    for f_number in dict.fromkeys(f_numbers):
        try:
            stopped_down(record, f_number)
        except CameraError as error:
            yield problem(attribute, "out-of-reach", error.message, hint=error.hint)
    if repeated := [f_number for f_number, count in Counter(f_numbers).items() if count > 1]:
        yield problem(attribute, "repeated-f-number", f'"{_F_NUMBERS}" lists F/{repeated[0]:g} more than once')


def _check_microlenses(camera: Usd.Prim, record: Camera) -> Iterator[Problem]:
    """Warnings of microlens types that do not work together: both Galilean and Keplerian, or gaps in depth of field."""
    array = record.microlenses
    if array is None or len(array.focal_lengths_mm) < 2:
        return
    types = list(zip(array.focal_lengths_mm, array.principal_mm, strict=True))
    galilean = ", ".join(f"{focal:g}" for focal, (behind_mm, _) in types if focal > behind_mm)
    keplerian = ", ".join(f"{focal:g}" for focal, (behind_mm, _) in types if focal <= behind_mm)
    if galilean and keplerian:
        message = (
            f"{array.distance_mm:g} mm before the sensor, microlenses of f = {galilean} mm are Galilean and those of"
            f" {keplerian} mm are not: they look at images on opposite sides of the array"
        )
        prim = target(camera, "plen:camera:microlenses", "PlenMicrolensArray")
        yield warning(prim.GetAttribute(attribute_per_type(prim)), "mixed-microlenses", message)
    for near, far in gaps_mm([focus.depth_of_field_mm for focus in foci(record)]):
        circle = f"circle of confusion {record.circle_of_confusion_px:g} px"
        message = (
            f"no microlens type of this camera is sharp from {near:.1f} to {far:.1f} mm before the stop ({circle})"
        )
        hint = "bring the focal lengths closer together, or allow a larger plen:camera:circleOfConfusion"
        yield warning(camera, "depth-gap", message, hint=hint)
