"""Checks of values of attributes: types, tokens, ranges, and values that are not supported yet."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from pipeline.scene.usd.problems import Problem, did_you_mean, shortened, shown_path
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.usda_lines import line_of
from pipeline.scene.usd.values import LONGEST_TEXT, Range, Rule, bad_text, numbers, plain, rule_of

_NAMED = 5
"""Number of wrong values of one attribute that are listed."""

_NO_TILT = ((0.0, 0.0),)
"""Supported tilts of a sensor [deg]: none yet."""
# Supported values of attributes for which the schemas allow more, with the prim type in front where it matters. All
# values of other attributes are supported.
SUPPORTED: dict[str, tuple[Any, ...]] = {
    "PlenSensor plen:tilt": _NO_TILT,
}


def check_attribute(attribute: Usd.Attribute, definition: Usd.PrimDefinition) -> Iterator[Problem]:
    """Problems of one authored attribute that a schema defines."""
    schema = definition.GetAttributeDefinition(attribute.GetName())
    if wrong := list(_check_written_type(attribute, schema.GetTypeName())):
        yield from wrong  # values of a wrong type would confuse the further checks
        return
    name = attribute.GetName()
    if schema.GetVariability() == Sdf.VariabilityUniform and attribute.ValueMightBeTimeVarying():
        yield problem(attribute, "uniform-animated", f'"{name}" is uniform and cannot have time samples')
    rule = rule_of(attribute.GetPrim(), name)
    for time, value in authored_values(attribute):
        bad = list(check_value(attribute, value, time, rule)) or list(_check_tokens(attribute, value, time))
        yield from bad or _check_supported(attribute, value, time)


def check_value(
    attribute: Usd.Attribute, value: Any, time: float | None, rule: Rule | None = None
) -> Iterator[Problem]:
    """Problems of one value as read by USD: it must have the right type and length, and be finite and in range."""
    name, wanted = attribute.GetName(), attribute.GetTypeName()
    if type(value) is not type(wanted.defaultValue):
        message = f'"{name}" must hold a {wanted}, not {shortened(str(value))}'
        yield problem(attribute, "wrong-type", message, time=time)
    elif rule and rule.entries and not rule.entries[0] <= len(value) <= rule.entries[1]:
        fewest, most = rule.entries
        message = f'"{name}" has {len(value)} entries, not {fewest} to {most}'
        yield problem(attribute, "entries", message, time=time)
    else:
        yield from _check_texts(attribute, value, time)
        yield from _check_numbers(attribute, value, time, rule.span if rule else None)


def authored_values(attribute: Usd.Attribute) -> Iterator[tuple[float | None, Any]]:
    """Pairs of a time (None for the default value) and the value of USD at that time."""
    if not attribute.HasAuthoredValue():
        return
    default = attribute.Get()
    if default is not None:
        yield None, default
    for time in attribute.GetTimeSamples():
        yield time, attribute.Get(time)


def _check_written_type(attribute: Usd.Attribute, wanted: Sdf.ValueTypeName) -> Iterator[Problem]:
    # The composed attribute has the type of the schema; only the opinions show the written type.
    for spec in attribute.GetPropertyStack(Usd.TimeCode.Default()):
        if spec.typeName != wanted:
            yield Problem(
                code="wrong-type",
                message=f'"{attribute.GetName()}" must be written as {wanted}, not {spec.typeName}',
                file=shown_path(spec.layer.realPath),
                line=line_of(spec.layer.realPath, str(spec.path)),
                at=str(attribute.GetPath()),
            )


def _check_tokens(attribute: Usd.Attribute, value: Any, time: float | None) -> Iterator[Problem]:
    allowed = list(attribute.GetMetadata("allowedTokens") or [])
    wrong = dict.fromkeys([value] if isinstance(value, str) else value) if allowed else {}
    for token in [token for token in wrong if token not in allowed][:_NAMED]:
        choices = f"allowed: {', '.join(allowed)}"
        guess = did_you_mean(token, allowed)
        message = f'"{shortened(token)}" is not a value of "{attribute.GetName()}"'
        yield problem(attribute, "bad-token", message, hint=f"{guess} {choices}" if guess else choices, time=time)


def _check_texts(attribute: Usd.Attribute, value: Any, time: float | None) -> Iterator[Problem]:
    text = bad_text(value)
    if text is None:
        return
    if len(text) > LONGEST_TEXT:
        what, hint = f"a text of {len(text):,} characters", f"{LONGEST_TEXT:,} are the most"
    else:
        what, hint = "characters that cannot be printed", "remove line breaks, tabs and control characters"
    message = f'"{attribute.GetName()}" holds {what}: {shortened(text)}'
    yield problem(attribute, "text", message, hint=hint, time=time)


def _check_numbers(attribute: Usd.Attribute, value: Any, time: float | None, span: Range | None) -> Iterator[Problem]:
    """A problem for the first number of a value that is not finite or outside the range stated in the schema."""
    name, found = attribute.GetName(), numbers(value)
    outside = np.flatnonzero(~(span.holds(found) if span else np.isfinite(found)))
    if not len(outside):
        return
    number = float(found[outside[0]])
    if not math.isfinite(number):
        yield problem(attribute, "not-finite", f'"{name}" is not a finite number: {number}', time=time)
    else:
        is_int = attribute.GetTypeName().scalarType == Sdf.ValueTypeNames.Int
        message = f'"{name}" = {int(number) if is_int else number} is outside {span}'
        yield problem(attribute, "out-of-range", message, hint=_meaning(name, number), time=time)


def _meaning(name: str, number: float) -> str | None:
    """A hint about a number outside its range, where the intention is well known."""
    if name.endswith("avelength") and number < 100:
        return "wavelengths are nanometres: 0.55 µm are 550"
    if name == "plen:index" and number < 0:
        return "a negative index is a mirror in other programs; mirrors are not simulated"
    return None


def _check_supported(attribute: Usd.Attribute, value: Any, time: float | None) -> Iterator[Problem]:
    name = attribute.GetName()
    supported = SUPPORTED.get(name, SUPPORTED.get(f"{attribute.GetPrim().GetTypeName()} {name}"))
    if supported is not None and plain(value) not in supported:
        is_array = attribute.GetTypeName().isArray
        choices = ", ".join(_shown(choice, is_array) for choice in supported)
        hint = f"supported: {choices}" if choices else "leave it out"
        message = f'"{name}" = {_shown(plain(value), is_array)} is not supported yet'
        yield problem(attribute, "not-yet-supported", message, hint=hint, time=time)


def _shown(value: Any, is_array: bool) -> str:
    """A plain value as usda writes it."""
    return str(list(value)) if is_array else str(value)
