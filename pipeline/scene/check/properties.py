"""Checks of schemas and properties: misspelt, missing and meaningless ones, relationships with wrong targets, and
values of a wrong type, out of range, or not supported yet.
"""

import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from pxr import Plug, Sdf, Tf, Usd, UsdGeom

from pipeline.scene.usd.curves import written_times
from pipeline.scene.usd.poses import is_op, is_orient
from pipeline.scene.usd.problems import Problem, at_opinion, problem, saying, shortened, shown_path, specs
from pipeline.scene.usd.roots import PLUGIN_NAME, file_of
from pipeline.scene.usd.values import (
    FOREIGN,
    LENS_DISTORTION,
    LONGEST_TEXT,
    Condition,
    Range,
    Rule,
    UnreadableValue,
    bad_text,
    is_written,
    numbers,
    read,
    rule_of,
    rules_of,
    target_paths,
)
from pipeline.spelling import did_you_mean, nearest

FOR_NO_IMAGE = re.compile(
    r"(drive|limit|state|semantics?|omni|isaac|arnold|karma|redshift|ri|rtx):|physics|physx|newton|mjc|mujoco"
    r"|proxyPrim$|Render(Settings|Product|Var|Pass|DenoisePass)",
    re.IGNORECASE,
)
"""Beginnings of properties, types and schemas without effect on images: physics, semantics, settings of renderers."""
_TRANSFORM_RULE = Rule(span=FOREIGN["xformOp"])
_TARGETS_NAMED = 5
"""Most missing targets of a relationship that are listed; the rest are counted."""
# Namespaces in which anybody may add properties to any prim.
_FREE_NAMESPACES = ("primvars:", "material:", "userProperties:", "inputs:", "outputs:", "collection:", "info:")
_BINDINGS = ("material:binding", "material:binding:full", "material:binding:preview")
"""Relationships to materials."""
_PATHS = ("targetPaths", "connectionPaths")
"""Fields of relationships and of attributes that hold paths."""
_FAMILIES = {
    "plen:apertureShape": "aperture-value",
    "plen:shape": "shape-value",
    "plen:typeTable": "microlens-types",
}
"""Error codes for missing or meaningless attributes, by the property that decides; the rest share one code."""

_APIS = {"Camera": "PlenCameraAPI", "Mesh": "PlenOccluderAPI", "Material": "PlenGlassAPI"}
"""The schema to apply where a prim of a type has attributes of ours."""
_VALUES_NAMED = 5
"""Most wrong values of an attribute that are listed."""
_USE_INSTEAD = {("plen:truth:method", "moments"): 'the method is gone; use "direct", which is more exact;'}
"""Hints for values that were allowed once, by attribute and value."""


def check_properties(prim: Usd.Prim) -> Iterator[Problem]:
    """Problems of the authored properties of a prim, and of required properties that it lacks."""
    definition = prim.GetPrimDefinition()
    declared = set(definition.GetPropertyNames())
    unknown = []
    is_idle = FOR_NO_IMAGE.match(prim.GetTypeName())
    for prop in prim.GetAuthoredProperties():
        if FOR_NO_IMAGE.match(prop.GetName()) or (is_idle and not prop.GetName().startswith("plen:")):
            continue
        yield from _check_scope(prop)
        is_attribute = isinstance(prop, Usd.Attribute)
        if is_attribute and prop.GetName().startswith("xformOp:") and prim.IsA(UsdGeom.Xformable):
            yield from _check_op(prop)
        elif prop.GetName() in _BINDINGS and isinstance(prop, Usd.Relationship):
            yield from _check_relationship(prop)  # no schema declares it
        elif prop.GetName() not in declared:
            unknown.append(prop.GetName())
            yield from _check_unknown(prop, declared)
        elif any(isinstance(spec, Sdf.RelationshipSpec) != isinstance(prop, Usd.Relationship) for spec in specs(prop)):
            # USD follows the schema, whatever is written.
            kind = "a relationship (rel)" if isinstance(prop, Usd.Relationship) else "an attribute"
            yield problem(prop, "wrong-type", f'"{prop.GetName()}" must be written as {kind}')
        elif is_attribute:
            yield from _check_attribute(prop, definition)
        else:
            yield from _check_relationship(prop)
    ours = [name for name in prim.GetAppliedSchemas() if name.startswith("Plen")]
    if not prim.IsAbstract() and all(prim.CanApplyAPI(name) for name in ours):  # else it is not meant to be built
        misspelt = {nearest(name, declared) for name in unknown}
        yield from _check_required(prim, misspelt)
        yield from _check_conditions(prim, misspelt)


