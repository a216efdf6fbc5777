"""The table of conventions of docs/exports.md, from the records of the formats. `--write` puts it there.

python docs/export_table.py [--write]
"""

from pathlib import Path

from inserted import print_or_write

from pipeline.formats import CameraAxes, Format, Origin, Pose, format_of, names

PAGE = Path(__file__).resolve().parent / "exports.md"
HEAD = (
    "format",
    "for",
    "files",
    "cameras",
    "top-left pixel",
    "image axes",
    "target, unit",
    "pose",
    "microlenses",
)


def table() -> str:
    """A row per format, and below it the sources."""
    formats = {name: format_of(name) for name in names()}
    rows = [HEAD, ("---",) * len(HEAD), *(_row(name, record) for name, record in formats.items())]
    lines = "".join(f"| {' | '.join(row)} |\n" for row in rows)
    sources = "".join(f"- `{name}`: {record.source}\n" for name, record in formats.items())
    return f"{lines}\nSources:\n\n{sources}"


def _row(name: str, record: Format) -> tuple[str, ...]:
    origin, pose = record.origin, str(record.pose)
    if record.pose is not Pose.NONE:
        pose = f"{pose}, by the {record.centre}; {record.rotation}"
        if record.camera_axes is not CameraAxes.VISION:
            pose = f"{pose}; camera: {record.camera_axes}"
    return (
        f"`{name}`",
        record.consumer,
        ", ".join(record.files).replace("<", "\\<") + (f"; {record.note}" if record.note else ""),
        str(record.cameras),
        str(origin) if origin is Origin.IMAGE_CENTRE else f"({origin}, {origin})",
        str(record.axes),
        f"{record.board}; {record.unit}",
        pose,
        str(record.microlenses),
    )


if __name__ == "__main__":
    print_or_write(__doc__ or "", table, PAGE, "docs/export_table.py")
