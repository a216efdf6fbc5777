"""Layers of others: those that a stage references, or has as payloads, and in which nothing of ours is defined.

Only their authors could mend them, and USD composes them as they are. So what is an error in a file of ours is nothing
here, or a warning that says what is drawn instead; and a value that cannot be used is blocked in the session layer, so
that everything behind sees a stage without it. Sublayers of the stage are its own.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain

from pxr import Sdf, Usd, UsdGeom, UsdLux

from pipeline.plugins.scenes.reading.pictures import named_by, picture_of
from pipeline.scene.usd.plug_in import ThirdPartyLayers
from pipeline.scene.usd.poses import is_op
from pipeline.scene.usd.problems import Problem, at_opinion, of_reader, saying, shown_path, specs, warning
from pipeline.scene.usd.roots import used_layers
from pipeline.scene.usd.values import NotSupported, UnreadableValue

_SILENT = (
    *("api-not-applicable", "no-pose-sample", "over-without-def", "text", "uniform-animated", "unknown-api"),
    *("unknown-property", "unused-xform-op"),
)
"""Codes of what USD takes no notice of, or does as its documentation says."""
_BLOCKED = ("bad-token", "entries", "not-finite", "out-of-range", "wrong-type")
"""Codes of values that cannot be used."""
_OF_READERS = ("lamp-size", NotSupported.code, UnreadableValue.code)
"""Codes of what readers cannot use: an input of a shader counts as not written, and a light is left out."""
_INSTEAD = {
    "asset-missing": "what it would bring is not drawn",
    "missing-target": "it counts as not written",
    "missing-xform-op": "the transform is that of the others",
    "usd-": "what it would bring is not drawn",
}
"""Codes of what else is a warning, or their beginnings, and what is done instead."""


def _layers_of_others(stage: Usd.Stage) -> frozenset[Sdf.Layer]:
    """Layers that are neither the stage's own nor any of its sublayers, and define nothing of ours."""
    layers = set(used_layers(stage)).difference(stage.GetLayerStack())
    tops = [stage.GetPseudoRoot(), *stage.GetPrototypes()]  # a prototype is seen once, however many instances it has
    for prim in chain.from_iterable(Usd.PrimRange(top, Usd.PrimAllPrimsPredicate) for top in tops):
        if not layers:
            break
        layers -= {spec.layer for spec in prim.GetPrimStack() if spec.layer in layers and _is_ours(spec)}
    return frozenset(layers)


def _is_ours(spec: Sdf.PrimSpec) -> bool:
    apis = spec.GetInfo("apiSchemas").GetAddedOrExplicitItems() if spec.HasInfo("apiSchemas") else []
    is_named = any(name.startswith("Plen") for name in [spec.typeName, *apis])
    return is_named or any(name.startswith("plen:") for name in spec.properties.keys())  # noqa: SIM118  # no dict


class Others:
    """The layers of others of a stage, and what becomes of problems in them."""

    def __init__(self, stage: Usd.Stage) -> None:
        self._stage, self.layers = stage, _layers_of_others(stage)
        self._files = {shown_path(layer.realPath) for layer in self.layers}

    def wrote(self, thing: Usd.Prim | Usd.Property) -> bool:
        """Whether the strongest opinion on a prim or property is one of others."""
        return next((spec.layer for spec in specs(thing)), None) in self.layers

    def settled(self, problems: Iterable[Problem]) -> Iterator[Problem]:
        """The problems; those in layers of others are left out, or are warnings of what is done instead."""
        strange = dict[str, list[Problem]]()
        for each in problems:
            thing = self._stage.GetObjectAtPath(each.at) if each.at else None
            instead = next((text for code, text in _INSTEAD.items() if each.code.startswith(code)), None)
            typed = saying(thing, "typeName") if isinstance(thing, Usd.Prim) and each.code in _OF_READERS else []
            each = at_opinion(typed[0], each) if typed else each  # what a file of others makes of the stage's own prim
            if each.file not in self._files or not (each.is_error or each.code in _SILENT):
                yield each
            elif each.code in _OF_READERS and thing and thing.GetPrim().HasAPI(UsdLux.LightAPI):
                with Usd.EditContext(self._stage, self._stage.GetSessionLayer()):
                    UsdGeom.Imageable(thing.GetPrim()).CreatePurposeAttr(UsdGeom.Tokens.guide)
                yield replace(each, severity="warning", hint="it is left out")
            elif each.code in (*_BLOCKED, *_OF_READERS) and isinstance(thing, Usd.Attribute):
                yield from self._blocked(each, thing)
            elif instead:
                if each.code == "missing-xform-op" and isinstance(thing, Usd.Attribute):
                    with Usd.EditContext(self._stage, self._stage.GetSessionLayer()):
                        thing.Set([op for op in thing.Get() if is_op(thing.GetPrim(), op)])
                yield replace(each, severity="warning", hint=instead)
            elif each.code == "unknown-property" and "did you mean" in (each.hint or ""):
                strange.setdefault((each.at or "").partition(".")[0], []).append(each)
            elif each.code not in _SILENT:
                yield each
        for first, *more in strange.values():
            message = first.message + (f", nor {len(more)} others that are written" if more else "")
            yield replace(first, severity="warning", message=message)

    def _blocked(self, each: Problem, attribute: Usd.Attribute) -> Iterator[Problem]:
        """A warning of a value that counts as not written from now on; none if it does not count anyhow."""
        value, fallback = attribute.Get(Usd.TimeCode.EarliestTime()), attribute.GetTypeName().defaultValue
        if value is None or (each.code == "wrong-type" and type(value) is type(fallback)):
            return
        if attribute.GetName() == "purpose":
            yield replace(each, severity="warning", hint="drawn are the purposes default and render")
            return
        with Usd.EditContext(self._stage, self._stage.GetSessionLayer()):
            attribute.Block()
            if (fallback := attribute.Get(Usd.TimeCode.EarliestTime())) is not None:
                attribute.Set(fallback)
        yield replace(each, severity="warning", hint=f"it counts as {attribute.Get() or 'not written'}")


def check_pictures(prims: Iterable[Usd.Prim], others: ThirdPartyLayers) -> Iterator[Problem]:
    """Problems of pictures that cannot be read; in layers of others warnings, and what is drawn instead."""
    named = [(prim, attribute) for prim in prims for attribute, _ in named_by(prim)]  # before any is taken out
    for prim, attribute in named:
        try:
            picture_of(attribute)
        except UnreadableValue as error:
            yield _without_picture(prim, error) if others.wrote(attribute) else of_reader(attribute, error)


def _without_picture(prim: Usd.Prim, error: UnreadableValue) -> Problem:
    """A warning of a picture that cannot be read; the texture, or that of a light, is taken out."""
    stage = prim.GetStage()
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        error.thing.Set(Sdf.AssetPath())
    fallback = prim.GetAttribute("inputs:fallback")
    has_own = fallback and fallback.HasAuthoredValue()
    instead = f"inputs:fallback of <{prim.GetPath()}>" if has_own else "what is drawn without it"
    return warning(error.thing, error.code, error.message, hint=f"drawn instead is {instead}")
