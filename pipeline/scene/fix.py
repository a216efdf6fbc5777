"""Lines that USD viewers need and a stage lacks; `pipeline check --fix` inserts them into its text.

Text is only inserted: comments, layout and existing statements stay.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from pxr import Sdf, Tf, Usd

from pipeline.errors import UsageError
from pipeline.frames import mm_per_unit
from pipeline.scene.camera import read_camera_entries
from pipeline.scene.check.prims import all_prims
from pipeline.scene.usd.instances import write_out_instances
from pipeline.scene.usd.opening import open_stage
from pipeline.scene.usd.problems import shown_path
from pipeline.scene.usd.source_locations import place
from pipeline.scene.usd.usda_lines import text_map
from pipeline.scene.write.for_viewers import fallback_types, pinhole, view_of

_NEAR = 0.01
"""Relative difference between a pinhole and its lens that is not reported."""
_VIEW = ("focalLength", "horizontalAperture", "verticalAperture")
_SHIFT = ("horizontalApertureOffset", "verticalApertureOffset")


@dataclass(frozen=True, slots=True)
class Lacking:
    """Statements that viewers need and the root layer of a stage lacks.

    Attributes
    ----------
    lines : dict
        Missing lines by the path of their prim; "" stands for the metadata of the layer.
    wrong : list of str
        Statements about cameras that contradict their lenses; a person must decide.
    """

    lines: dict[str, list[str]]
    wrong: list[str]

    @property
    def count(self) -> int:
        """Number of lines."""
        return sum(map(len, self.lines.values()))


def lacking(stage: Usd.Stage) -> Lacking:
    """Find the missing statements of a stage that passed the checks; its instances are written out."""
    write_out_instances(stage)
    layer, lines, wrong = stage.GetRootLayer(), dict[str, list[str]](), list[str]()
    used = {prim.GetTypeName() for prim in all_prims(stage)}
    said = layer.pseudoRoot.GetInfo("fallbackPrimTypes") or {}
    if types := [f'token[] {name} = ["{kind[0]}"]' for name, kind in fallback_types(used).items() if name not in said]:
        lines[""] = types
    for entry in read_camera_entries(stage):
        prim, unit_mm = stage.GetPrimAtPath(entry.prim_path), mm_per_unit(layer.pseudoRoot.GetInfo("metersPerUnit"))
        view = {name: value for name, (_, value) in pinhole(view_of(entry), unit_mm).items()}
        missing = [name for name in view if not prim.GetAttribute(name).HasAuthoredValue()]
        is_shifted = any(view.get(name) for name in _SHIFT)
        names = [*_VIEW, *_SHIFT] if is_shifted else _VIEW
        wanted = [f"float {name} = {view[name]:.7g}" for name in names if name in missing]
        if wanted and layer.GetPrimAtPath(prim.GetPath()):
            lines[entry.prim_path] = wanted
        wrong += _wrong(prim, view)
    return Lacking(lines, wrong)


def _wrong(prim: Usd.Prim, view: dict[str, float]) -> list[str]:
    """Sentences about a view that differs from that of the lens."""
    found = []
    for name in _VIEW:
        attribute = prim.GetAttribute(name)
        value = attribute.Get(0.0)
        if name in view and attribute.HasAuthoredValue() and not abs(value / view[name] - 1) < _NEAR:
            file, line = place(attribute)
            says = f"{name} of <{prim.GetPath()}> is {value:.7g} for viewers"
            found.append(f"{file}:{line}: {says}, and the lens has {view[name]:.7g}")
    return found


def fix(path: Path) -> Lacking:
    """Insert the missing lines into the file of a stage; returns them.

    Raises
    ------
    UsageError
        The file is not text, or has a form into which lines cannot be inserted safely.
    """
    stage, _ = open_stage(path)
    found = lacking(stage)
    if not found.count:
        return found
    raw = path.read_bytes().decode("utf-8", errors="replace")
    text = raw
    for at, lines in sorted(_inserts(raw, path, found.lines), reverse=True):
        text = text[:at] + lines + text[at:]
    if not _is(text, stage.GetRootLayer(), found.lines):
        hint = "write them by hand:\n" + "\n".join(
            f"        {line}" for lines in found.lines.values() for line in lines
        )
        raise UsageError(f"{shown_path(path)}: no place was found for {found.count} lines", hint=hint)
    path.write_bytes(text.encode("utf-8"))
    return found


def said_of(path: Path, *, write: bool) -> list[str]:
    """Report missing statements as lines for a person; with `write` insert them first."""
    name = shown_path(path.resolve())
    if write:
        found = fix(path)
        return [f"{name}: added for USD viewers, lines: {found.count}", *found.wrong] if found.count else found.wrong
    found = lacking(open_stage(path)[0])
    if not found.count:
        return found.wrong
    offer = f"to look at {name} in usdview or Blender, let `pipeline check --fix` add what they need"
    return [f"{offer}; the dataset.usda of a build has it", *found.wrong]


def _inserts(text: str, path: Path, wanted: dict[str, list[str]]) -> list[tuple[int, str]]:
    """Pieces of text with the position at which to insert them."""
    bodies, found = text_map(path).bodies, list[tuple[int, str]]()
    for prim, lines in wanted.items():
        if prim:
            found.append(_after(text, bodies.get(prim, 0), lines, 4 * prim.count("/")))
        elif dictionary := re.compile(r"\bfallbackPrimTypes\s*=\s*\{").search(text):
            found.append(_after(text, dictionary.end(), lines, 8))
        else:
            whole = ["fallbackPrimTypes = {", *(f"    {line}" for line in lines), "}"]
            found.append(_after(text, bodies.get("", 0), whole, 4))
    return found


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
    said = before.pseudoRoot.GetInfo("fallbackPrimTypes") or {}
    if types:
        before.pseudoRoot.SetInfo("fallbackPrimTypes", {**said, **types})
    for prim, lines in wanted.items():
        for line in lines if prim else ():
            _, name, _, value = line.split()
            Sdf.AttributeSpec(before.GetPrimAtPath(prim), name, Sdf.ValueTypeNames.Float).default = float(value)
    return bool(after.ExportToString() == before.ExportToString())
