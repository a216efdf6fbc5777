"""Checks of layers: where they lie, their units, axes and times, and what they write twice."""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from pxr import Ar, Sdf, Usd, UsdGeom

from pipeline.scene.usd.plug_in import ThirdPartyLayers
from pipeline.scene.usd.poses import LAST_FRAME
from pipeline.scene.usd.problems import Problem, metadata_problem, shown_path
from pipeline.scene.usd.roots import OUTSIDE_HINT, file_of, is_inside, real_path, used_layers
from pipeline.scene.usd.usda_lines import text_map
from pipeline.scene.usd.values import Range

# Layer metadata, its fallback, and the behaviour of USD if layers disagree.
_SAME_IN_ALL_LAYERS = (
    ("metersPerUnit", 0.01, "USD does not convert lengths between layers"),
    ("timeCodesPerSecond", 24.0, "USD would rescale the time codes of the samples"),
    ("upAxis", "Y", "USD does not turn referenced scenes"),
)

# Layer metadata that must be numbers of a sane size: nanometres to kilometres, frames, frames per second.
_NUMBERS = {
    "metersPerUnit": Range(low=1e-9, high=1e3),
    "startTimeCode": Range(low=-LAST_FRAME, high=LAST_FRAME),
    "endTimeCode": Range(low=-LAST_FRAME, high=LAST_FRAME),
    "timeCodesPerSecond": Range(low=1e-6, high=1e9),
    "framesPerSecond": Range(low=1e-6, high=1e9),
}


def check_used(stage: Usd.Stage, roots: list[Path]) -> list[Problem]:
    """Problems of layers that lie outside all roots, each at the line that names it, or else line 1 of the root."""
    layers = used_layers(stage)
    outside = {file: layers[0].realPath for layer in layers if not is_inside(file := file_of(layer.realPath), roots)}
    users: dict[str, tuple[str, int]] = {}
    with Ar.ResolverContextBinder(stage.GetPathResolverContext()):
        for layer in layers if outside else ():
            for asset in layer.GetCompositionAssetDependencies():
                file = Ar.GetResolver().Resolve(file_of(layer.ComputeAbsolutePath(asset))).GetPathString()
                if file in outside and file_of(layer.realPath) not in outside:
                    users.setdefault(file, (layer.realPath, text_map(layer.realPath).assets.get(asset, 1)))
    return [
        Problem(
            code="asset-outside",
            message=f"{shown_path(real_path(file))} lies outside the folders that a stage may read",
            file=shown_path(user),
            line=line,
            hint=OUTSIDE_HINT,
        )
        for file, (user, line) in (users or {file: (root, 1) for file, root in outside.items()}).items()
    ]


def check_layers(stage: Usd.Stage, third_party: ThirdPartyLayers) -> Iterator[Problem]:
    """Problems of our own layers."""
    layers = [layer for layer in used_layers(stage) if layer not in third_party.layers]
    yield from _check_root(stage)
    yield from _check_same_in_all(layers)
    for layer in layers:
        file = shown_path(layer.realPath)
        for code, path, message, hint, line in text_map(layer.realPath).flaws:
            yield Problem(code=code, message=message, file=file, line=line, at=path or None, hint=hint)


def _check_root(stage: Usd.Stage) -> Iterator[Problem]:
    """Problems of the unit and the up axis, which USD takes from the root layer."""
    root = stage.GetRootLayer()
    if not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        hint = "USD falls back to centimetres (0.01); write metersPerUnit = 0.001"
        yield metadata_problem(root, "metersPerUnit", "units", "the stage does not set metersPerUnit", hint=hint)
    hint = 'write upAxis = "Y"'
    if not stage.HasAuthoredMetadata(UsdGeom.Tokens.upAxis):
        missing = metadata_problem(root, "upAxis", "up-axis", "the stage does not set upAxis", hint=hint)
        yield replace(missing, severity="warning")
    elif (axis := UsdGeom.GetStageUpAxis(stage)) not in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
        yield metadata_problem(root, "upAxis", "up-axis", f'upAxis = "{axis:.40}" is neither Y nor Z', hint=hint)


def check_numbers(stage: Usd.Stage, third_party: ThirdPartyLayers) -> Iterator[Problem]:
    """Problems of units and times of layers; in third-party layers of rates alone: by NaN USD scales without end."""
    for layer, (key, span) in itertools.product(used_layers(stage), _NUMBERS.items()):
        value = _info(layer, key, None) if layer not in third_party.layers or key.endswith("PerSecond") else None
        if value is not None and not span.holds(value):
            yield metadata_problem(layer, key, "out-of-range", f"{key} = {value} is outside {span}")


def _check_same_in_all(layers: list[Sdf.Layer]) -> Iterator[Problem]:
    """Problems of metadata in which layers differ from the root layer, the first of them."""
    root, *used = layers
    for key, fallback, reason in _SAME_IN_ALL_LAYERS:
        wanted = _info(root, key, fallback)
        values = [_info(layer, key, fallback) for layer in used]
        if len(used) > 1 and len(set(values)) == 1 and values[0] != wanted:  # reported once, at the root
            message = f"{key} is {wanted} here and {values[0]} in all {len(used)} layers that it uses"
            hint = f"{reason}: say what they say, and write what follows in it"
            yield metadata_problem(root, key, f"layer-{key}", message, hint=hint)
            continue
        for layer, value in zip(used, values, strict=True):
            if value != wanted:
                message = f"{key} is {value} here and {wanted} in {shown_path(root.realPath)}"
                yield replace(metadata_problem(layer, key, f"layer-{key}", message, hint=reason), line=1)


def _info(layer: Sdf.Layer, key: str, fallback: object) -> object:
    """Metadata of a layer as it is written there, or a fallback."""
    root = layer.pseudoRoot
    return root.GetInfo(key) if root.HasInfo(key) else fallback
