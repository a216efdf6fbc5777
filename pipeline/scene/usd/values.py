"""Values of prims as Python objects, and the rules of the schemas about them."""

import functools
import math
import re
from dataclasses import dataclass, replace
from typing import Any, get_args, get_type_hints

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, Vt

from pipeline.errors import PipelineError
from pipeline.records.declared import attributes_of
from pipeline.scene.usd.readers import note_read, read_once

_RANGE = re.compile(
    r"^\s*Range: ([\[(])([^,]+), ([^\])]+)([\])])( or inf)?(?:, not in \(-([^,]+), [^)]+\))?\s*$", re.MULTILINE
)
_ENTRIES = re.compile(r"^\s*Entries: \[(\d+), (\d+)\]\s*$", re.MULTILINE)
_CONDITION = re.compile(r"^\s*(Needed|Only) with: (\S+)(?: = (\S+(?:, \S+)*))?\s*$", re.MULTILINE)
LENS_DISTORTION = frozenset(
    f"OmniLensDistortion{name}API"
    for name in ("OpenCvPinhole", "OpenCvFisheye", "Ftheta", "KannalaBrandtK3", "RadTanThinPrism", "Lut")
)
"""Schemas of Omniverse for the projection of a Camera: a stage may apply them, and no reader here uses them."""


class UnreadableValue(PipelineError):
    """A missing or wrong value; it is reported at `thing`, unless another error names its prim."""

    code = "unreadable-value"

    def __init__(
        self, message: str, thing: Usd.Prim | Usd.Property, hint: str | None = None, code: str | None = None
    ) -> None:
        super().__init__(message, hint=hint)
        self.thing, self.code = thing, code or self.code


class NotSupported(UnreadableValue):
    """Valid USD that is not supported; `thing` is the prim or property to mend."""

    code = "not-yet-supported"


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """An interval, from the line `Range:` of a documentation, without numbers nearer to zero than `gap`."""

    low: float
    high: float
    low_open: bool = False
    high_open: bool = False
    or_inf: bool = False
    gap: float = 0.0

    def holds(self, number: Any) -> Any:
        """Whether a number, or each number of an array, lies inside; NaN never does."""
        above = number > self.low if self.low_open else number >= self.low
        below = number < self.high if self.high_open else number <= self.high
        inside = above & below & (abs(number) >= self.gap)
        return inside | (number == math.inf) if self.or_inf else inside

    def __str__(self) -> str:
        brackets = "[("[self.low_open], "])"[self.high_open]
        or_inf = " or inf" if self.or_inf else ""
        gap = f", not in (-{self.gap:g}, {self.gap:g})" if self.gap else ""
        return f"{brackets[0]}{self.low:.10g}, {self.high:.10g}{brackets[1]}{or_inf}{gap}"


FOREIGN = {
    "points": Range(low=-1e9, high=1e9),
    "primvars:displayColor": Range(low=0.0, high=1e6),
    "xformOp": Range(low=-1e9, high=1e9),
}
"""Ranges of attributes of USD: vertices in the unit of the stage, colours, and transform operations."""


def range_of(documentation: str) -> Range | None:
    """The range stated in a documentation; None if it states none."""
    match = _RANGE.search(documentation)
    if not match:
        return None
    opening, low, high, closing, or_inf, gap = match.groups()
    return Range(
        low=float(low),
        high=float(high),
        low_open=opening == "(",
        high_open=closing == ")",
        or_inf=bool(or_inf),
        gap=float(gap or 0),
    )


_ENTRIES_FOR_NUMPY = 100
"""Number of entries above which NumPy is faster: meshes have thousands."""