def check_apis(prim: Usd.Prim) -> Iterator[Problem]:
    """Problems of the API schemas that files apply to a prim."""
    registry = Usd.SchemaRegistry()
    opinions = dict[str, Sdf.Spec]()
    for spec in saying(prim, "apiSchemas"):  # `GetAppliedSchemas` would add those that they include
        opinions = dict.fromkeys(spec.GetInfo("apiSchemas").GetAddedOrExplicitItems(), spec) | opinions
    for full, spec in opinions.items():
        name, instance = registry.GetTypeNameAndInstance(full)
        if FOR_NO_IMAGE.match(name) or (name in LENS_DISTORTION and prim.GetTypeName() == "Camera"):
            continue
        if not registry.FindAppliedAPIPrimDefinition(name):
            schemas = known_types("UsdAPISchemaBase", Usd.SchemaRegistry().GetAPISchemaTypeName)
            hint = did_you_mean(name, schemas | LENS_DISTORTION)
            if hint or name.startswith("Plen"):  # else another program's, which USD keeps
                yield at_opinion(spec, problem(prim, "unknown-api", f'unknown API schema "{name}"', hint=hint))
            continue
        # Files and ApplyAPI() ignore apiSchemaCanOnlyApplyTo; only this call respects it.
        if registry.IsMultipleApplyAPISchema(name) != bool(instance):
            reason = f'the API schema "{full}" {"takes no name" if instance else "needs a name"} behind a colon'
        else:
            reason = prim.CanApplyAPI(*([name, instance] if instance else [name])).whyNot
        if reason:
            yield at_opinion(spec, problem(prim, "api-not-applicable", reason))


def known_types(base: str, name_of: Callable[[Tf.Type], str]) -> set[str]:
    """Names of all schemas of a kind."""
    return {name_of(kind) for kind in Plug.Registry().GetAllDerivedTypes(Tf.Type.FindByName(base))} - {""}


def _check_scope(prop: Usd.Property) -> Iterator[Problem]:
    """A problem of paths to prims that a reference leaves out: USD drops them in silence."""
    is_attribute = isinstance(prop, Usd.Attribute)
    if not (prop.HasAuthoredConnections() if is_attribute else prop.HasAuthoredTargets()):
        return
    if spec := next((each for each in specs(prop) if each.HasInfo(_PATHS[is_attribute])), None):
        paths = spec.GetInfo(_PATHS[is_attribute]).GetAddedOrExplicitItems()
        if paths and not (prop.GetConnections() if is_attribute else target_paths(prop)):
            name = prop.GetName()
            lost = paths[0].GetPrimPath()
            message = f'"{name}" points at <{paths[0]}> of its file, which the reference leaves out: it does not count'
            reference = f'def "{lost.name}" (references = @{shown_path(file_of(spec.layer.realPath))}@<{lost}>)'
            hint = (
                f"reference it as well, {reference}, and name its path here in an over; or reference a prim above both"
            )
            severity = "error" if name.startswith("plen:") else "warning"
            yield at_opinion(spec, problem(prop, "outside-reference", message, hint=hint, severity=severity))


