"""`pipeline library`: parts that stages may refer to, with their key figures."""

from collections.abc import Sequence
from typing import Annotated, Any

import typer

from pipeline.app.verbs.terminal import Json, say, say_json

_HEADS = {
    "lenses": ("efl_mm", "f_number", "bfd_mm", "surfaces"),
    "rigs": ("efl_mm", "f_number", "width_px", "height_px", "pitch_mm", "microlens_types"),
    "sensors": ("width_px", "height_px", "pitch_mm", "bits", "full_well_electrons"),
    "mlas": ("pitch_mm", "focal_lengths_mm", "layout", "model"),
    "targets": ("kind", "points"),
}
"""Figures in the columns of each table; --json has all."""


def _kinds(incomplete: str) -> list[str]:
    """Kinds, for completion in a shell."""
    return [kind for kind in _HEADS if kind.startswith(incomplete)]


def library(
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="KIND", help="lenses, rigs, sensors, mlas or targets; by default all.", autocompletion=_kinds
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """List the lenses, rigs, sensors, microlens arrays and targets of the library with their key figures.

    Stages refer to them by these names, as @lenses/cooke_triplet_50mm.usda@; `pipeline show` and `pipeline target`
    describe one of them.
    """
    from pipeline.app.library import library as parts_of

    library_parts = parts_of(kind)
    if as_json:
        say_json({name: [part.to_dict() for part in parts] for name, parts in library_parts.items()})
        return
    for number, (name, parts) in enumerate(library_parts.items()):
        rows = [("", *_HEADS[name], "")]
        rows += [(part.name, *(_cell(part.figures.get(head)) for head in _HEADS[name]), part.title) for part in parts]
        for line in ([""] if number else []) + _table(rows):
            say(line)


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, list):
        return ", ".join(map(_cell, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Lines with columns as wide as their cells; numbers stand at the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row[:1], widths[:1], strict=True)]
        cells += [cell.rjust(width) for cell, width in zip(row[1:-1], widths[1:-1], strict=True)]
        lines.append("  ".join([*cells, row[-1]]).rstrip())
    return lines