def plain(value: Any) -> Any:
    """A value of USD as a Python object, with 0.0 for -0.0: task and key see the same number, but 1 / -0.0 differs."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value + 0.0
    if isinstance(value, Sdf.AssetPath):
        return value.path
    if isinstance(value, Gf.Quatd | Gf.Quatf | Gf.Quath):
        return (value.GetReal() + 0.0, *plain(value.GetImaginary()))
    if not hasattr(value, "__len__"):
        return value  # a time code, or of a type that nothing here reads
    if len(value) > _ENTRIES_FOR_NUMPY and isinstance(
        value[0], int | float | Gf.Vec2f | Gf.Vec3f | Gf.Vec2d | Gf.Vec3d
    ):
        array = np.asarray(value)
        if array.dtype.kind in "if":
            rows = (array if array.dtype.kind == "i" else array.astype(np.float64) + 0.0).tolist()
            return tuple(map(tuple, rows)) if array.ndim == 2 else tuple(rows)
    return tuple(plain(item) for item in value)


def numbers(value: Any) -> np.ndarray:
    """All numbers in a value of USD as one array, (n,); empty for tokens, strings, flags and assets."""
    if value is None or isinstance(value, bool | str | Sdf.AssetPath | Sdf.AssetPathArray):
        return np.zeros(0)
    if isinstance(value, Gf.Quatd | Gf.Quatf | Gf.Quath):
        return np.array(plain(value))
    try:
        array = np.asarray(value)
        return np.asarray(array if array.dtype.kind in "iuf" else plain(value), dtype=np.float64).ravel()
    except (TypeError, ValueError):  # an array of texts, or a value without numbers
        return np.zeros(0)


LONGEST_TEXT = 1000
"""Longest text of a stage [characters]: names, glasses and formulas are far shorter, and longer texts would flood
tables and terminals.
"""


def bad_text(value: Any) -> str | None:
    """The first text of a value that is too long or not printable, because texts appear in tables and terminals."""
    texts = [value] if isinstance(value, str) else value if isinstance(value, Vt.TokenArray | Vt.StringArray) else ()
    return next((text for text in texts if len(text) > LONGEST_TEXT or not text.isprintable()), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """A `Needed with:` or `Only with:` of a documentation: a property, and its values (empty: any that is written).

    An attribute is needed if any condition of the one kind holds, and has no effect unless all of the other do.
    """

    kind: str
    name: str
    tokens: tuple[str, ...] = ()

    def holds(self, prim: Usd.Prim) -> bool | None:
        """Whether it holds for a prim; None if the deciding value is itself wrong."""
        if not self.tokens:
            return is_written(prim, self.name)
        value = read(prim, self.name)
        return None if value is None else value in self.tokens


def conditions_in(documentation: str) -> tuple[Condition, ...]:
    """The conditions that a documentation states."""
    return tuple(
        Condition(kind=kind, name=name, tokens=tuple(filter(None, tokens.split(", "))))
        for kind, name, tokens in _CONDITION.findall(documentation)
    )


def is_written(prim: Usd.Prim, name: str) -> bool:
    """Whether a stage gives a property a value other than the fallback: an empty one cancels that of a weaker file."""
    rule = rule_of(prim, name)
    if rule is None:
        return bool(target_paths(prim.GetRelationship(name)))
    if not prim.GetAttribute(name).HasAuthoredValue():
        return False
    value = read(prim, name)
    return value is None or value not in ((), "", rule.fallback)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """Rules of the schemas about the values of an attribute: type as read by USD, range of every number, fewest and
    most entries of an array, allowed tokens, the fallback as a Python object, and what other values it depends on.
    None and empty: anything is allowed.
    """

    kind: type | None = None
    span: Range | None = None
    entries: tuple[int, int] | None = None
    tokens: frozenset[str] = frozenset()
    fallback: Any = None
    conditions: tuple[Condition, ...] = ()

    def holds(self, value: Any) -> bool:
        """Whether a value of USD has the right type, length and range, and printable texts."""
        if self.kind and type(value) is not self.kind:
            return False
        if isinstance(value, float | int):  # the usual case: a plain comparison needs no array
            return isinstance(value, bool) or bool(self.span.holds(value) if self.span else math.isfinite(value))
        if self.entries and not self.entries[0] <= len(value) <= self.entries[1]:
            return False
        if self.tokens and not self.tokens.issuperset([value] if isinstance(value, str) else value):
            return False
        if bad_text(value) is not None:
            return False
        array = numbers(value)
        return bool(np.all(self.span.holds(array) if self.span else np.isfinite(array)))


_RULES: dict[tuple[str, ...], dict[str, Rule]] = {}


def rules_of(prim: Usd.Prim) -> dict[str, Rule]:
    """Rules of all attributes that the schemas of a prim have."""
    key = prim.GetTypeName(), *prim.GetAppliedSchemas()
    if (known := _RULES.get(key)) is None:
        definition = prim.GetPrimDefinition()
        rules = {name: _rule(definition, name) for name in definition.GetPropertyNames()}
        known = _RULES[key] = {name: rule for name, rule in rules.items() if rule}
    return known


def rule_of(prim: Usd.Prim, name: str) -> Rule | None:
    """The rule of an attribute; None if no schema of the prim has it."""
    return rules_of(prim).get(name)


def _rule(definition: Usd.PrimDefinition, name: str) -> Rule | None:
    """The rule of an attribute, from its schema and its documentation; None if it is no attribute."""
    attribute = definition.GetAttributeDefinition(name)
    if not attribute:
        return None
    text = definition.GetPropertyMetadata(name, "documentation") or ""
    is_ours = name.startswith("plen:")
    entries = _ENTRIES.search(text) if is_ours else None
    rule = Rule(
        kind=type(attribute.GetTypeName().defaultValue),
        span=range_of(text) if is_ours else FOREIGN.get(name),
        entries=(int(entries[1]), int(entries[2])) if entries else None,
        tokens=frozenset(definition.GetPropertyMetadata(name, "allowedTokens") or ()),
        conditions=conditions_in(text) if is_ours else (),
    )
    fallback = attribute.GetFallbackValue()
    return replace(rule, fallback=plain(fallback)) if fallback is not None and rule.holds(fallback) else rule


@read_once
def read(prim: Usd.Prim, name: str) -> Any:
    """Value of an attribute or its fallback; None if there is none, or if the rule of its schema excludes it.

    So no computation meets a value that is not finite, out of range, or not an allowed token: the checks of values
    report it, and all other code treats it as missing.
    """
    attribute, rule = prim.GetAttribute(name), rule_of(prim, name)
    if not attribute or not rule:
        return None
    note_read(prim, name)
    if not attribute.HasAuthoredValue():
        return rule.fallback
    value = value_at(attribute, 0.0)
    # In USD an opinion of a wrong type wins, although the attribute has the type of the schema.
    return plain(value) if value is not None and rule.holds(value) else None


def value_at(attribute: Usd.Attribute, code: float) -> Any:
    """Value of an attribute at a time code, between two equal samples exactly theirs: USD's interpolation rounds."""
    value = attribute.Get(code)
    if times := attribute.ValueMightBeTimeVarying() and attribute.GetBracketingTimeSamples(code):
        first, last = map(attribute.Get, times)
        return first if first == last else value
    return value