def _check_op(attribute: Usd.Attribute) -> Iterator[Problem]:
    """Problems of an operation of a transform; USD takes the identity for one whose type is none of its kind."""
    if not is_op(attribute.GetPrim(), attribute.GetName()):
        return  # which the check of the order says
    op = UsdGeom.XformOp(attribute)
    try:
        op.GetOpTransform(Usd.TimeCode.EarliestTime())
        if is_orient(op):  # of which USD says nothing above
            op.GetPrecision()
    except Tf.ErrorException:
        message = f'"{attribute.GetName()}" cannot be read as {attribute.GetTypeName()}'
        hint = "write it with a type that USD documents for it, such as double3 for translate"
        yield problem(attribute, UnreadableValue.code, message, hint=hint)
        return
    for time, value in _authored_values(attribute):
        if type(value) is not type(attribute.GetTypeName().defaultValue) or not _TRANSFORM_RULE.holds(value):
            yield from _check_value(attribute, value, time, _TRANSFORM_RULE)


def _check_unknown(prop: Usd.Property, declared: set[str]) -> Iterator[Problem]:
    """A problem of a property that no schema of its prim declares, unless it may be extra data."""
    prim, name = prop.GetPrim(), prop.GetName()
    is_ours = name.startswith("plen:")  # plen: names are never extra data
    if not is_ours and (prop.IsCustom() or name.startswith(_FREE_NAMESPACES)):
        return
    type_name = prim.GetPrimTypeInfo().GetSchemaTypeName()
    hint = did_you_mean(name, declared)
    if not is_ours and not (type_name and (hint or type_name.startswith("Plen"))):  # programs add what they like
        return
    api = _APIS.get(str(prim.GetTypeName()))
    if name.startswith("plen:response:"):
        api = "PlenSensorResponseAPI"
    if not hint and not is_ours:
        hint = 'write "custom" in front of it if it is meant to be extra data'
    elif not hint and api and api not in prim.GetAppliedSchemas():
        hint = f'apply {api}: prepend apiSchemas = ["{api}"]'
    elif not hint and (names := sorted(other for other in declared if other.rpartition(":")[0] == prop.GetNamespace())):
        hint = f"remove it; there are {', '.join(names)}"
    yield problem(prop, "unknown-property", f'{type_name or "this prim"} has no property "{name}"', hint=hint)


def _check_required(prim: Usd.Prim, misspelt: set[str | None]) -> Iterator[Problem]:
    """Problems of required names that are missing; those in `misspelt` are not reported a second time."""
    for name in [name for names in _schema_facts(prim, "plenRequired") for name in names if name not in misspelt]:
        relationship = prim.GetRelationship(name)
        if not (target_paths(relationship) if relationship else prim.GetAttribute(name).HasAuthoredValue()):
            target_type = _wanted_target(prim, name)
            hint = f"point it at a {target_type}" if target_type else "it has no fallback: write it"
            yield problem(prim, "missing-value", f'{prim.GetTypeName()} needs "{name}"', hint=hint)


def _check_conditions(prim: Usd.Prim, misspelt: set[str | None]) -> Iterator[Problem]:
    """Problems of attributes that other values require, or that have no meaning beside them; `misspelt` as above."""

    def stated(condition: Condition) -> str:
        name = condition.name
        return f'"{name}" = "{read(prim, name)}"' if condition.tokens else f'"{name}"'

    for name, rule in ((name, rule) for name, rule in rules_of(prim).items() if rule.conditions):
        is_present = is_written(prim, name)
        needing = next(
            (condition for condition in rule.conditions if condition.kind == "Needed" and condition.holds(prim)), None
        )
        if needing and not is_present and name not in misspelt:
            thing = prim if needing.tokens else prim.GetAttribute(needing.name) or prim
            code = _FAMILIES.get(needing.name, "missing-value")
            hint = "it has no fallback: write it" if needing.tokens else f"write it, or leave {needing.name} out"
            yield problem(thing, code, f'{stated(needing)} needs "{name}"', hint=hint)
        unmet = next(
            (condition for condition in rule.conditions if condition.kind == "Only" and condition.holds(prim) is False),
            None,
        )
        if is_present and unmet:
            message = f'"{name}" has no effect {"with" if unmet.tokens else "without"} {stated(unmet)}'
            tokens = " or ".join(f'"{token}"' for token in unmet.tokens)
            hint = f"remove it, or write {unmet.name}{' = ' if tokens else ''}{tokens}"
            code = _FAMILIES.get(unmet.name, "unused-value")
            yield problem(prim.GetAttribute(name), code, message, hint=hint)


