"""Values of prims as Python's own, and what the schemas say about them."""

import re
from dataclasses import dataclass
from typing import Any

from pxr import Gf, Plug, Sdf, Tf, Usd

from pipeline.errors import PipelineError
from pipeline.scene.register import PLUGIN_NAME

_RANGE = re.compile(r"^\s*Range: ([\[(])([^,]+), ([^\])]+)([\])])(, not 0)?\s*$", re.MULTILINE)
# All our attributes are uniform, and time samples on them are errors: every time gives the same value.
_ANY_TIME = 0.0


class UnreadableValue(PipelineError):
    """A value that is missing or of a wrong type; the checks of values have said so already."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """An interval, as the line `Range:` of an attribute's documentation says it."""

    low: float
    high: float
    low_open: bool
    high_open: bool
    not_zero: bool

    def holds(self, number: float) -> bool:
        """Whether a number lies inside; NaN never does."""
        above = number > self.low if self.low_open else number >= self.low
        below = number < self.high if self.high_open else number <= self.high
        return above and below and not (self.not_zero and number == 0)

    def __str__(self) -> str:
        brackets = "[("[self.low_open], "])"[self.high_open]
        not_zero = ", not 0" if self.not_zero else ""
        return f"{brackets[0]}{self.low:g}, {self.high:g}{brackets[1]}{not_zero}"


def range_of(documentation: str) -> Range | None:
    """The range that a documentation states; None if it states none."""
    match = _RANGE.search(documentation)
    if not match:
        return None
    opening, low, high, closing, not_zero = match.groups()
    return Range(
        low=float(low), high=float(high), low_open=opening == "(", high_open=closing == ")", not_zero=bool(not_zero)
    )


def plain(value: Any) -> Any:
    """A value of USD as Python's own, and -0.0 as 0.0.

    Task and key see the same number this way: 1 / -0.0 is not 1 / 0.0.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value + 0.0
    if isinstance(value, Sdf.AssetPath):
        return value.path
    if isinstance(value, Gf.Quatd | Gf.Quatf | Gf.Quath):
        return (value.GetReal() + 0.0, *plain(value.GetImaginary()))
    return tuple(plain(item) for item in value)


def numbers(value: Any) -> list[float]:
    """All numbers in a plain value, empty for tokens, strings and flags."""
    if isinstance(value, bool):
        return []
    if isinstance(value, int | float):
        return [value]
    if isinstance(value, tuple):
        return [number for item in value for number in numbers(item)]
    return []


def read(prim: Usd.Prim, name: str) -> Any:
    """Value of one of our attributes, fallback included; None without one or with one of a wrong type."""
    attribute = prim.GetAttribute(name)
    definition = prim.GetPrimDefinition().GetAttributeDefinition(name)
    if not attribute or not definition:
        return None
    value = attribute.Get(_ANY_TIME)
    # A wrongly typed opinion wins in USD, although the attribute claims the type of the schema.
    return plain(value) if type(value) is type(definition.GetTypeName().defaultValue) else None


def need(prim: Usd.Prim, name: str) -> Any:
    """Value of one of our attributes, fallback included.

    Raises
    ------
    UnreadableValue
        There is none, or one of a wrong type.
    """
    value = read(prim, name)
    if value is None:
        raise UnreadableValue(f'<{prim.GetPath()}> has no usable "{name}"')
    return value


def schema_facts(prim: Usd.Prim, key: str) -> list[Any]:
    """What our plugInfo.json says under `key` of the type and the applied schemas of a prim."""
    registry = Usd.SchemaRegistry()
    found = []
    for schema in [prim.GetPrimTypeInfo().GetSchemaTypeName(), *prim.GetAppliedSchemas()]:
        identifier, _ = registry.GetTypeNameAndInstance(schema)
        tf_type = registry.GetTypeFromSchemaTypeName(identifier)
        plugin = None if tf_type == Tf.Type.Unknown else Plug.Registry().GetPluginForType(tf_type)
        if plugin and plugin.name == PLUGIN_NAME:
            fact = plugin.GetMetadataForType(tf_type).get(key)
            found += [fact] if fact is not None else []
    return found


def target(prim: Usd.Prim, name: str, wanted: str) -> Any:
    """The one prim of a type that a relationship points at; None if it does not."""
    found = targets(prim, name, wanted)
    return found[0] if len(found) == 1 else None


def targets(prim: Usd.Prim, name: str, wanted: str) -> list[Usd.Prim]:
    """Prims of a type that a relationship points at, in its order."""
    stage = prim.GetStage()
    prims = [stage.GetPrimAtPath(path) for path in target_paths(prim.GetRelationship(name))]
    return [found for found in prims if found and found.IsA(wanted)]


def target_paths(relationship: Usd.Relationship) -> list[Sdf.Path]:
    """Paths that a relationship points at; none where an attribute was written in its place."""
    try:
        return list(relationship.GetTargets()) if relationship else []
    except Tf.ErrorException:
        return []
