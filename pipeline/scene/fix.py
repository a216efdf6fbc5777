"""Lines that a stage lacks so that USD viewers show it: `pipeline check --fix` writes them into its text.

Text is inserted and nothing else is touched: comments and layout stay. What the layer says stays, too.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from pxr import Sdf, Tf, Usd

from pipeline.errors import UsageError
from pipeline.scene.check.prims import all_prims
from pipeline.scene.read.prims import read_camera_entries
from pipeline.scene.usd.instances import write_out_instances
from pipeline.scene.usd.opening import open_stage
from pipeline.scene.usd.problems import shown_path
from pipeline.scene.usd.source_locations import place
from pipeline.scene.usd.usda_lines import text_map
from pipeline.scene.write.for_viewers import fallback_types, pinhole, view_of
from pipeline.units import mm_per_unit

_NEAR = 0.01
"""Relative difference of a pinhole from its lens that needs no word."""
_VIEW = ("focalLength", "horizontalAperture", "verticalAperture")
_SHIFT = ("horizontalApertureOffset", "verticalApertureOffset")


@dataclass(frozen=True, slots=True)
class Lacking:
    """Statements that viewers miss in the root layer of a stage.

    Attributes
    ----------
    lines : dict
        Lines that it lacks, by the path of the prim that they belong to; of "" to the metadata of the layer.
    wrong : list of str
        What it says of its cameras otherwise than their lenses do: a person decides.
    """

    lines: dict[str, list[str]]
    wrong: list[str]

    @property
    def count(self) -> int:
        """Number of lines."""
        return sum(map(len, self.lines.values()))


def lacking(stage: Usd.Stage) -> Lacking:
    """Look at a stage that passed the checks; its instances are written out."""
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
    """Sentences about a view that is not that of the lens."""
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
    """Write the lines that a stage lacks into its file; returns them.

    Raises
    ------
    UsageError
        The file is no text, or not of a form into which lines can be inserted safely.
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
    """Tell what viewers miss, as lines for a person; with `write` after the file was mended."""
    name = shown_path(path.resolve())
    if write:
        found = fix(path)
        return (
            [f"{name}: added for USD viewers without our plug-in, lines: {found.count}", *found.wrong]
            if found.count
            else found.wrong
        )
    found = lacking(open_stage(path)[0])
    if not found.count:
        return found.wrong
    offer = f"{name}: lines that USD viewers without our plug-in need: {found.count}, written by `pipeline check --fix`"
    return [f"{offer}; the dataset.usda of a build has them", *found.wrong]


def _inserts(text: str, path: Path, wanted: dict[str, list[str]]) -> list[tuple[int, str]]:
    """A piece of text, and its place."""
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
    """Lines after a bracket: below the comment behind it, above anything else."""
    rest = text[at:].partition("\n")[0]
    is_free = not rest.strip() or rest.lstrip().startswith("#")
    block = "".join(f"\n{' ' * indent}{line}" for line in lines)
    return (at + len(rest), block) if is_free else (at, block + "\n")


def _is(text: str, layer: Sdf.Layer, wanted: dict[str, list[str]]) -> bool:
    """Whether a text says what a layer says and the lines besides, and nothing else."""
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
