"""The table of conventions of docs/exports.md, from the table that the writers go by. `--write` puts it there.

python docs/export_table.py [--write]
"""

from pathlib import Path

from inserted import print_or_write

from pipeline.export_formats import FORMATS
from pipeline.exports.conventions import CONVENTIONS, Convention, Origin

PAGE = Path(__file__).resolve().parent / "exports.md"
HEAD = (
    "format",
    "for",
    "files",
    "cameras",
    "top-left pixel",
    "image axes",
    "target frame, unit",
    "pose",
    "microlenses",
    "rays",
)


def table() -> str:
    """A row per format, and below it the sources."""
    rows = [HEAD, ("---",) * len(HEAD), *(_row(name, one) for name, one in CONVENTIONS.items())]
    lines = "".join(f"| {' | '.join(row)} |\n" for row in rows)
    sources = "".join(f"- `{name}`: {one.source}\n" for name, one in CONVENTIONS.items())
    return f"{lines}\nSources:\n\n{sources}"


def _row(name: str, one: Convention) -> tuple[str, ...]:
    first = str(one.origin) if one.origin is Origin.IMAGE_CENTRE else f"({one.origin}, {one.origin})"
    pose = str(one.pose) if one.pose.name == "NONE" else f"{one.pose}, by the {one.centre}; {one.rotation}"
    files = ", ".join(FORMATS[name].files).replace("<", "\\<") + (f"; {one.note}" if one.note else "")
    board = f"{one.board}; {one.unit}"
    numbers = (first, str(one.axes), board, pose, str(one.microlenses), str(one.rays))
    return (f"`{name}`", one.consumer, files, str(FORMATS[name].cameras), *numbers)


if __name__ == "__main__":
    print_or_write(__doc__ or "", table, PAGE, "docs/export_table.py")
