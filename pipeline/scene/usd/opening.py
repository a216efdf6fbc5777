"""Opening of stages: messages of USD as problems, with hints about their most likely cause."""

import os
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

from pxr import Pcp, Sdf, Tf, Usd, UsdUtils

from pipeline.scene.usd.plug_in import ThirdPartyLayers, scene_reader
from pipeline.scene.usd.problems import Problem, StageError, shown_path
from pipeline.scene.usd.readers import read_once
from pipeline.scene.usd.roots import library_path, real_path
from pipeline.scene.usd.usda_lines import line_of, text_map
from pipeline.spelling import nearest

_SYNTAX = re.compile(
    r"(?P<file>[^\n]+?\.usd[acz]?\]?):(?P<line>\d+):(?P<column>\d+): "
    r"(?P<message>.*?)(?: in <(?P<at>[^>]*)>)?\s*$",
    re.DOTALL,
)
_ANONYMOUS_LAYER = re.compile(r",?@anon:[^@]*@,?")
PARTS = "PreviewParts"
"""Name of the prim below a Camera of an output folder whose payload are lens elements and rays, for viewers."""
_FORWARD_SLASHES = "asset paths use forward slashes on every system"
_DUPLICATE = re.compile(r"Duplicate items exist for field '\w+' at '[^']*\.([^']+)'(.*)", re.DOTALL)
_DECIMAL_COMMA = re.compile(r"=\s*[-+]?\d+,\d+\s*$")
_WITH_UNIT = re.compile(r"=\s*[-+]?[\d.]+\s*(?:[a-df-zµ]\w*)\s*$", re.IGNORECASE)
_OF_THE_GRAMMAR = re.compile(r"parse error matching \S*pegtl.*(?= at ')", re.DOTALL)
"""Message of USD's parser for a grammar rule without a message: the rule, as a type of C++."""
_SPACE_IN_PATH = re.compile(r"<[^<>\s]+ [^<>]*>")
_STAGES = (".usd", ".usda", ".usdc", ".usdz")
_LENSES = (".zmx", ".seq", ".dat", ".csv", ".tsv", ".txt")
"""Names of files of USD, and of lenses that plug-ins read."""
_MOST_NAMES = 4
"""Number of names in one hint: the intended stage is among a few, or cannot be guessed."""
_ONE_LINE = re.compile(r"\{[^}]*=[^}]*\}")


def open_stage(path: str | Path) -> tuple[Usd.Stage, list[Problem]]:
    """The stage, and the problems of its composition; StageError if it, or any of its layers, is missing or no USD."""
    # Absolute, or Sdf may hold one file under two identifiers.
    path = real_path(path)
    if not path.is_file():
        file = shown_path(path)
        exists = os.path.lexists(path)
        code, message = ("file-kind", f"{file} is not a plain file") if exists else ("file-missing", "no such file")
        hint = _hint_of_folder(path) if exists else _hint_of_missing_stage(path)
        raise StageError([Problem(code=code, message=message, file=file, line=1 if exists else None, hint=hint)])
    # Collects the warnings of all threads, which USD would print to stderr.
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        stage = Usd.Stage.Open(path.as_posix())
    except Tf.ErrorException as error:
        raise StageError(_from_opening(error, path)) from None
    finally:
        delegate.TakeUncoalescedDiagnostics()
        del delegate
    if (rate := stage.GetTimeCodesPerSecond()) != stage.GetSessionLayer().timeCodesPerSecond:
        stage.GetSessionLayer().timeCodesPerSecond = rate  # or USD scales the times of what is written into it
    files = {layer.identifier: layer.realPath for layer in stage.GetUsedLayers()}
    # A copied dataset.usda builds without the parts of its cameras, which a build made for viewers.
    errors = [
        error
        for error in stage.GetCompositionErrors()
        if not (isinstance(error, Pcp.ErrorInvalidAssetPath) and error.rootSite.path.name == PARTS)
    ]
    problems = list(dict.fromkeys(_from_composition(error, files) for error in errors))
    if unreadable := [problem for problem in problems if problem.code in ("usd-syntax", "encoding")]:
        raise StageError(unreadable)  # all other problems may follow from what could not be read
    return stage, problems


def _from_opening(exception: Tf.ErrorException, path: Path) -> list[Problem]:
    """Problems of a stage that USD cannot open, with lines if its errors have any."""
    texts = [_text(partial(getattr, error, "commentary")).strip() for error in exception.args]
    if problems := [_syntax_problem(match) for text in texts if (match := _SYNTAX.match(text))]:
        return problems
    # No position. One text only states the failure; any other states the reason.
    reasons = [text for text in texts if not text.startswith("Failed to open layer")] or texts
    file = shown_path(path)
    hint = None
    if path.suffix.lower() in _LENSES:
        hint = f"`pipeline import lens {path.name}` makes a stage of a lens file"
    elif path.suffix not in _STAGES:
        hint = f"stages are files of USD: {', '.join(_STAGES)}"
    return [
        Problem(code="usd-open", message=text.replace(str(path), file), file=file, line=1, hint=hint)
        for text in reasons
    ]


