"""Checks of layers: statements on which all layers of a stage must agree, and statements that USD drops silently."""

from collections.abc import Iterator

from pxr import Sdf, Usd, UsdGeom

from pipeline.scene.read.prims import LAST_FRAME
from pipeline.scene.usd.problems import Problem, shown_path
from pipeline.scene.usd.usda_lines import line_of_metadata, text_map
from pipeline.scene.usd.used_layers import used_layers
from pipeline.scene.usd.values import Range

# Layer metadata, its fallback, and the behaviour of USD if layers disagree.
_ALIKE = (
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
}


def check_layers(stage: Usd.Stage) -> list[Problem]:
    """Problems of the layers themselves."""
    numbers = list(_check_numbers(stage))
    alike = numbers or _check_alike(stage)
    return [*_check_root(stage), *alike, *_check_repeated(stage), *_check_cut(stage)]


def _check_root(stage: Usd.Stage) -> Iterator[Problem]:
    file = shown_path(stage.GetRootLayer().realPath)
    if not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        hint = "USD falls back to centimetres (0.01); write metersPerUnit = 0.001"
        yield Problem(code="units", message="the stage does not set metersPerUnit", file=file, line=1, hint=hint)
    hint = 'write upAxis = "Y"'
    if not stage.HasAuthoredMetadata(UsdGeom.Tokens.upAxis):
        message = "the stage does not set upAxis"
        yield Problem(severity="warning", code="up-axis", message=message, file=file, line=1, hint=hint)
    elif (axis := UsdGeom.GetStageUpAxis(stage)) not in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
        line = line_of_metadata(stage.GetRootLayer().realPath, "upAxis")
        message = f'upAxis = "{axis:.40}" is neither Y nor Z'
        yield Problem(code="up-axis", message=message, file=file, line=line, hint=hint)


def _check_numbers(stage: Usd.Stage) -> Iterator[Problem]:
    for layer in used_layers(stage):
        for key, span in _NUMBERS.items():
            value = _info(layer, key, None)
            if value is not None and not span.holds(value):
                file, line = layer.realPath, line_of_metadata(layer.realPath, key)
                yield Problem(
                    code="out-of-range", message=f"{key} = {value} is outside {span}", file=shown_path(file), line=line
                )


def _check_alike(stage: Usd.Stage) -> Iterator[Problem]:
    root, *others = used_layers(stage)
    for key, fallback, why in _ALIKE:
        wanted, values = _info(root, key, fallback), [_info(layer, key, fallback) for layer in others]
        if len(others) > 1 and len(set(values)) == 1 and values[0] != wanted:
            yield _alone(root, key, f"{wanted} here and {values[0]} in all {len(others)} layers that it uses", why)
            continue
        for layer, value in zip(others, values, strict=True):
            if value != wanted:
                message = f"{key} is {value} here and {wanted} in {shown_path(root.realPath)}"
                yield Problem(code="layer-" + key, message=message, file=shown_path(layer.realPath), line=1, hint=why)


def _alone(root: Sdf.Layer, key: str, differs: str, why: str) -> Problem:
    """The problem that the root layer disagrees with all others, reported once, at the root."""
    file, line = shown_path(root.realPath), line_of_metadata(root.realPath, key)
    hint = f"{why}: say what they say, and write what follows in it"
    return Problem(code="layer-" + key, message=f"{key} is {differs}", file=file, line=line, hint=hint)


def _info(layer: Sdf.Layer, key: str, fallback: object) -> object:
    root = layer.pseudoRoot
    return root.GetInfo(key) if root.HasInfo(key) else fallback


def _check_repeated(stage: Usd.Stage) -> Iterator[Problem]:
    for layer in used_layers(stage):
        for path, what, line in text_map(layer.realPath).repeated:
            yield Problem(
                code="written-twice",
                message=what,
                file=shown_path(layer.realPath),
                line=line,
                at=path,
                hint="USD silently keeps the last one; remove one",
            )


def _check_cut(stage: Usd.Stage) -> Iterator[Problem]:
    for layer in used_layers(stage):
        for path, what, taken, line in text_map(layer.realPath).cut:
            yield Problem(
                code="not-whole",
                message=what,
                file=shown_path(layer.realPath),
                line=line,
                at=path or None,
                hint=f"USD would silently use {taken}",
            )
