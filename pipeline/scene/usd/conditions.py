"""Conditions of attributes, from the documentation in the schemas: when one is needed, and when it has no meaning."""

import re
from dataclasses import dataclass

from pxr import Usd

from pipeline.scene.usd.values import read, rule_of, target_paths

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
        _KNOWN[key] = {name: one for name, one in stated.items() if one != Conditions()}
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
