"""Opening of stages, with all messages of USD collected as problems."""

import re
from pathlib import Path

from pxr import Pcp, Tf, Usd, UsdUtils

from pipeline.roots import real_path
from pipeline.scene.usd.hints import of_format, of_missing_asset, of_missing_stage, of_syntax
from pipeline.scene.usd.layer_files import is_plain_file
from pipeline.scene.usd.problems import Problem, StageError, shown_path
from pipeline.scene.usd.usda_lines import line_of, text_map

_SYNTAX = re.compile(
    r"(?P<file>[^\n]+?\.usd[acz]?\]?):(?P<line>\d+):(?P<column>\d+): "
    r"(?P<message>.*?)(?: in <(?P<at>[^>]*)>)?\s*$",
    re.DOTALL,
)
_COPY = re.compile(r"/proc/self/fd/\d+(?:/judged\.usd[acz]?(?:\[[^\]]*\])?)?")
"""Pattern of the path of inspected bytes; our messages show the original file instead."""
_ANONYMOUS_LAYER = re.compile(r",?@anon:[^@]*@,?")
PARTS = "PreviewParts"
"""Name of the prim below a Camera of an output folder whose payload are lens elements and rays, for viewers."""
_FORWARD_SLASHES = "asset paths use forward slashes on every system"


def open_stage(path: str | Path) -> tuple[Usd.Stage, list[Problem]]:
    """The stage, and the problems of its composition.

    Raises
    ------
    StageError
        The stage cannot be opened: missing file, not USD, syntax error.
    """
    # Absolute, or Sdf may hold one file under two identifiers.
    path = real_path(path)
    if not is_plain_file(path):
        hint = of_missing_stage(path)
        raise StageError([Problem(code="file-missing", message="no such file", file=shown_path(path), hint=hint)])
    # Collects the warnings of all threads, which USD would print to stderr.
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        stage = Usd.Stage.Open(path.as_posix())
    except Tf.ErrorException as error:
        raise StageError(problems_of(error, path)) from None
    finally:
        delegate.TakeUncoalescedDiagnostics()
        del delegate
    files = {layer.identifier: layer.realPath for layer in stage.GetUsedLayers()}
    errors = [error for error in stage.GetCompositionErrors() if not _is_of_parts(error)]
    problems = [_from_composition(error, files) for error in errors]
    return stage, list(dict.fromkeys(problems))


def _is_of_parts(error: Pcp.ErrorBase) -> bool:
    """Whether the file is missing that a build made for viewers: a copied dataset.usda builds without it."""
    return isinstance(error, Pcp.ErrorInvalidAssetPath) and error.rootSite.path.name == PARTS


def problems_of(exception: Tf.ErrorException, path: Path, used: str | None = None) -> list[Problem]:
    """The reasons why USD cannot read a file; `used` is a hint that names the layer that uses it."""
    texts = [_COPY.sub(lambda _: str(path), error.commentary).strip() for error in exception.args]
    found = [_syntax_problem(match, used) for text in texts if (match := _SYNTAX.match(text))]
    if found:
        return found
    # No position. One text only states the failure; any other states the reason.
    reasons = [text for text in texts if not text.startswith("Failed to open layer")] or texts
    file = shown_path(path)
    return [
        Problem(code="usd-open", message=text.replace(str(path), file), file=file, line=1, hint=used or of_format(path))
        for text in reasons
    ]


def _syntax_problem(match: re.Match[str], hint: str | None = None) -> Problem:
    message, mend = of_syntax(match["file"], int(match["line"]), match["message"])
    return Problem(
        code="usd-syntax",
        message=message,
        file=shown_path(match["file"]),
        line=int(match["line"]),
        column=int(match["column"]),
        at=match["at"],
        hint="; ".join(filter(None, (mend, hint))) or None,
    )


def _from_composition(error: Pcp.ErrorBase, files: dict[str, str]) -> Problem:
    # A Pcp error has a type and a site; layer, asset and reason are only in its text.
    text = _ANONYMOUS_LAYER.sub("", str(error)).strip()
    introduced = re.search(r"introduced by @([^@]*)@<([^>]*)>", text)
    # The text repeats asset paths, which may hold anything: only layers of the stage are considered.
    layer, path = (files[introduced[1]], introduced[2]) if introduced and introduced[1] in files else _site(error)
    _, _, reason = text.partition(" -- ")
    if inner := _SYNTAX.search(reason.rstrip(".\n ")):
        return changed(inner["file"])  # it could be parsed a moment ago; its present content must not be quoted
    hint = _FORWARD_SLASHES if "\\" in text else None
    if hint is None and isinstance(error, Pcp.ErrorInvalidAssetPath) and (asset := re.search(r"@([^@]+)@", text)):
        hint = of_missing_asset(_as_written(asset[1], layer), layer)
    if text.startswith("Cycle detected"):
        text = "reference cycle: " + " -> ".join(shown_path(x) for x in re.findall(r"@([^@]*)@<[^>]*>", text))
    message, _, _ = text.partition(" introduced by ")
    message = re.sub(r"@(/[^@]*)@", lambda match: f"@{shown_path(match[1])}@", message)
    # An asset that can be opened may be mentioned more than once; then the prim is more helpful.
    opens = isinstance(error, Pcp.ErrorUnresolvedPrimPath)
    line = (None if opens else _line_of_asset(layer, str(error))) or line_of(layer, path)
    return Problem(code=_code(error), message=message, file=shown_path(layer), line=line, at=path, hint=hint)


def changed(file: str | Path) -> Problem:
    """The problem that a file has changed since its inspection."""
    message = "it changed, or appeared, while the stage was read"
    return Problem(code="changed", message=message, file=shown_path(file), line=1, hint="try again when it is quiet")


def _as_written(asset: str, layer: str) -> str:
    """An asset path as written in the layer; in messages some are resolved."""
    name = asset.rpartition("/")[2]
    return next((one for one in text_map(layer).assets if one.rpartition("/")[2] == name), asset)


def _site(error: Pcp.ErrorBase) -> tuple[str, str]:
    return error.rootSite.layerStack.rootLayer.realPath, str(error.rootSite.path)


def _line_of_asset(layer: str, text: str) -> int | None:
    """Line of a layer that mentions the asset of a message, which may be resolved there."""
    names = {mentioned.rpartition("/")[2] for mentioned in re.findall(r"@([^@]*)@", text)}
    lines = [line for asset, line in text_map(layer).assets.items() if asset.rpartition("/")[2] in names]
    return lines[0] if len(lines) == 1 else None


def _code(error: Pcp.ErrorBase) -> str:
    """Code of an error of USD: ErrorInvalidAssetPath -> usd-invalid-asset-path."""
    name = type(error).__name__.removeprefix("Error")
    return "usd-" + re.sub(r"(?<!^)(?=[A-Z])", "-", name).lower()