def _text(message: Callable[[], str]) -> str:
    """A message of USD, which may quote bytes that are not UTF-8."""
    try:
        return message()
    except UnicodeDecodeError as error:
        return error.object.decode(errors="replace")


def _syntax_problem(match: re.Match[str], used: str | None = None) -> Problem:
    """A text that USD cannot parse; `used` is a hint that names the layer that uses it."""
    if problem := _encoding_problem(Path(match["file"]), used):
        return problem
    message, mend = _reworded(match["file"], int(match["line"]), match["message"])
    return Problem(
        code="usd-syntax",
        message=message,
        file=shown_path(match["file"]),
        line=int(match["line"]),
        column=int(match["column"]),
        at=match["at"],
        hint="; ".join(filter(None, (mend, used))) or None,
    )


def _encoding_problem(file: Path, used: str | None) -> Problem | None:
    """The first byte of a text that is not UTF-8; None if there is none, or the text is a member of a package."""
    try:
        content = file.read_bytes()
        content.decode()
    except OSError:
        return None
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        mend = "save the file as UTF-8; in ISO 8859-1, for example, letters with accents are other bytes"
        return Problem(
            code="encoding",
            message=f"byte {content[error.start]:#04x} is not UTF-8",
            file=shown_path(file),
            line=line,
            hint="; ".join(filter(None, (mend, used))),
        )
    return None


def _from_composition(error: Pcp.ErrorBase, files: dict[str, str]) -> Problem:
    """The problem of an error of composition; `files` are the paths of the stage's layers, by their identifiers.

    Such an error has a type and a site; layer, asset and reason are only in its text.
    """
    text = _ANONYMOUS_LAYER.sub("", _text(partial(str, error))).strip()
    introduced = re.search(r"(?:introduced by|of layer) @([^@]*)@(?:<([^>]*)>)?", text)
    # The text repeats asset paths, which may hold anything: only layers of the stage are considered.
    layer, path = error.rootSite.layerStack.rootLayer.realPath, str(error.rootSite.path)
    if introduced and introduced[1] in files:
        layer, path = files[introduced[1]], introduced[2] or path
    # An asset that can be opened may be mentioned more than once; then the prim is more helpful.
    is_of_path = isinstance(error, Pcp.ErrorUnresolvedPrimPath)
    line = (None if is_of_path else _line_of_asset(layer, text)) or line_of(layer, path)
    # The reason may be a syntax error of the asset, which has a line of its own.
    _, _, reason = text.partition(" -- ")
    if syntax_error := _SYNTAX.match(reason.removesuffix("; skipping.").rstrip(".\n ")):
        return _syntax_problem(syntax_error, f"the file is used by {shown_path(layer)}:{line or 1}")
    hint = _FORWARD_SLASHES if "\\" in text else None
    if hint is None and isinstance(error, Pcp.ErrorInvalidAssetPath) and (asset := re.search(r"@([^@]+)@", text)):
        hint = _hint_of_missing_asset(asset[1], layer)
    # Word the message without identifiers of layers, and with short paths.
    if text.startswith("Cycle detected"):
        text = "reference cycle: " + " -> ".join(shown_path(x) for x in re.findall(r"@([^@]*)@<[^>]*>", text))
    message, is_introduced, _ = text.partition(" introduced by ")
    if is_introduced and reason:
        message = f"{message}: {reason.rstrip('. ')}"
    message = re.sub(r"@(/[^@]*)@", lambda match: f"@{shown_path(match[1])}@", message)
    kind = re.sub(r"(?<!^)(?=[A-Z])", "-", type(error).__name__.removeprefix("Error")).lower()
    return Problem(code=f"usd-{kind}", message=message, file=shown_path(layer), line=line, at=path, hint=hint)


def _line_of_asset(layer: str, text: str) -> int | None:
    """Line of a layer that mentions the asset of a message, which may be resolved there."""
    names = {mentioned.rpartition("/")[2] for mentioned in re.findall(r"@([^@]*)@", text)}
    lines = [line for asset, line in text_map(layer).assets.items() if asset.rpartition("/")[2] in names]
    return lines[0] if len(lines) == 1 else None


def write_out_instances(stage: Usd.Stage) -> None:
    """Turn every instance into an ordinary prim in the session layer: no file changes."""
    while instances := [prim.GetPath() for prim in stage.TraverseAll() if prim.IsInstance()]:
        with Sdf.ChangeBlock():
            for path in instances:
                Sdf.CreatePrimInLayer(stage.GetSessionLayer(), path).instanceable = False


