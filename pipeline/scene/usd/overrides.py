"""Overrides: values of properties that replace those of the files of a stage.

A step of a derivative, the errors of a camera as built, and the state of a camera at one time code are overrides. A
stage with overrides is a stage of its own above the same files, so readers need not know of them.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdUtils

from pipeline.scene.usd.problems import Problem, problem
from pipeline.scene.usd.readers import read_like, read_once
from pipeline.scene.usd.values import UnreadableValue, numbers, rule_of, value_at

Samples = Mapping[Usd.TimeCode, Any]
"""Values of an attribute, by the times at which they are written."""
Overrides = Mapping[Sdf.Path, Samples]
"""Values of attributes, by path; an attribute that is not on the stage is made."""
_OURS = ("PlenLens", "PlenMicrolensArray", "PlenSensor", "PlenWindow", "PlenChannel")
"""Types of the parts of a camera."""


def layer_of(stage: Usd.Stage, overrides: Overrides) -> Sdf.Layer:
    """A new layer that writes overrides as the attributes of the stage are declared."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.timeCodesPerSecond = stage.GetTimeCodesPerSecond()  # or USD scales the times of samples
    for path, samples in overrides.items():
        attribute = stage.GetAttributeAtPath(path)
        kind = attribute.GetTypeName() if attribute else Sdf.GetValueTypeNameForValue(next(iter(samples.values())))
        variability = attribute.GetVariability() if attribute else Sdf.VariabilityVarying
        Sdf.JustCreatePrimAttributeInLayer(layer, path, kind, variability, bool(attribute and attribute.IsCustom()))
        for time, value in samples.items():
            if time.IsDefault():
                layer.GetAttributeAtPath(path).default = value
            else:
                layer.SetTimeSample(path, time.GetValue(), value)
    return layer


def overridden(stage: Usd.Stage, overrides: Overrides, only: Iterable[Sdf.Path] = ()) -> Usd.Stage:
    """The stage with overrides; `only`: paths of prims that it is limited to, with all below and above."""
    overriding = layer_of(stage, overrides)
    overriding.subLayerPaths.append(stage.GetSessionLayer().identifier)
    messages = UsdUtils.CoalescingDiagnosticDelegate()  # what is missing was said of the stage itself
    try:
        mask = Usd.StagePopulationMask(list(only) or [Sdf.Path.absoluteRootPath])
        stage_with_overrides = Usd.Stage.OpenMasked(
            stage.GetRootLayer(), overriding, stage.GetPathResolverContext(), mask
        )
    finally:
        messages.TakeUncoalescedDiagnostics()
    read_like(stage_with_overrides, stage)
    return stage_with_overrides


def at_code(prim: Usd.Prim, code: float) -> Usd.Prim:
    """A camera, or a part of one, on a stage where animated attributes of these hold the value of a time code; any
    other prim unchanged. That stage has only these prims and their ancestors, and lives until the stage changes.
    """
    stage = _stage_at_code(prim.GetStage(), code)
    return (stage and stage.GetPrimAtPath(prim.GetPath())) or prim


@read_once
def _stage_at_code(stage: Usd.Stage, code: float) -> Usd.Stage | None:
    """Cameras and their parts on a stage of their own, with the values of a time code; None if none of them changes."""
    overrides = dict[Sdf.Path, Samples]()
    for attribute in changing(stage):
        rule, value = rule_of(attribute.GetPrim(), attribute.GetName()), value_at(attribute, code)
        if rule and type(value) is rule.kind:  # else checks refuse the stage
            overrides[attribute.GetPath()] = {Usd.TimeCode.Default(): value}
    return overridden(stage, overrides, [prim.GetPath() for prim in _camera_parts(stage)]) if overrides else None


@read_once
def _camera_parts(stage: Usd.Stage) -> list[Usd.Prim]:
    """Cameras of a stage, and the prims of which they consist."""
    return [prim for prim in stage.Traverse() if prim.HasAPI("PlenCameraAPI") or any(map(prim.IsA, _OURS))]


@read_once
def changing(stage: Usd.Stage) -> list[Usd.Attribute]:
    """Attributes of cameras and their parts that have several values in time."""
    return list(
        dict.fromkeys(
            attribute for part in _camera_parts(stage) for prim in Usd.PrimRange(part) for attribute in varying(prim)
        )
    )


def check_changing(stage: Usd.Stage, codes: Iterable[float]) -> Iterator[Problem]:
    """Problems of numbers of cameras and their parts without a value at a time code, as after a sample of None."""
    for attribute in changing(stage):
        if (code := next((code for code in codes if value_at(attribute, code) is None), None)) is not None:
            message = f'"{attribute.GetName()}" has no value at time code {code:g}'
            yield problem(attribute, UnreadableValue.code, message, hint="write a number for each frame")


def varying(prim: Usd.Prim) -> list[Usd.Attribute]:
    """Our attributes on a prim that have time samples, a spline or value clips."""
    ours = [attribute for attribute in prim.GetAuthoredAttributes() if attribute.GetName().startswith("plen:")]
    return [attribute for attribute in ours if attribute.ValueMightBeTimeVarying()]


def samples_of(attribute: Usd.Attribute) -> Samples:
    """Values of an attribute at its time samples, or else its default; the words "a spline" for one; none without a
    value or fallback.
    """
    if attribute and attribute.HasSpline():
        return {Usd.TimeCode.Default(): "a spline"}
    times = [Usd.TimeCode(time) for time in attribute.GetTimeSamples()] if attribute else []
    values = {time: attribute.Get(time) for time in times or [Usd.TimeCode.Default()]} if attribute else {}
    return {time: value for time, value in values.items() if value is not None}


def entries(value: Any) -> np.ndarray:
    """The real numbers of a value, (n,) float64; none of counts and tokens, of quaternions, whose numbers depend on
    each other, or if any is not finite.
    """
    if isinstance(value, bool | int | str) or value is None or hasattr(value, "GetImaginary"):
        return np.zeros(0)
    array = numbers(value)
    return array if np.asarray(value).dtype.kind not in "biu" and np.isfinite(array).all() else np.zeros(0)


def name_of(path: Sdf.Path, value: Any, i: int) -> str:
    """Name of the i-th number of a property: its path, with [i] if it holds several."""
    return str(path) if isinstance(value, float) else f"{path}[{i}]"


def moved_by(value: Any, i: int, by: float) -> Any:
    """A value of USD with its i-th number moved."""
    if isinstance(value, float):
        return value + by
    moved = type(value)(value)
    if hasattr(moved[0], "__len__"):
        width = len(moved[0])
        entry = type(moved[0])(moved[i // width])
        entry[i % width] += by
        moved[i // width] = entry
    else:
        moved[i] += by
    return moved


def unit_of(attribute: Usd.Attribute) -> str:
    """Unit of an attribute as its documentation states it; empty: none is stated."""
    text = attribute.GetPrim().GetPrimDefinition().GetPropertyMetadata(attribute.GetName(), "documentation") or ""
    return next((line.strip()[7:] for line in text.splitlines() if line.strip().startswith("Units: ")), "")
