"""Checks of properties: misspelt, missing and meaningless ones, relationships with wrong targets, and values of a wrong
type, out of range, or not supported yet.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from pipeline.scene.usd.problems import Problem, authored_apis, did_you_mean, problem, shortened, shown_path, specs
from pipeline.scene.usd.usda_lines import line_of
from pipeline.scene.usd.values import (
    FOREIGN,
    LENS_DISTORTION,
    LENS_DISTORTION_NAMES,
    LONGEST_TEXT,
    Range,
    Rule,
    bad_text,
    numbers,
    plain,
    read,
    rule_of,
    schema_facts,
    target_paths,
)
from pipeline.spelling import nearest

_MOVES = Rule(span=FOREIGN["xformOp"])
_TARGETS_NAMED = 5
"""Number of missing targets of one relationship that are listed; further ones are counted."""
# Namespaces in which anybody may add properties to any prim.
_FREE_NAMESPACES = ("primvars:", "material:", "userProperties:", "inputs:", "outputs:", "collection:", "info:")
_FAMILIES = {
    "plen:apertureShape": "aperture-value",
    "plen:shape": "shape-value",
    "plen:typeTable": "microlens-types",
}
"""Error codes for missing or meaningless attributes, by the property that decides; all others share one code."""

_NAMED = 5
"""Number of wrong values of one attribute that are listed."""
_NO_TILT = ((0.0, 0.0),)
"""Supported tilts of a sensor [deg]: none yet."""
# Supported values of attributes for which the schemas allow more, with the prim type in front where it matters. All
# values of other attributes are supported.
SUPPORTED: dict[str, tuple[Any, ...]] = {
    "PlenSensor plen:tilt": _NO_TILT,
}
_LINE = re.compile(r"^\s*(Needed|Only) with: (\S+)(?: = (\S+(?:, \S+)*))?\s*$", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """A line `Needed with:` or `Only with:` of an attribute's documentation: the property that decides, and its values
    for which the condition holds; empty: any authored value.
    """

    name: str
    tokens: tuple[str, ...] = ()

    def holds(self, prim: Usd.Prim) -> bool | None:
        """Whether it holds for a prim; None if the deciding value is itself wrong."""
        if not self.tokens:
            return is_written(prim, self.name)
        value = read(prim, self.name)
        return None if value is None else value in self.tokens


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """All conditions of an attribute: needed if any of one kind holds, without meaning unless all of the other do."""

    needed: tuple[Condition, ...] = ()
    only: tuple[Condition, ...] = ()


def conditions_in(documentation: str) -> Conditions:
    """The conditions stated in a documentation."""
    stated: dict[str, list[Condition]] = {"Needed": [], "Only": []}
    for which, name, tokens in _LINE.findall(documentation):
        stated[which].append(Condition(name=name, tokens=tuple(tokens.split(", ")) if tokens else ()))
    return Conditions(needed=tuple(stated["Needed"]), only=tuple(stated["Only"]))


_KNOWN: dict[tuple[str, tuple[str, ...]], dict[str, Conditions]] = {}


def conditions_of(prim: Usd.Prim) -> dict[str, Conditions]:
    """Conditions of the attributes of a prim that have some, by name."""
    key = (str(prim.GetTypeName()), tuple(prim.GetAppliedSchemas()))
    if key not in _KNOWN:
        definition = prim.GetPrimDefinition()
        names = (name for name in definition.GetPropertyNames() if name.startswith("plen:"))
        stated = {name: conditions_in(definition.GetPropertyMetadata(name, "documentation") or "") for name in names}
        _KNOWN[key] = {name: conditions for name, conditions in stated.items() if conditions != Conditions()}
    return _KNOWN[key]


def is_written(prim: Usd.Prim, name: str) -> bool:
    """Whether a stage sets a property to something.

    A relationship without targets, an empty text or array, and the fallback count as not set: a stage writes them to
    cancel an opinion of a weaker file.
    """
    rule = rule_of(prim, name)
    if rule is None:
        return bool(target_paths(prim.GetRelationship(name)))
    if not prim.GetAttribute(name).HasAuthoredValue():
        return False
    value = read(prim, name)
    return value is None or value not in ((), "", rule.fallback)


def check_properties(prim: Usd.Prim) -> Iterator[Problem]:
    """Problems of the authored properties of a prim, and of required properties that it lacks."""
    definition = prim.GetPrimDefinition()
    known = set(definition.GetPropertyNames())
    strange = []
    for prop in prim.GetAuthoredProperties():
        if prop.GetName().startswith("xformOp:") and prim.IsA(UsdGeom.Xformable):
            for time, value in authored_values(prop):
                yield from check_value(prop, value, time, _MOVES)
        elif prop.GetName() not in known:
            strange.append(prop.GetName())
            yield from _check_unknown(prop, known)
        elif wrong := _wrong_kind(prop, definition):
            yield wrong
        elif isinstance(prop, Usd.Attribute):
            yield from check_attribute(prop, definition)
        else:
            yield from _check_relationship(prop)
    meant = {nearest(name, known) for name in strange}
    yield from _check_required(prim, meant)
    yield from _check_conditions(prim, meant)


def _wrong_kind(prop: Usd.Property, definition: Usd.PrimDefinition) -> Problem | None:
    """A problem if an attribute is written where the schema has a relationship, or the other way round: USD follows
    the schema.
    """
    wants_relationship = bool(definition.GetRelationshipDefinition(prop.GetName()))
    for spec in specs(prop):
        if isinstance(spec, Sdf.RelationshipSpec) != wants_relationship:
            kind = "a relationship (rel)" if wants_relationship else "an attribute"
            return problem(prop, "wrong-type", f'"{prop.GetName()}" must be written as {kind}')
    return None


def _check_unknown(prop: Usd.Property, known: set[str]) -> Iterator[Problem]:
    prim, name = prop.GetPrim(), prop.GetName()
    is_ours = name.startswith("plen:")  # plen: names are never extra data
    if not is_ours and (prop.IsCustom() or name.startswith(_FREE_NAMESPACES) or _is_of_others(prop)):
        return
    type_name = prim.GetPrimTypeInfo().GetSchemaTypeName()
    if type_name or is_ours:
        hint = did_you_mean(name, known) or _hint(prop, is_ours, known)
        yield problem(prop, "unknown-property", f'{type_name or "this prim"} has no property "{name}"', hint=hint)


def _is_of_others(prop: Usd.Property) -> bool:
    """Whether a property belongs to a schema of Omniverse that is applied to its camera: programs that know the
    schema do not write "custom".
    """
    prim = prop.GetPrim()
    is_named = str(prop.GetName()).startswith(LENS_DISTORTION_NAMES)
    return is_named and prim.GetTypeName() == "Camera" and not LENS_DISTORTION.isdisjoint(authored_apis(prim))


def _hint(prop: Usd.Property, is_ours: bool, known: set[str]) -> str | None:
    """A hint for an unknown property."""
    if not is_ours:
        return 'write "custom" in front of it if it is meant to be extra data'
    prim = prop.GetPrim()
    api = {"Camera": "PlenCameraAPI", "Mesh": "PlenOccluderAPI"}.get(str(prim.GetTypeName()))
    if prop.GetName().startswith("plen:response:"):
        api = "PlenSensorResponseAPI"
    if api and api not in prim.GetAppliedSchemas():
        return f'apply {api}: prepend apiSchemas = ["{api}"]'
    namespace = prop.GetNamespace()
    names = sorted(name for name in known if name.rpartition(":")[0] == namespace)
    return f"remove it; there are {', '.join(names)}" if names else None


def _check_required(prim: Usd.Prim, meant: set[str | None]) -> Iterator[Problem]:
    """Problems of required names that are missing; `meant` holds those that are present but misspelt."""
    if not _is_meant_to_be_built(prim):
        return
    for name in [name for names in schema_facts(prim, "plenRequired") for name in names if name not in meant]:
        relationship = prim.GetRelationship(name)
        if not (target_paths(relationship) if relationship else prim.GetAttribute(name).HasAuthoredValue()):
            wanted = wanted_target(prim, name)
            hint = f"point it at a {wanted}" if wanted else "it has no fallback: write it"
            yield problem(prim, "missing-value", f'{prim.GetTypeName()} needs "{name}"', hint=hint)


def _is_meant_to_be_built(prim: Usd.Prim) -> bool:
    """Whether a prim is complete and has a type that its applied schemas allow; `check_prim` reports others."""
    ours = [name for name in prim.GetAppliedSchemas() if name.startswith("Plen")]
    return not prim.IsAbstract() and all(prim.CanApplyAPI(name) for name in ours)


def _check_conditions(prim: Usd.Prim, meant: set[str | None]) -> Iterator[Problem]:
    """Problems of attributes that other values require, or that have no meaning beside them; `meant` as above."""
    for name, rules in conditions_of(prim).items() if _is_meant_to_be_built(prim) else ():
        written = is_written(prim, name)
        needing = next((rule for rule in rules.needed if rule.holds(prim)), None)
        if needing and not written and name not in meant:
            place = prim if needing.tokens else prim.GetAttribute(needing.name) or prim
            code = _FAMILIES.get(needing.name, "missing-value")
            hint = "it has no fallback: write it" if needing.tokens else f"write it, or leave {needing.name} out"
            yield problem(place, code, f'{_stated(needing, prim)} needs "{name}"', hint=hint)
        failing = next((rule for rule in rules.only if rule.holds(prim) is False), None)
        if written and failing:
            what = f'"{name}" has no effect {_without(failing, prim)}'
            place, code = prim.GetAttribute(name), _FAMILIES.get(failing.name, "unused-value")
            yield problem(place, code, what, hint=f"remove it, or write {_wanted(failing)}")


def _stated(rule: Condition, prim: Usd.Prim) -> str:
    """The value that a stage has for the property of a condition, as a quotation."""
    return f'"{rule.name}" = "{read(prim, rule.name)}"' if rule.tokens else f'"{rule.name}"'


def _without(rule: Condition, prim: Usd.Prim) -> str:
    return f"with {_stated(rule, prim)}" if rule.tokens else f'without "{rule.name}"'


def _wanted(rule: Condition) -> str:
    """The statement with which a condition would hold."""
    tokens = " or ".join(f'"{token}"' for token in rule.tokens)
    return f"{rule.name} = {tokens}" if tokens else rule.name


def _check_relationship(relationship: Usd.Relationship) -> Iterator[Problem]:
    stage, name = relationship.GetStage(), relationship.GetName()
    wanted = wanted_target(relationship.GetPrim(), name)
    missing = [path for path in target_paths(relationship) if not stage.GetObjectAtPath(path)]
    fitting = [str(prim.GetPath()) for prim in stage.TraverseAll() if not wanted or prim.IsA(wanted)] if missing else []
    for path in missing[:_TARGETS_NAMED]:
        there = f"of this kind there are {', '.join(fitting[:_TARGETS_NAMED])}" if wanted and fitting else None
        hint = did_you_mean(str(path), fitting) or there
        message = f'"{name}" points at <{path}>, which does not exist'
        yield problem(relationship, "missing-target", message, hint=hint)
    if len(missing) > _TARGETS_NAMED:
        message = f'"{name}" points at {len(missing) - _TARGETS_NAMED:,} others that do not exist'
        yield problem(relationship, "missing-target", message)
    for path in target_paths(relationship) if wanted else ():
        prim = stage.GetPrimAtPath(path)
        if stage.GetObjectAtPath(path) and not (prim and prim.IsA(wanted)):
            got = (prim.GetTypeName() or "prim without a type") if prim else "property"
            yield problem(relationship, "wrong-target", f'"{name}" must point at a {wanted}; <{path}> is a {got}')
        elif prim and not prim.IsActive():
            yield problem(relationship, "wrong-target", f'"{name}" points at <{path}>, which is not active')


def wanted_target(prim: Usd.Prim, name: str) -> str | None:
    """The type of prim to which a relationship must point by our plugInfo.json."""
    return next((types[name] for types in schema_facts(prim, "plenTargets") if name in types), None)


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
    name, values = attribute.GetName(), numbers(value)
    outside = np.flatnonzero(~(span.holds(values) if span else np.isfinite(values)))
    if not len(outside):
        return
    number = float(values[outside[0]])
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