def need(prim: Usd.Prim, name: str) -> Any:
    """Value of one of our attributes or its fallback; UnreadableValue if there is none, or its rule excludes it."""
    value = read(prim, name)
    if value is None:
        raise UnreadableValue(f'<{prim.GetPath()}> has no usable "{name}"', prim.GetAttribute(name) or prim)
    return value


def fields_of(prim: Usd.Prim, record: type) -> dict[str, Any]:
    """Values of the fields of a record that are annotated with attributes of a prim, but for attributes that have no
    effect beside a token of another one; None where a field may lack a value. UnreadableValue as `need`.
    """
    values, rules = {}, rules_of(prim)
    for name, (attribute, may_lack) in _annotated(record).items():
        rule = rules.get(attribute)
        by_token = [condition for condition in rule.conditions if condition.tokens] if rule else []
        conditions = [(condition.kind, condition.holds(prim)) for condition in by_token]
        if ("Only", False) not in conditions:
            is_free = may_lack and ("Needed", True) not in conditions
            values[name] = read(prim, attribute) if is_free else need(prim, attribute)
    return values


@functools.cache  # taking annotations apart costs more than reading values
def _annotated(record: type) -> dict[str, tuple[str, bool]]:
    """Attribute of each annotated field of a record, and whether the field may lack a value."""
    hints = get_type_hints(record)
    return {name: (attribute, type(None) in get_args(hints[name])) for name, attribute in attributes_of(record).items()}


def target(prim: Usd.Prim, name: str, wanted: str) -> Any:
    """The one prim of a type to which a relationship points; None if there is none."""
    prims = targets(prim, name, wanted)
    return prims[0] if len(prims) == 1 else None


def targets(prim: Usd.Prim, name: str, wanted: str) -> list[Usd.Prim]:
    """Prims of a type to which a relationship points, in its order."""
    stage = prim.GetStage()
    prims = [stage.GetPrimAtPath(path) for path in target_paths(prim.GetRelationship(name))]
    return [target for target in prims if target and target.IsA(wanted)]


def target_paths(relationship: Usd.Relationship) -> list[Sdf.Path]:
    """Paths to which a relationship points; empty if an attribute was written in its place."""
    try:
        if relationship:
            note_read(relationship.GetPrim(), relationship.GetName())
        return list(relationship.GetTargets()) if relationship else []
    except Tf.ErrorException:
        return []
