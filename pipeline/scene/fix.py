"""Lines that USD viewers need and a stage lacks; `pipeline check --fix` inserts them into its text.

Text is only inserted: comments, layout and existing statements stay.
"""

import re
from pathlib import Path

from pxr import Sdf, Tf, Usd

from pipeline.errors import UsageError
from pipeline.frames import mm_per_unit
from pipeline.scene.camera import read_camera_entries
from pipeline.scene.check.stage import all_prims
from pipeline.scene.usd.opening import open_stage, write_out_instances
from pipeline.scene.usd.problems import shown_path
from pipeline.scene.usd.usda_lines import text_map
from pipeline.scene.write.flatten import fallback_types, pinhole, view_of

_VIEW = ("focalLength", "horizontalAperture", "verticalAperture")
_SHIFT = ("horizontalApertureOffset", "verticalApertureOffset")


def lacking(stage: Usd.Stage) -> dict[str, list[str]]:
    """Statements that viewers need and the root layer of a checked stage lacks, by the path of their prim; "" is the
    metadata of the layer. The instances of the stage are written out.
    """
    write_out_instances(stage)
    layer, lines = stage.GetRootLayer(), dict[str, list[str]]()
    used = {prim.GetTypeName() for prim in all_prims(stage)}
    authored = layer.pseudoRoot.GetInfo("fallbackPrimTypes") or {}
    missing = {name: kind[0] for name, kind in fallback_types(used).items() if name not in authored}
    if missing:
        lines[""] = [f'token[] {name} = ["{kind}"]' for name, kind in missing.items()]
    for entry in read_camera_entries(stage):
        prim, unit_mm = stage.GetPrimAtPath(entry.prim_path), mm_per_unit(layer.pseudoRoot.GetInfo("metersPerUnit"))
        view = {name: value for name, (_, value) in pinhole(view_of(entry), unit_mm).items()}
        names = [*_VIEW, *_SHIFT] if any(view.get(name) for name in _SHIFT) else _VIEW
        wanted = [name for name in names if name in view and not prim.GetAttribute(name).HasAuthoredValue()]
        if wanted and layer.GetPrimAtPath(prim.GetPath()):
            lines[entry.prim_path] = [f"float {name} = {view[name]:.7g}" for name in wanted]
    return lines


def fix(path: Path) -> int:
    """Insert the missing lines into the file of a stage; returns their number.

    Raises
    ------
    UsageError
        The file is not text, or has a form into which lines cannot be inserted safely.
    """
    stage, _ = open_stage(path)
    wanted = lacking(stage)
    if not wanted:
        return 0
    text = raw = path.read_bytes().decode("utf-8", errors="replace")
    for at, block in sorted(_inserts(raw, path, wanted), reverse=True):
        text = text[:at] + block + text[at:]
    lines = [line for block in wanted.values() for line in block]
    if not _is(text, stage.GetRootLayer(), wanted):
        hint = "write them by hand:\n" + "\n".join(f"        {line}" for line in lines)
        raise UsageError(f"{shown_path(path)}: no place was found for {len(lines)} lines", hint=hint)
    path.write_bytes(text.encode("utf-8"))
    return len(lines)


def said_of(path: Path, *, write: bool) -> str | None:
    """A line for a person about the statements that viewers miss; with `write` they are inserted first."""
    name = shown_path(path.resolve())
    if write:
        count = fix(path)
        return f"{name}: added for USD viewers, lines: {count}" if count else None
    if not lacking(open_stage(path)[0]):
        return None
    offer = f"to look at {name} in usdview or Blender, let `pipeline check --fix` add what they need"
    return f"{offer}; the dataset.usda of a build has it"


def _inserts(text: str, path: Path, wanted: dict[str, list[str]]) -> list[tuple[int, str]]:
    """Pieces of text with the position at which to insert them."""
    bodies, inserts = text_map(path).bodies, list[tuple[int, str]]()
    for prim, lines in wanted.items():
        if prim:
            inserts.append(_after(text, bodies.get(prim, 0), lines, 4 * prim.count("/")))
        elif dictionary := re.compile(r"\bfallbackPrimTypes\s*=\s*\{").search(text):
            inserts.append(_after(text, dictionary.end(), lines, 8))
        else:
            whole = ["fallbackPrimTypes = {", *(f"    {line}" for line in lines), "}"]
            inserts.append(_after(text, bodies.get("", 0), whole, 4))
    return inserts


def _after(text: str, at: int, lines: list[str], indent: int) -> tuple[int, str]:
    """The insertion of lines after a bracket: below the comment behind it, above anything else."""
    rest = text[at:].partition("\n")[0]
    is_free = not rest.strip() or rest.lstrip().startswith("#")
    block = "".join(f"\n{' ' * indent}{line}" for line in lines)
    return (at + len(rest), block) if is_free else (at, block + "\n")


def _is(text: str, layer: Sdf.Layer, wanted: dict[str, list[str]]) -> bool:
    """Whether a text states exactly the content of a layer plus the inserted lines."""
    after, before = Sdf.Layer.CreateAnonymous(".usda"), Sdf.Layer.CreateAnonymous(".usda")
    before.TransferContent(layer)
    try:
        if not after.ImportFromString(text):
            return False
    except Tf.ErrorException:
        return False
    types = fallback_types(re.findall(r"token\[\] (\w+)", "\n".join(wanted.get("", ()))))
    authored = before.pseudoRoot.GetInfo("fallbackPrimTypes") or {}
    if types:
        before.pseudoRoot.SetInfo("fallbackPrimTypes", {**authored, **types})
    for prim, lines in wanted.items():
        for line in lines if prim else ():
            _, name, _, value = line.split()
            Sdf.AttributeSpec(before.GetPrimAtPath(prim), name, Sdf.ValueTypeNames.Float).default = float(value)
    return bool(after.ExportToString() == before.ExportToString())
