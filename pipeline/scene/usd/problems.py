"""Problems of a stage, as data and as text, with the file and line of the strongest opinion on a prim or property."""

import contextlib
import re
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pxr import Sdf, Usd

from pipeline.errors import EnvironmentFault, PipelineError, UsageError
from pipeline.limits import how_to_raise, limits
from pipeline.scene.usd.usda_lines import line_of, line_of_metadata, sample_key
from pipeline.scene.usd.values import UnreadableValue
from pipeline.spelling import printable

NOT_DRAWN = "not-drawn"
"""Code of warnings of what is drawn otherwise than its stage asks."""
IMPOSSIBLE = "impossible"
"""Code of parts that do not make up a prim; beside another error it follows from that."""
_LONGEST_LINE = 1000
"""Longest line of a problem [characters]: names and paths of a stage may have any length; messages are far shorter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One problem of a stage, with the place in the text to mend it.

    `severity` is `error` or `warning`; `code` is a stable name of the kind of problem, for scripts; `message` is one
    sentence with the offending value. `file` is relative to the working directory if it lies below it, `line` and
    `column` count from 1, `at` is a path on the composed stage, and `hint` a way to mend it.
    """

    severity: str = "error"
    code: str
    message: str
    file: str | None = None
    line: int | None = None
    column: int | None = None
    at: str | None = None
    hint: str | None = None

    @property
    def is_error(self) -> bool:
        """Whether it prevents a build."""
        return self.severity == "error"

    def to_dict(self) -> dict[str, str | int | None]:
        """Plain values for `--json`, every field present."""
        return asdict(self)

    def __str__(self) -> str:
        position = ":".join(str(part) for part in (self.file, self.line, self.column) if part is not None)
        lines = [f"{position or '<stage>'}: {self.severity}: {self.message} [{self.code}]"]
        if self.at:
            lines.append(f"    at <{self.at}>")
        if self.hint:
            lines.append(f"    hint: {self.hint}")
        # Names and paths of a stage may hold anything, even escape sequences of terminals.
        return "\n".join(printable(shortened(line, _LONGEST_LINE)) for line in lines)


