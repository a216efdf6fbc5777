"""Third-party layers: layers that a stage references, or has as payloads, and that define no plenScene prims.

Only their authors could mend them, and USD composes them as they are. An error of one of our own files is therefore no
problem in them, or a warning of what is drawn instead. A value that cannot be used is blocked in the session layer, so
that all readers see a stage without it. Sublayers of the stage are its own.
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
"""Codes of what USD ignores, or does as its documentation says."""
_BLOCKED = ("bad-token", "entries", "not-finite", "out-of-range", "wrong-type")
"""Codes of values that cannot be used."""
_OF_READERS = ("lamp-size", NotSupported.code, UnreadableValue.code)
"""Codes of readers: an input of a shader counts as not written, and a light is left out."""
_INSTEAD = {
    "asset-missing": "what it would bring is not drawn",
    "missing-target": "it counts as not written",
    "missing-xform-op": "the transform is that of the others",
    "usd-": "what it would bring is not drawn",
}
"""What is done instead, by the code of a problem that becomes a warning, or by the beginning of the code."""


def _referenced_layers(stage: Usd.Stage) -> frozenset[Sdf.Layer]:
    """Layers that are neither the stage's own nor any of its sublayers, and that define no plenScene prims."""
    layers = set(used_layers(stage)).difference(stage.GetLayerStack())
    tops = [stage.GetPseudoRoot(), *stage.GetPrototypes()]  # a prototype is visited once, whatever its instances
    for prim in chain.from_iterable(Usd.PrimRange(top, Usd.PrimAllPrimsPredicate) for top in tops):
        if not layers:
            break
        layers -= {spec.layer for spec in prim.GetPrimStack() if spec.layer in layers and _is_ours(spec)}
    return frozenset(layers)


def _is_ours(spec: Sdf.PrimSpec) -> bool:
    apis = spec.GetInfo("apiSchemas").GetAddedOrExplicitItems() if spec.HasInfo("apiSchemas") else []
    is_named = any(name.startswith("Plen") for name in [spec.typeName, *apis])
    return is_named or any(name.startswith("plen:") for name in spec.properties.keys())  # noqa: SIM118  # no dict


class ReferencedLayers(ThirdPartyLayers):
    """Third-party layers of a stage, and what becomes of the problems in them."""

    def __init__(self, stage: Usd.Stage) -> None:
        self._stage = stage
        self.layers = _referenced_layers(stage)
        self._files = {shown_path(layer.realPath) for layer in self.layers}

    def wrote(self, thing: Usd.Prim | Usd.Property) -> bool:
        """Whether the strongest opinion on a prim or property is of a third party."""
        return next((spec.layer for spec in specs(thing)), None) in self.layers

    def settled(self, problems: Iterable[Problem]) -> Iterator[Problem]:
        """The problems; those in third-party layers are left out, or are warnings of what is done instead."""
        misspelt = dict[str, list[Problem]]()  # by prim
        for fault in problems:
            thing = self._stage.GetObjectAtPath(fault.at) if fault.at else None
            # The stage may define a prim without a type, and a third party the type that a reader refuses.
            typed = saying(thing, "typeName") if isinstance(thing, Usd.Prim) and fault.code in _OF_READERS else []
            fault = at_opinion(typed[0], fault) if typed else fault
            if fault.file not in self._files or not (fault.is_error or fault.code in _SILENT):
                yield fault
            elif fault.code == "unknown-property" and "did you mean" in (fault.hint or ""):
                misspelt.setdefault((fault.at or "").partition(".")[0], []).append(fault)
            elif fault.code not in _SILENT:
                with Usd.EditContext(self._stage, self._stage.GetSessionLayer()):
                    mended = _mended(fault, thing)
                yield from mended
        for first, *others in misspelt.values():
            message = first.message + (f", nor {len(others)} others that are written" if others else "")
            yield replace(first, severity="warning", message=message)


def _mended(fault: Problem, thing: Usd.Object | None) -> list[Problem]:
    """A warning of what is done instead, written into the edit target; the error itself if nothing mends it."""
    instead = next((text for code, text in _INSTEAD.items() if fault.code.startswith(code)), None)
    if fault.code in _OF_READERS and thing and thing.GetPrim().HasAPI(UsdLux.LightAPI):
        UsdGeom.Imageable(thing.GetPrim()).CreatePurposeAttr(UsdGeom.Tokens.guide)
        instead = "it is left out"
    elif fault.code in (*_BLOCKED, *_OF_READERS) and isinstance(thing, Usd.Attribute):
        if (instead := _blocked(fault, thing)) is None:
            return []
    elif fault.code == "missing-xform-op" and isinstance(thing, Usd.Attribute):
        thing.Set([op for op in thing.Get() if is_op(thing.GetPrim(), op)])
    return [replace(fault, severity="warning", hint=instead) if instead else fault]


def _blocked(fault: Problem, attribute: Usd.Attribute) -> str | None:
    """Block a value, which counts as not written from now on; the value that counts, or None if nothing changes."""
    value = attribute.Get(Usd.TimeCode.EarliestTime())
    fallback = attribute.GetTypeName().defaultValue
    if value is None or (fault.code == "wrong-type" and type(value) is type(fallback)):
        return None
    if attribute.GetName() == "purpose":
        return "drawn are the purposes default and render"
    attribute.Block()
    if (fallback := attribute.Get(Usd.TimeCode.EarliestTime())) is not None:
        attribute.Set(fallback)
    return f"it counts as {attribute.Get() or 'not written'}"


def check_pictures(prims: Iterable[Usd.Prim], third_party: ThirdPartyLayers) -> Iterator[Problem]:
    """Problems of pictures that cannot be read; in third-party layers warnings of what is drawn instead."""
    named = [(prim, attribute) for prim in prims for attribute, _ in named_by(prim)]  # before any is taken out
    for prim, attribute in named:
        try:
            picture_of(attribute)
        except UnreadableValue as error:
            yield _without_picture(prim, error) if third_party.wrote(attribute) else of_reader(attribute, error)


def _without_picture(prim: Usd.Prim, error: UnreadableValue) -> Problem:
    """A warning of a picture that cannot be read; the texture, or that of a light, is taken out."""
    stage = prim.GetStage()
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        error.thing.Set(Sdf.AssetPath())
    fallback = prim.GetAttribute("inputs:fallback")
    has_own = fallback and fallback.HasAuthoredValue()
    instead = f"inputs:fallback of <{prim.GetPath()}>" if has_own else "what is drawn without it"
    return warning(error.thing, error.code, error.message, hint=f"drawn instead is {instead}")