@read_once
def instance_of(prim: Usd.Prim) -> str:
    """Path of the outermost instance to which a prim belongs, or belonged until it was written out; empty: none."""
    # Of what was written out layers still say whether it is instanceable, and so do copies of the composed stage.
    above = instance_of(prim.GetParent()) if prim.GetParent() else ""
    return above or (str(prim.GetPath()) if prim.HasAuthoredInstanceable() else "")


def check_instances(stage: Usd.Stage) -> tuple[list[Problem], ThirdPartyLayers]:
    """Write instances out; problems of opinions on prims below them, which USD ignores; and third-party layers.

    Afterwards these opinions count, so such a stage must not be read.
    """
    everything = list(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)))
    before = {prim.GetPath(): list(prim.GetPrimStack()) for prim in everything if prim.IsInstanceProxy()}
    tops = [prim.GetPath() for prim in everything if prim.IsInstance()]
    write_out_instances(stage)
    third_party = scene_reader().third_party_layers(stage)
    problems = []
    for top in reversed(tops):  # nested instances first
        instance = Usd.PrimRange(stage.GetPrimAtPath(top), Usd.PrimAllPrimsPredicate)
        below = {prim.GetPath(): list(prim.GetPrimStack()) for prim in instance}
        # Opinions that count only since the instance was written out; the strongest opinion of each prim first.
        ignored = [
            spec
            for path, specs in below.items()
            for spec in specs
            if path != top
            and spec.layer not in {stage.GetSessionLayer(), *third_party.layers}
            and spec not in before.get(path, [])
        ]
        if ignored:
            problems.append(_below_instance(top, ignored))
        before |= below
    return problems[::-1], third_party


def _below_instance(top: Sdf.Path, ignored: list[Sdf.PrimSpec]) -> Problem:
    """The problem of opinions below an instance, at the first of them."""
    first = ignored[0]
    names = list(dict.fromkeys(spec.name for spec in ignored if spec.layer == first.layer))
    file = first.layer.realPath
    return Problem(
        code="below-instance",
        message=f"USD ignores the opinions on {', '.join(names[:4])}, because <{top}> is an instance",
        file=shown_path(file) if file else None,
        line=line_of(file, str(first.path)) if file else None,
        at=str(top),
        hint=f"remove instanceable = true from <{top}>, or say it in the file that it refers to",
    )


def _reworded(file: str, line: int, message: str) -> tuple[str, str | None]:
    """The message of a syntax error, reworded where USD's is unclear, and a hint to mend the line."""
    if duplicate := _DUPLICATE.match(message):
        items = re.findall(r"<[^>]*>", duplicate[2])
        repeated = next((item for item in items if items.count(item) > 1), "something")
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


def _hint_of_folder(path: Path) -> str | None:
    """A hint with the stages in a folder that was given instead of a stage; None if it is not a folder."""
    if not path.is_dir():
        return None
    names = ", ".join(sorted(file.name for file in path.iterdir() if file.suffix in _STAGES)[:_MOST_NAMES])
    return f"it is a folder, in which there is {names}" if names else "it is a folder without a stage"


def _hint_of_missing_asset(mentioned: str, layer: str) -> str | None:
    """A hint with files of similar names and the searched folders, None if the file exists. Only the folders of the
    layer and of the library are listed: no stage may learn the names in others.
    """
    # Some paths in messages are resolved, and not as written in the layer.
    name = mentioned.rpartition("/")[2]
    asset = next((path for path in text_map(layer).assets if path.rpartition("/")[2] == name), mentioned)
    folder, relative = Path(layer).parent, Path(asset)
    inside = not relative.is_absolute() and ".." not in relative.parts
    stages = _stages_by_name((folder / relative).parent if inside else folder, folder)
    return None if asset in stages else _similar(asset, stages, "@{}@", folder)


def _hint_of_missing_stage(path: Path) -> str:
    """A hint with a stage of a similar name and the searched folders."""
    short_path = Path(shown_path(path))
    base = path.parent if short_path.is_absolute() else Path.cwd()
    return _similar(path.relative_to(base).as_posix(), _stages_by_name(path.parent, base), '"{}"', path.parent)


def _stages_by_name(folder: Path, base: Path) -> set[str]:
    """Stages in a folder, relative to `base`, and all stages of the library."""
    library = Path(library_path())
    files = [(path, base) for path in folder.glob("*")] + [(path, library) for path in library.rglob("*")]
    return {path.relative_to(start).as_posix() for path, start in files if path.suffix in _STAGES}


def _similar(name: str, names: set[str], quoted: str, folder: Path) -> str:
    """A hint with the most similar of these names, quoted in a format, and the searched folders."""
    near = nearest(name, names) or nearest(Path(name).name, {other.rpartition("/")[2] for other in names})
    similar = next((other for other in sorted(names) if other == near or other.endswith(f"/{near}")), None)
    question = f"did you mean {quoted.format(similar)}? " if similar else ""
    return f"{question}searched: {shown_path(folder)}, {shown_path(library_path())}"
