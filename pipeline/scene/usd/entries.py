"""Numbers of properties one by one, and a stage with others in their place."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from pipeline.scene.usd.values import numbers

Samples = dict[Usd.TimeCode, Any]
"""Values of an attribute, by the times at which they are written."""


def samples_of(attribute: Usd.Attribute) -> Samples:
    """The values of an attribute, at its time samples or, without any, its default, or the words "a spline"; none if
    nothing is written and there is no fallback.
    """
    if attribute and attribute.HasSpline():
        return {Usd.TimeCode.Default(): "a spline"}
    times = [Usd.TimeCode(time) for time in attribute.GetTimeSamples()] if attribute else []
    values = {time: attribute.Get(time) for time in times or [Usd.TimeCode.Default()]} if attribute else {}
    return {time: value for time, value in values.items() if value is not None}


def entries(value: Any) -> np.ndarray:
    """The numbers of a value, (n,) float64; none if any is not finite, if it has none with a point, as a count or a
    token, or none that moves alone, as a quaternion.
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


@contextmanager
def edited(stage: Usd.Stage, values: Mapping[Sdf.Path, Samples]) -> Iterator[Sdf.Layer]:
    """Context in which attributes have other values, in a layer above all others."""
    layer, session = Sdf.Layer.CreateAnonymous(".usda"), stage.GetSessionLayer()
    session.subLayerPaths.insert(0, layer.identifier)
    try:
        with Usd.EditContext(stage, layer):
            for path, samples in values.items():
                for time, value in samples.items():
                    stage.GetAttributeAtPath(path).Set(value, time)
        yield layer
    finally:
        session.subLayerPaths.remove(layer.identifier)
