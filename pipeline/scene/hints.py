"""One hint per mistake: what an error of USD most likely means, and no errors that only follow from another."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from pipeline.scene.problems import Problem, shown_path
from pipeline.scene.register import library_path
from pipeline.spelling import nearest

_DUPLICATE = re.compile(r"Duplicate items exist for field '\w+' at '[^']*\.([^']+)'(.*)", re.DOTALL)
_DECIMAL_COMMA = re.compile(r"=\s*[-+]?\d+,\d+\s*$")
_WITH_UNIT = re.compile(r"=\s*[-+]?[\d.]+\s*(?:[a-df-zµ]\w*)\s*$", re.IGNORECASE)
_ONE_LINE = re.compile(r"\{[^}]*=[^}]*\}")


def of_syntax(file: str, line: int, message: str) -> tuple[str, str | None]:
    """The message of a syntax error in our words where USD's say little, and how to mend the line."""
    if duplicate := _DUPLICATE.match(message):
        repeated = _repeated(re.findall(r"<[^>]*>", duplicate[2]))
        return f'"{duplicate[1]}" names {repeated} twice', "remove one"
    try:
        lines = Path(file).read_text(encoding="utf-8", errors="replace").splitlines()
        text = lines[line - 1].partition("#")[0].rstrip()
    except (OSError, IndexError):
        return message, None
    if _DECIMAL_COMMA.search(text):
        return message, "write decimals with a point, not a comma"
    if _WITH_UNIT.search(text):
        return message, "numbers stand without a unit: lengths in mm, wavelengths in nm, angles in degrees"
    if _ONE_LINE.search(text):
        return message, "give each property a line of its own, and the closing brace as well"
    return message, None


def _repeated(items: list[str]) -> str:
    return next((item for item in items if items.count(item) > 1), "something")


def of_missing_asset(asset: str, layer: str) -> str | None:
    """Files of nearly that name, and the folders that were searched.

    Only the folder of the layer and the library are looked into: names of other folders are not for every stage.
    """
    own, library = Path(layer).parent, Path(library_path())
    folders = [own, library]
    relative = Path(asset)
    inside = not relative.is_absolute() and ".." not in relative.parts
    beside = (own / relative).parent if inside else own
    found = {path.relative_to(own).as_posix() for path in _stages(beside.glob("*"))} if beside.is_dir() else set()
    found |= {path.relative_to(library).as_posix() for path in _stages(library.rglob("*"))}
    if asset in found:
        return None  # it is there and something else is wrong with it
    near = nearest(asset, found) or nearest(relative.name, {name.rpartition("/")[2] for name in found})
    whole = next((name for name in sorted(found) if name == near or name.endswith(f"/{near}")), None)
    meant = f"did you mean @{whole}@? " if whole else ""
    return f"{meant}searched: {', '.join(map(shown_path, folders))}"


def _stages(paths: Iterable[Path]) -> Iterator[Path]:
    return (path for path in paths if path.suffix.startswith(".usd"))


def without_followers(problems: list[Problem]) -> list[Problem]:
    """Problems without those that a reference to a missing file brings about at its prim and below."""
    broken = {one.at for one in problems if one.code == "usd-invalid-asset-path" and one.at}

    def follows(one: Problem) -> bool:
        if one.code.startswith("usd-"):
            return False
        named = [one.at or "", *re.findall(r"<([^>]*)>", one.message)]
        return any(f"{path}/".replace(".", "/").startswith(f"{at}/") for path in named for at in broken)

    return [one for one in problems if not follows(one)]
