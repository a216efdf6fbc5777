"""Source locations: file and line of the strongest opinion on a prim or property."""

from pxr import Sdf, Usd

from pipeline.scene.usd.problems import Problem, shown_path
from pipeline.scene.usd.usda_lines import line_of, line_of_metadata, sample_key


def problem(
    thing: Usd.Prim | Usd.Property,
    code: str,
    message: str,
    *,
    hint: str | None = None,
    severity: str = "error",
    time: float | None = None,
) -> Problem:
    """A problem at a prim, a property or, with `time`, one of its time samples."""
    file, line = place(thing, time)
    return Problem(
        severity=severity, code=code, message=message, file=file, line=line, at=str(thing.GetPath()), hint=hint
    )


def metadata_problem(
    layer: Sdf.Layer, key: str, code: str, message: str, *, hint: str | None = None, at: str | None = None
) -> Problem:
    """A problem at the line of metadata of a layer, or at its first line."""
    line = line_of_metadata(layer.realPath, key)
    return Problem(code=code, message=message, file=shown_path(layer.realPath), line=line, at=at, hint=hint)


def place(thing: Usd.Prim | Usd.Property, time: float | None = None) -> tuple[str | None, int | None]:
    """File (as messages show it) and line of the strongest authored opinion."""
    stack = specs(thing)
    if not stack:
        # Not authored: a fallback or something missing. Its prim is the place to write it.
        return place(thing.GetPrim()) if isinstance(thing, Usd.Property) else (None, None)
    file = stack[0].layer.realPath
    if not file:
        return None, None
    path = str(stack[0].path) + ("" if time is None else sample_key(_time_in_layer(thing, time)))
    return shown_path(file), line_of(file, path)


def _time_in_layer(thing: Usd.Prim | Usd.Property, time: float) -> float:
    """A time of the stage, converted to that of the file with the strongest opinion: a reference may shift and scale
    times.
    """
    if not isinstance(thing, Usd.Property):
        return time
    _, layer_to_stage = thing.GetPropertyStackWithLayerOffsets(Usd.TimeCode.Default())[0]
    return float(layer_to_stage.GetInverse() * time)


def specs(thing: Usd.Prim | Usd.Property) -> list[Sdf.Spec]:
    """Opinions on a prim or property, strongest first."""
    if isinstance(thing, Usd.Prim):
        return list(thing.GetPrimStack())
    return list(thing.GetPropertyStack(Usd.TimeCode.Default()))


def authored_apis(prim: Usd.Prim) -> list[str]:
    """Names of API schemas that are written in a file; `GetAppliedSchemas` would add those that they include."""
    edits = [spec.GetInfo("apiSchemas") for spec in prim.GetPrimStack() if spec.HasInfo("apiSchemas")]
    return list(dict.fromkeys(name for edit in edits for name in edit.GetAddedOrExplicitItems()))
