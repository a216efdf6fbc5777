"""Hints about errors of USD: their most likely cause, without errors that only follow from others."""

import re
from pathlib import Path

from pxr import Usd

from pipeline.errors import PipelineError
from pipeline.scene.usd.problems import IMPOSSIBLE, Problem, problem, shown_path
from pipeline.scene.usd.register import library_path
from pipeline.scene.usd.values import UnreadableValue
from pipeline.spelling import nearest

_DUPLICATE = re.compile(r"Duplicate items exist for field '\w+' at '[^']*\.([^']+)'(.*)", re.DOTALL)
_DECIMAL_COMMA = re.compile(r"=\s*[-+]?\d+,\d+\s*$")
_WITH_UNIT = re.compile(r"=\s*[-+]?[\d.]+\s*(?:[a-df-zµ]\w*)\s*$", re.IGNORECASE)
_OF_THE_GRAMMAR = re.compile(r"parse error matching \S*pegtl.*(?= at ')", re.DOTALL)
"""What the parser of USD says where a rule of its grammar has no message of its own: the rule, as a type of C++."""
_SPACE_IN_PATH = re.compile(r"<[^<>\s]+ [^<>]*>")
_STAGES = (".usd", ".usda", ".usdc", ".usdz")
_LENSES = (".zmx", ".seq", ".dat", ".csv", ".tsv", ".txt")
"""Names of files of USD, and of those that `files.lenses` reads."""
_TOLD = 4
"""Number of names in one hint: the intended stage is among a few, or cannot be guessed."""
_ONE_LINE = re.compile(r"\{[^}]*=[^}]*\}")


def of_syntax(file: str, line: int, message: str) -> tuple[str, str | None]:
    """The message of a syntax error, reworded where that of USD is unclear, and a hint to mend the line."""
    if duplicate := _DUPLICATE.match(message):
        repeated = _repeated(re.findall(r"<[^>]*>", duplicate[2]))
        return f'"{duplicate[1]}" names {repeated} twice', "remove one"
    message = _OF_THE_GRAMMAR.sub("USD cannot read it", message)
    try:
        lines = Path(file).read_text(encoding="utf-8", errors="replace").splitlines()
        text = lines[line - 1].partition("#")[0].rstrip()
    except (OSError, IndexError):
        return message, None
    if _DECIMAL_COMMA.search(text):
        return message, "write decimals with a point, not a comma"
    if _WITH_UNIT.search(text):
        return message, "numbers are written without a unit: lengths in mm, wavelengths in nm, angles in degrees"
    if _SPACE_IN_PATH.search(text):
        return message, "names of prims are made of letters, digits and _, without spaces"
    if _ONE_LINE.search(text):
        return message, "give each property a line of its own, and the closing brace as well"
    return message, None


def of_folder(path: Path) -> str | None:
    """A hint with the stages in a folder that was given instead of a stage; None if it is not a folder."""
    if not path.is_dir():
        return None
    names = sorted(file.name for file in path.iterdir() if file.suffix in _STAGES)
    return (
        f"it is a folder, in which there is {', '.join(names[:_TOLD])}" if names else "it is a folder without a stage"
    )


def of_format(path: Path) -> str | None:
    """A hint for a file that is not one of USD; None if its name is that of a USD file."""
    if path.suffix in _STAGES:
        return None
    if path.suffix.lower() in _LENSES:
        return f"`pipeline import lens {path.name}` makes a stage of a lens file"
    return f"stages are files of USD: {', '.join(_STAGES)}"


def _repeated(items: list[str]) -> str:
    return next((item for item in items if items.count(item) > 1), "something")


def of_missing_asset(asset: str, layer: str) -> str | None:
    """A hint with files of similar names and the searched folders; None if the file exists.

    Only the folder of the layer and the library are searched: names in other folders must not be shown to any stage.
    """
    folder, relative = Path(layer).parent, Path(asset)
    inside = not relative.is_absolute() and ".." not in relative.parts
    stages = _stages_by_name((folder / relative).parent if inside else folder, folder)
    return None if asset in stages else _meant(asset, stages, "@{}@", folder)


def of_missing_stage(path: Path) -> str:
    """A hint with stages of a name similar to the typed one (an absolute path), and the searched folders."""
    shown = Path(shown_path(path))
    base = path.parent if shown.is_absolute() else Path.cwd()
    return _meant(path.relative_to(base).as_posix(), _stages_by_name(path.parent, base), '"{}"', path.parent)


def _stages_by_name(folder: Path, base: Path) -> set[str]:
    """Stages in a folder, relative to `base`, and all stages of the library."""
    library = Path(library_path())
    try:
        here = {path.relative_to(base).as_posix() for path in folder.iterdir() if _is_stage(path)}
    except OSError:
        here = set()
    return here | {path.relative_to(library).as_posix() for path in library.rglob("*") if _is_stage(path)}


def _is_stage(path: Path) -> bool:
    return path.suffix.startswith(".usd")


def _meant(name: str, names: set[str], quoted: str, folder: Path) -> str:
    """The hint with the most similar names, or all of them and their folders."""
    near = nearest(name, names) or nearest(Path(name).name, {other.rpartition("/")[2] for other in names})
    whole = next((other for other in sorted(names) if other == near or other.endswith(f"/{near}")), None)
    meant = f"did you mean {quoted.format(whole)}? " if whole else ""
    return f"{meant}searched: {shown_path(folder)}, {shown_path(library_path())}"


def without_followers(problems: list[Problem]) -> list[Problem]:
    """Problems, except those that follow from others.

    These are what a reference to a missing file brings about at its prim and below, values that a reader could not
    use on a prim of which another error is told, and what parts cannot make up where any other error is.
    """
    broken = {problem.at for problem in problems if problem.code == "usd-invalid-asset-path" and problem.at}

    def follows(problem: Problem) -> bool:
        if problem.code.startswith("usd-"):
            return False
        named = [problem.at or "", *re.findall(r"<([^>]*)>", problem.message)]
        return any(f"{path}/".replace(".", "/").startswith(f"{at}/") for path in named for at in broken)

    def prim(problem: Problem) -> str:
        return (problem.at or "").partition(".")[0]

    unusable = {prim(problem) for problem in problems if problem.is_error and problem.code != UnreadableValue.code}

    def repeats(problem: Problem) -> bool:
        return problem.code == UnreadableValue.code and prim(problem) in unusable

    kept = [problem for problem in problems if not follows(problem) and not repeats(problem)]
    has_reason = any(problem.is_error and problem.code != IMPOSSIBLE for problem in kept)
    return [problem for problem in kept if problem.code != IMPOSSIBLE or not has_reason]


def of_reader(thing: Usd.Prim | Usd.Property, error: PipelineError | ArithmeticError) -> Problem:
    """The problem with which a reader ended: a value at its own place, or parts that do not make up a prim.

    Every check that reads the same reports it, and `check` names it once.
    """
    if isinstance(error, UnreadableValue):
        return problem(error.thing, error.code, error.what)
    if isinstance(error, PipelineError):
        return problem(thing, IMPOSSIBLE, error.what, hint=error.hint)
    return problem(thing, IMPOSSIBLE, "the lens has no first-order figures: it bends no light")