def _existing(stage: Usd.Stage, missing: Sdf.Path, wanted: str | None) -> list[str]:
    """Candidates for the path that a relationship meant: prims of the wanted type, or properties."""
    if not missing.IsPropertyPath():
        return [str(prim.GetPath()) for prim in stage.TraverseAll() if not wanted or prim.IsA(wanted)]
    if prim := stage.GetPrimAtPath(missing.GetPrimPath()):
        return [str(prop.GetPath()) for prop in prim.GetProperties()]
    return [str(prim.GetPath().AppendProperty(missing.name)) for prim in stage.TraverseAll()
            if prim.HasProperty(missing.name)]  # fmt: skip


def _check_relationship(relationship: Usd.Relationship) -> Iterator[Problem]:
    """Problems of targets that do not exist, have a wrong type, or are not active."""
    stage, name = relationship.GetStage(), relationship.GetName()
    wanted = _wanted_target(relationship.GetPrim(), name)
    missing = [path for path in target_paths(relationship) if not stage.GetObjectAtPath(path)]
    for path in missing[:_TARGETS_NAMED]:
        fitting = _existing(stage, path, wanted)
        is_specific = wanted not in (None, "Imageable") and fitting  # nearly all prims are imageable
        choices = f"of this kind there are {', '.join(fitting[:_TARGETS_NAMED])}" if is_specific else None
        message = f'"{name}" points at <{path}>, which does not exist'
        yield problem(relationship, "missing-target", message, hint=did_you_mean(str(path), fitting) or choices)
    if len(missing) > _TARGETS_NAMED:
        message = f'"{name}" points at {len(missing) - _TARGETS_NAMED:,} others that do not exist'
        yield problem(relationship, "missing-target", message)
    for path in target_paths(relationship) if wanted else ():
        prim = stage.GetPrimAtPath(path)
        if stage.GetObjectAtPath(path) and not (prim and prim.IsA(wanted)):
            actual_type = (prim.GetTypeName() or "prim without a type") if prim else "property"
            yield problem(
                relationship, "wrong-target", f'"{name}" must point at a {wanted}; <{path}> is a {actual_type}'
            )
        elif prim and not prim.IsActive():
            yield problem(relationship, "wrong-target", f'"{name}" points at <{path}>, which is not active')


def _schema_facts(prim: Usd.Prim, key: str) -> list[Any]:
    """Entries under `key` in our plugInfo.json for the type and the applied schemas of a prim."""
    registry = Usd.SchemaRegistry()
    facts = []
    for schema in [prim.GetPrimTypeInfo().GetSchemaTypeName(), *prim.GetAppliedSchemas()]:
        identifier, _ = registry.GetTypeNameAndInstance(schema)
        tf_type = registry.GetTypeFromSchemaTypeName(identifier)
        plugin = None if tf_type == Tf.Type.Unknown else Plug.Registry().GetPluginForType(tf_type)
        if plugin and plugin.name == PLUGIN_NAME:
            fact = plugin.GetMetadataForType(tf_type).get(key)
            facts += [fact] if fact is not None else []
    return facts


def _wanted_target(prim: Usd.Prim, name: str) -> str | None:
    """The type of prim to which a relationship must point by our plugInfo.json."""
    return next((types[name] for types in _schema_facts(prim, "plenTargets") if name in types), None)


