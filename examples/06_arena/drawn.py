"""The pictures of the arena, drawn by Matplotlib in an environment of its own."""

from pathlib import Path

from environments import Contestant, Missing, interpreter, run_script

PICTURES = ("detectors.png", "fields.png")


def draw(out: Path) -> list[Path] | Missing:
    """Draw what results.json and fields.json of a folder hold; the files, or why there are none."""
    painter = Contestant(kind="painter", name="Matplotlib", script="", packages=("matplotlib==3.11.2", "numpy==2.4.6"))
    python = interpreter(painter, out / "environments")
    if isinstance(python, Missing):
        return python
    failed = run_script(python, Path(__file__).resolve().parent / "pictures.py", out)
    return Missing(painter.name, failed) if failed else [out / name for name in PICTURES if (out / name).exists()]