class StageError(UsageError):
    """A stage that does not pass `check`; carries all its problems."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = list(problems)
        super().__init__("\n".join(map(str, self.problems)))

    @property
    def as_text(self) -> str:
        """Text as the command prints it; every problem states itself whether it is an error."""
        return str(self)


@contextlib.contextmanager
def blamed_on(file: str | None, line: int | None, at: str) -> Iterator[None]:
    """Turn an error about the object of a prim into a problem of the stage at that prim."""
    try:
        yield
    except (UsageError, EnvironmentFault):
        raise
    except PipelineError as error:
        blamed = Problem(code=IMPOSSIBLE, message=error.message, file=file, line=line, at=at, hint=error.hint)
        raise StageError([blamed]) from error


def shown_path(path: str | Path) -> str:
    """A path as messages print it: relative to the working directory when below it."""
    path = Path(path)
    try:
        return path.relative_to(Path.cwd()).as_posix()
    except ValueError:
        return path.as_posix()


def shortened(text: str, longest: int = 100) -> str:
    """The beginning of a text of a stage, as messages quote it."""
    return text if len(text) <= longest else f"{text[:longest]}…"


def problem(
    thing: Usd.Prim | Usd.Property,
    code: str,
    message: str,
    *,
    hint: str | None = None,
    severity: str = "error",
    time: float | None = None,
) -> Problem:
    """A problem at a prim, a property or, with `time`, one of its time samples."""
    file, line = written_at(thing, time)
    return Problem(
        severity=severity, code=code, message=message, file=file, line=line, at=str(thing.GetPath()), hint=hint
    )


def warning(
    thing: Usd.Prim | Usd.Property, code: str, message: str, *, hint: str | None = None, time: float | None = None
) -> Problem:
    """A problem that prevents no build."""
    return problem(thing, code, message, hint=hint, severity="warning", time=time)


def not_drawn(thing: Usd.Prim | Usd.Property, message: str, hint: str | None = None) -> Problem:
    """A warning of what is drawn otherwise than its stage asks."""
    return warning(thing, NOT_DRAWN, message, hint=hint)


def over_limit(thing: Usd.Prim | Usd.Property, name: str, count: int, counted: str) -> list[Problem]:
    """A problem at a thing if its count, which `counted` says in words, is more than the limit of that name."""
    limit = getattr(limits(), name)
    message = f"{counted} are more than the limit of {limit:,} {name.replace('_', ' ')}"
    return [problem(thing, "over-limit", message, hint=how_to_raise(name, count))] if count > limit else []


def metadata_problem(
    layer: Sdf.Layer, key: str, code: str, message: str, *, hint: str | None = None, at: str | None = None
) -> Problem:
    """A problem at the line of metadata of a layer, or at its first line."""
    line = line_of_metadata(layer.realPath, key)
    return Problem(code=code, message=message, file=shown_path(layer.realPath), line=line, at=at, hint=hint)


def written_at(thing: Usd.Prim | Usd.Property, time: float | None = None) -> tuple[str | None, int | None]:
    """File (as messages show it) and line of the strongest authored opinion."""
    stack = [spec for spec in specs(thing) if spec.layer.realPath or spec.layer != thing.GetStage().GetSessionLayer()]
    if not stack:
        # Not authored: a fallback or something missing. Its prim is the place to write it.
        return written_at(thing.GetPrim()) if isinstance(thing, Usd.Property) else (None, None)
    file = stack[0].layer.realPath
    if not file:
        return None, None
    path = str(stack[0].path)
    if time is not None and isinstance(thing, Usd.Property):  # a reference may shift and scale times
        stacked = thing.GetPropertyStackWithLayerOffsets(Usd.TimeCode.Default())
        layer_to_stage = next(offset for spec, offset in stacked if not spec.layer.anonymous)
        path += sample_key(float(layer_to_stage.GetInverse() * time))
    return shown_path(file), line_of(file, path)


def specs(thing: Usd.Prim | Usd.Property) -> list[Sdf.Spec]:
    """Opinions of files on a prim or property, strongest first; those of the session layer are none."""
    is_prim = isinstance(thing, Usd.Prim)
    stack = thing.GetPrimStack() if is_prim else thing.GetPropertyStack(Usd.TimeCode.Default())
    return [spec for spec in stack if not spec.layer.anonymous]


def saying(prim: Usd.Prim, key: str) -> list[Sdf.Spec]:
    """Opinions of files on metadata of a prim, strongest first; the strongest on the prim may be in another file."""
    return [spec for spec in specs(prim) if spec.HasInfo(key)]


def at_opinion(spec: Sdf.Spec, each: Problem) -> Problem:
    """The problem at the line of an opinion."""
    file = spec.layer.realPath
    return replace(each, file=shown_path(file), line=line_of(file, str(spec.path)))


def without_followers(problems: list[Problem]) -> list[Problem]:
    """Problems, each once per line of a file, except those that follow from others.

    The latter are problems at and below a prim that references a missing file, unreadable values of a prim with another
    error, and impossible parts beside any other error.
    """
    broken = {problem.at for problem in problems if problem.code == "usd-invalid-asset-path" and problem.at}

    def path_of_prim(problem: Problem) -> str:
        return (problem.at or "").partition(".")[0]

    unusable = {
        path_of_prim(problem) for problem in problems if problem.is_error and problem.code != UnreadableValue.code
    }

    def follows(problem: Problem) -> bool:
        """Whether another problem accounts for it."""
        if problem.code == UnreadableValue.code and path_of_prim(problem) in unusable:
            return True
        named = [problem.at or "", *re.findall(r"<([^>]*)>", problem.message)]
        below = any(f"{path}/".replace(".", "/").startswith(f"{at}/") for path in named for at in broken)
        return below and not problem.code.startswith("usd-")

    kept = [problem for problem in problems if not follows(problem)]
    has_reason = any(problem.is_error and problem.code != IMPOSSIBLE for problem in kept)
    return [*_once_per_line(problem for problem in kept if problem.code != IMPOSSIBLE or not has_reason)]


def _once_per_line(problems: Iterable[Problem]) -> Iterator[Problem]:
    """Problems; of many at one line of a file that differ by paths alone, as instances do, the first."""
    at_line = dict[object, list[Problem]]()
    for problem in problems:
        words = re.sub(r"<[^>]*/([^/>]+)>", r"<\1>", problem.message)
        key = (problem.code, problem.severity, problem.file, problem.line, words) if problem.file else problem
        at_line.setdefault(key, []).append(problem)
    for first, *more in at_line.values():
        other_prims = len({problem.at for problem in more} - {first.at})
        yield (
            replace(first, message=f"{first.message} (the same at {other_prims} more prims)") if other_prims else first
        )


def of_reader(thing: Usd.Prim | Usd.Property, error: PipelineError | ArithmeticError) -> Problem:
    """The problem of a reader's error: a value at its attribute, or parts that do not make up a prim."""
    if isinstance(error, UnreadableValue):
        return problem(error.thing, error.code, error.message, hint=error.hint)
    if isinstance(error, PipelineError):
        return problem(thing, IMPOSSIBLE, error.message, hint=error.hint)
    return problem(thing, IMPOSSIBLE, "the lens has no first-order figures: it bends no light")
