"""Glasses of a lens file: looked up by name, or replaced as the user says. All unknown glasses are refused in one
error, and each substitution is a remark.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from pipeline.errors import PipelineError, UsageError
from pipeline.optics.printed import Lost
from pipeline.plugins.lenses.agf import read_agf
from pipeline.plugins.lenses.names import AIR, Named, model, named
from pipeline.plugins.lenses.text import UnreadableLens


class Glasses:
    """Glasses of one file, collected while it is read.

    `catalogues`: AGF files of makers, whose names take precedence over all others.
    `replaced`: texts NAME=OTHER, OTHER being a name with its vendor, or of these files, or a code.
    Raises PipelineError: a file is no catalogue, or a text is none of these.
    """

    def __init__(self, path: str | Path, catalogues: Iterable[Path] = (), replaced: Iterable[str] = ()) -> None:
        self.path = path
        self._chosen = {name: glass for file in catalogues for name, glass in read_agf(file).items()}
        self.packed = dict[str, Callable[[], Named]]()  # of the archive of a lens, by name: for what nobody else knows
        self._unused = dict[str, str]()  # replaced names that no surface has had so far
        self._unknown = dict[str, str]()  # what is said of each, by name
        self._remarks = dict[str, tuple[int, list[str]]]()  # first line and surfaces, by remark
        for text in replaced:
            name, _, other = text.partition("=")
            if not (name and other):
                raise UsageError(f"--glass {text}", hint="write NAME=vendor:OTHER, as in BK7=schott:N-BK7")
            substitute = self._chosen.get(other.casefold(), partial(named, other))()
            remark = ": ".join(filter(None, (f"{name} is replaced by {other}", substitute.remark)))
            self._chosen[name.casefold()] = partial(replace, substitute, remark=remark)
            self._unused[name.casefold()] = name

    def look_up(self, line: int, surface: int, name: str, catalogues: Sequence[str] = ()) -> Named:
        """The medium of a name or code, in the catalogues that a file names; air for one that `finish` will refuse."""
        self._unused.pop(name.casefold(), None)
        try:
            glass = self._chosen.get(name.casefold(), partial(named, name, catalogues))()
        except PipelineError as error:
            if name.casefold() not in self.packed:
                return self._refused(name, line, surface, error)
            glass = self.packed[name.casefold()]()
        self.remark(line, surface, glass.remark)
        return glass

    def model(self, line: int, surface: int, numbers: tuple[float, float | None], name: str = "") -> Named:
        """A glass of which the file states n_d and V_d; UnreadableLens for numbers that no medium has."""
        try:
            return model(*numbers, name)
        except PipelineError as error:
            raise UnreadableLens(self.path, f"surface {surface}: {error.message}", line=line, hint=error.hint) from None

    def remark(self, line: int, surface: int, statement: str) -> None:
        """Note a remark on the glass of a surface, once for all surfaces that it applies to."""
        if statement:
            self._remarks.setdefault(statement, (line, []))[1].append(str(surface))

    @staticmethod
    def wavelength_nm(media: Sequence[Named], primary_nm: float | None) -> float | None:
        """The wavelength of a lens of these media: that of its file, if one has no index at the d line, else None."""
        return None if all(glass.medium.nd is not None for glass in media) else primary_nm

    def printed(self, line: int, surface: int, glass: Named, nm: float | None) -> tuple[float, float | None, str]:
        """Index at a wavelength, by default the d line, with Abbe number and name; air if `finish` will refuse it."""
        try:
            return glass.printed(nm)
        except PipelineError as error:
            return self._refused(glass.glass, line, surface, error).printed(nm)

    def finish(self) -> list[Lost]:
        """Remarks on substitutions; UnreadableLens with all unknown glasses."""
        if self._unused:
            raise UnreadableLens(self.path, f"has no glass {', '.join(self._unused.values())}, which --glass replaces")
        if self._unknown:
            hint = "--glass NAME=vendor:OTHER replaces a glass, --glasses FILE.agf reads a catalogue of its maker"
            raise UnreadableLens(self.path, "; ".join(self._unknown.values()), hint=hint)
        return [
            Lost(f"surface{'s' * (len(surfaces) > 1)} {', '.join(surfaces)}: {statement}", line)
            for statement, (line, surfaces) in self._remarks.items()
        ]

    def _refused(self, name: str, line: int, surface: int, error: PipelineError) -> Named:
        """Air, for a glass that is refused in the error of `finish`."""
        reason = f"surface {surface}, line {line}: {error.message}" + (f", {error.hint}" if error.hint else "")
        self._unknown.setdefault(name.casefold(), reason)
        return AIR
