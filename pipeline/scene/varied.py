"""Numbers of a stage by which the ground truth has derivatives: datasets with each number at -h and at +h.

Any number that a reader takes from a stage may be varied, with its consequences: where a camera is focused at a
distance, a step of a radius moves the focus, too.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, TypeVar

from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from pipeline.camera.focusing.focus_request import solved
from pipeline.camera.parts.errors import CameraError
from pipeline.frames import VISION_FROM_CAMERA
from pipeline.scene.camera import read_camera
from pipeline.scene.dataset import Dataset, VariedNumber
from pipeline.scene.usd.overrides import Overrides, entries, moved_by, name_of, overridden, samples_of, unit_of
from pipeline.scene.usd.poses import stage_mm_per_unit
from pipeline.scene.usd.problems import Problem, StageError, problem
from pipeline.scene.usd.values import UnreadableValue, read, rule_of, target_paths, targets

_DERIVATIVES = "plen:truth:derivatives"
"""Relationship of a camera to the numbers with respect to which its rows have derivatives."""
_SHARE, _LEAST, _FROM_ZERO = 1e-5, 1e-8, 1e-4
"""Step of a number, as a share of it: differences then err by 1e-10 of the derivative, and rounding by 1e-8. The
least step, and that of a number that is 0, in its unit: mm, degrees or none."""
_SAG_MM = 1e-6
"""Change of the sag at the edge by the step of an aspheric coefficient [mm]: the coefficient itself may be 0."""
_POSE_STEP = 1e-3
"""Step of a pose [mm, degrees]: windows that stand before a camera are where they are to 1e-10."""
_POSE = (("x", "mm"), ("y", "mm"), ("z", "mm"), ("turn_x", "deg"), ("turn_y", "deg"), ("turn_z", "deg"))
"""Numbers of a pose, with their units: shift along and turn about the axes of what is posed."""
_COEFFICIENTS = {"plen:evenCoefficients": 2, "plen:oddCoefficients": 3}
"""Powers of the first coefficients of aspheres; those that follow have two more each."""
_RADIUS_POWERS = (2, 4, 1, 1, 6)
"""Powers of the radius by which the coefficients of Brown's distortion, k1, k2, p1, p2, k3, scale an image: a step
scales its corner by `_SHARE`, however narrow the field is."""
R = TypeVar("R")
_ALWAYS = Usd.TimeCode.Default()


def with_varied(root: Usd.Prim, dataset: Dataset, reader: Callable[[Usd.Stage], Dataset]) -> Dataset:
    """The dataset with all numbers by which its cameras ask for derivatives; StageError with all that have none."""
    varied = {}
    problems = list[Problem]()
    for camera in targets(root, "plen:cameras", "Camera"):
        relationship = camera.GetRelationship(_DERIVATIVES)
        numbers = list[VariedNumber[Dataset]]()
        for path in target_paths(relationship):
            try:
                numbers += _varied(root, path, dataset, reader)
            except UnreadableValue as error:  # the relationship is wrong, not what it names
                problems.append(problem(relationship, error.code, error.message, hint=error.hint))
        if numbers:
            varied[str(camera.GetPath())] = tuple(numbers)
    if problems:
        raise StageError(problems)
    if not varied:
        return dataset
    sources = tuple(f"{path}.{_DERIVATIVES}" for path in varied)
    return replace(dataset, varied=varied, sources={**dataset.sources, "derivatives": sources})


def _varied(
    root: Usd.Prim, path: Sdf.Path, dataset: Dataset, reader: Callable[[Usd.Stage], Dataset]
) -> Iterator[VariedNumber[Dataset]]:
    """The numbers of a property, or those of the pose of a camera or target, each a little less and more."""
    if path.IsPropertyPath():
        yield from varied_numbers(root.GetStage(), path, reader)
        return
    prim = root.GetStage().GetPrimAtPath(path)
    is_camera = str(path) in [entry.prim_path for entry in dataset.cameras]
    if not is_camera and str(path) not in [entry.prim_path for entry in dataset.targets]:
        hint = "name a camera or a target, of which it is the pose, or one property: </Rig/Lens/Front.plen:radius>"
        message = f"rows have no derivative by <{path}>, which is neither a camera nor a target of the dataset"
        raise UnreadableValue(message, prim, hint, "no-derivative")
    for axis, (name, unit) in enumerate(_POSE):
        direction = VISION_FROM_CAMERA[axis % 3, axis % 3] if is_camera else 1.0
        less, more = (
            reader(overridden(root.GetStage(), _posed(prim, axis, sign * direction * _POSE_STEP))) for sign in (-1, 1)
        )
        yield VariedNumber(name=f"{path} {name}", unit=unit, step=_POSE_STEP, less=less, more=more)


def _posed(prim: Usd.Prim, axis: int, by: float) -> Overrides:
    """A camera or target moved along, or turned about, an axis of its own [mm, degrees]."""
    order = UsdGeom.Xformable(prim).GetXformOpOrderAttr()
    step = Gf.Vec3d()
    step[axis % 3] = by if axis >= 3 else by / stage_mm_per_unit(prim)
    name = "xformOp:rotateXYZ:varied" if axis >= 3 else "xformOp:translate:varied"
    ops = Vt.TokenArray([*(order.Get() or ()), name])  # the last one is applied first
    return {prim.GetPath().AppendProperty(name): {_ALWAYS: step}, order.GetPath(): {_ALWAYS: ops}}


def varied_numbers(stage: Usd.Stage, path: Sdf.Path, reader: Callable[[Usd.Stage], R]) -> Iterator[VariedNumber[R]]:
    """Each number of a property, with what is read of the stage with it a little less and more; UnreadableValue if it
    holds none that can be varied.
    """
    attribute = stage.GetAttributeAtPath(path)
    values = samples_of(attribute)
    first: Any = next(iter(values.values()), None)
    numbers = entries(first)
    if not len(numbers):
        message = f"rows have no derivative by <{path}>: it is {'not written' if first is None else first}"
        hint = "name a property that holds finite numbers with a point, as a radius, a thickness or an index"
        raise UnreadableValue(message, attribute or stage.GetPrimAtPath(path.GetPrimPath()), hint, "no-derivative")
    rule = rule_of(attribute.GetPrim(), attribute.GetName())
    for i, entry in enumerate(numbers):
        half = _step(attribute, i, abs(float(entry)))
        ends = []
        for sign in (-1, 1):
            moved = {time: moved_by(value, i, sign * half) for time, value in values.items()}
            if rule is not None and not all(map(rule.holds, moved.values())):
                message = f"rows have no derivative by <{path}>: {entry:.10g} ends its range, {rule.span}"
                raise UnreadableValue(message, attribute, "move it by a thousandth", "no-derivative")
            try:
                ends.append((entries(next(iter(moved.values())))[i], reader(overridden(stage, {path: moved}))))
            except CameraError as error:
                message = f"rows have no derivative by <{path}>: a little off {entry:.10g}, {error.message}"
                raise UnreadableValue(message, attribute, error.hint, "no-derivative") from None
        (low, less), (high, more) = ends  # of a float as it was rounded
        name = name_of(path, first, i)
        yield VariedNumber(name=name, unit=unit_of(attribute), step=float(high - low) / 2, less=less, more=more)


def _step(attribute: Usd.Attribute, i: int, size: float) -> float:
    """Step of the i-th number of an attribute, whose size is given."""
    name, prim = attribute.GetName(), attribute.GetPrim()
    if name in _COEFFICIENTS:
        return float(_SAG_MM / read(prim, "plen:semiDiameter") ** (_COEFFICIENTS[name] + 2 * i))
    if name == "plen:camera:distortion":
        return float(_SHARE / _corner_slope(prim) ** _RADIUS_POWERS[i])
    if name.startswith("xformOp:"):
        return float(_POSE_STEP / (stage_mm_per_unit(prim) if name.startswith("xformOp:translate") else 1.0))
    return max(_SHARE * size, _LEAST) if size else _FROM_ZERO


def _corner_slope(camera: Usd.Prim) -> float:
    """Slope to the axis at which a thin lens sends light to the farthest corner of the image of a camera [1]."""
    focused = solved(read_camera(camera))
    reach_mm = focused.microlenses.reach_mm if focused.microlenses else 0.0
    return math.hypot(*focused.sensor.farthest_corner_mm) / (focused.sensor_distance_mm - reach_mm)