def _check_attribute(attribute: Usd.Attribute, definition: Usd.PrimDefinition) -> Iterator[Problem]:
    """Problems of one authored attribute that a schema defines."""
    name = attribute.GetName()
    schema = definition.GetAttributeDefinition(name)
    wanted = schema.GetTypeName()
    # The composed attribute has the type of the schema; only the opinions show the written type.
    # USD takes types that hold the same, as point3f and float3, for each other.
    if wrong := [spec for spec in specs(attribute) if spec.typeName.type != wanted.type]:
        for spec in wrong:
            message = f'"{name}" must be written as {wanted}, not {spec.typeName}'
            is_duration = name.startswith("plen:shutter:") and wanted == Sdf.ValueTypeNames.Double2
            hint = "seconds as a fraction: (1, 1000) is a millisecond" if is_duration else None
            yield at_opinion(spec, problem(attribute, "wrong-type", message, hint=hint))
        return  # values of a wrong type would confuse the further checks
    is_sampled = attribute.GetNumTimeSamples() or attribute.HasSpline()
    if schema.GetVariability() == Sdf.VariabilityUniform and is_sampled:
        yield problem(attribute, "uniform-animated", f'"{name}" is uniform and cannot have time samples or a spline')
    if name.startswith("plen:") and any(spec.HasInfo("allowedTokens") for spec in specs(attribute)):
        yield problem(
            attribute, "own-tokens", f'"{name}" has the allowedTokens of its schema alone', hint="remove them"
        )
    rule = rule_of(attribute.GetPrim(), name)
    for time, value in _authored_values(attribute):
        if not (rule and rule.holds(value)):  # which costs less
            yield from list(_check_value(attribute, value, time, rule)) or _check_tokens(attribute, value, time)


def _check_value(attribute: Usd.Attribute, value: Any, time: float | None, rule: Rule | None) -> Iterator[Problem]:
    """Problems of one value as read by USD: it must have the right type and length, and be finite and in range."""
    name, wanted = attribute.GetName(), attribute.GetTypeName()
    if type(value) is not type(wanted.defaultValue):
        yield problem(attribute, "wrong-type", f'"{name}" must hold a {wanted}, not {shortened(str(value))}', time=time)
    elif rule and rule.entries and not rule.entries[0] <= len(value) <= rule.entries[1]:
        fewest, most = rule.entries
        yield problem(attribute, "entries", f'"{name}" has {len(value)} entries, not {fewest} to {most}', time=time)
    else:
        if (text := bad_text(value)) is not None:
            flaw, hint = "characters that cannot be printed", "remove line breaks, tabs and control characters"
            if len(text) > LONGEST_TEXT:
                flaw, hint = f"a text of {len(text):,} characters", f"{LONGEST_TEXT:,} are the most"
            yield problem(attribute, "text", f'"{name}" holds {flaw}: {shortened(text)}', hint=hint, time=time)
        yield from _check_numbers(attribute, value, time, rule.span if rule else None)


def _authored_values(attribute: Usd.Attribute) -> Iterator[tuple[float | None, Any]]:
    """Pairs of a time (None for the default value) and the value of USD then; of a spline at knots and between."""
    if not attribute.HasAuthoredValue():
        return
    default = attribute.Get()
    if default is not None:
        yield None, default
    for time in written_times(attribute):
        if (value := attribute.Get(time)) is not None:
            yield time.GetValue(), value


def _check_tokens(attribute: Usd.Attribute, value: Any, time: float | None) -> Iterator[Problem]:
    """Problems of tokens that the schema of an attribute does not allow."""
    schema = attribute.GetPrim().GetPrimDefinition()
    allowed = list(schema.GetPropertyMetadata(attribute.GetName(), "allowedTokens") or [])
    wrong = dict.fromkeys([value] if isinstance(value, str) else value) if allowed else {}
    for token in [token for token in wrong if token not in allowed][:_VALUES_NAMED]:
        choices = f"allowed: {', '.join(allowed)}"
        guess = _USE_INSTEAD.get((attribute.GetName(), token)) or did_you_mean(token, allowed)
        message = f'"{shortened(token)}" is not a value of "{attribute.GetName()}"'
        yield problem(attribute, "bad-token", message, hint=f"{guess} {choices}" if guess else choices, time=time)


def _check_numbers(attribute: Usd.Attribute, value: Any, time: float | None, span: Range | None) -> Iterator[Problem]:
    """A problem of the first number of a value that is not finite or outside its range."""
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
        hint = None
        if name.endswith("avelength") and number < 100:
            hint = "wavelengths are nanometres: 0.55 µm are 550"
        elif name == "plen:index" and number < 0:
            hint = "a negative index is a mirror in other programs; mirrors are not simulated"
        yield problem(attribute, "out-of-range", message, hint=hint, time=time)
