"""Catalogues of glass makers in the AGF format of Zemax: NM begins a glass, CD has coefficients, LD wavelengths.

A formula becomes the text by which a stage has it, so that a stage needs no catalogue. Formulas that we do not have are
an error of the glass, for the file that uses it.
"""

from dataclasses import replace
from pathlib import Path

from pipeline.errors import PipelineError
from pipeline.files.lenses.text import UnreadableLens, number, read_lines
from pipeline.optics.glass.names import Named
from pipeline.optics.glass.row import MAX_INDEX_DIFFERENCE, medium
from pipeline.optics.printed import D_LINE_NM

_EXPONENTS = {
    1: (2, -2, -4, -6, -8),
    10: (2, -2, -4, -6, -8, -10, -12),
    12: (2, -2, -4, -6, -8, 4, 6),
    13: (2, 4, -2, -4, -6, -8, -10, -12),
}
"""Powers of the wavelength behind the constant of n^2, by the number of the formula: Schott, Extended, and two more."""
_SELLMEIER = {2: 6, 6: 8, 11: 10}
"""Numbers of coefficients of Sellmeier's formulas: pairs of strength and squared resonance."""
_NAMES = {3: "Herzberger", 4: "Sellmeier 2", 5: "Conrady", 7: "Handbook of Optics 1", 8: "Handbook of Optics 2"}
_LARGEST_NM = 1e9


def read_agf(path: str | Path) -> dict[str, Named | PipelineError]:
    """Glasses of a catalogue by their names in small letters; UnreadableLens for a file that is none."""
    found, lines = dict[str, Named | PipelineError](), read_lines(path)
    starts = [i for i, row in enumerate(lines) if row.split()[:1] == ["NM"]]
    for first, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        rows = {
            row.split()[0]: (i, row.split()[1:]) for i, row in enumerate(lines[first:end], first + 1) if row.split()
        }
        line, words = rows["NM"]
        if len(words) < 4:
            raise UnreadableLens(path, "NM has no name, formula, number and index", line=line)
        try:
            found[words[0].casefold()] = _glass(path, line, words, rows)
        except PipelineError as error:
            found[words[0].casefold()] = error
    if not found:
        raise UnreadableLens(path, "holds no glass", hint="lines of an AGF catalogue begin with NM, CD and LD")
    return found


def _glass(path: str | Path, line: int, words: list[str], rows: dict[str, tuple[int, list[str]]]) -> Named:
    name, kind = words[0], int(number(path, line, words[1], "NM"))
    place, listed = rows.get("CD", (line, []))
    low_um, high_um = (number(path, line, word, "LD") for word in [*rows.get("LD", (line, []))[1], "0", "1e6"][:2])
    text = _text(kind, [number(path, place, word, "CD") for word in listed])
    if not text:
        shown = f"{_NAMES[kind]} ({kind})" if kind in _NAMES else kind
        raise UnreadableLens(path, f"glass {name} has the dispersion formula {shown}, which we do not have", line=line)
    plain = medium(glass=text, index=None, abbe=None, wavelength_nm=D_LINE_NM)
    glass = replace(plain, label=f"{name} of {Path(path).name}", min_nm=1000 * low_um, max_nm=1000 * high_um)
    stated = number(path, line, words[3], "NM")
    if glass.nd is not None and stated > 1 and abs(glass.nd - stated) > MAX_INDEX_DIFFERENCE:
        reason = f"glass {name} has n_d {stated:g} in its line NM and {glass.nd:.6g} by its formula {kind}"
        raise UnreadableLens(path, reason, line=line)
    said = f"{glass.label} is known from {glass.min_nm:g} to {glass.max_nm:g} nm, which its formula does not say"
    return Named(medium=glass, glass=text, remark=said)


def _text(kind: int, c: list[float]) -> str:
    """A dispersion formula as `plen:glass` has it; empty if we have none such."""
    if kind in _EXPONENTS:
        terms = [number for pair in zip(c[1:], _EXPONENTS[kind], strict=False) if pair[0] for number in pair]
        return f"polynomial({', '.join(map(repr, [c[0], *terms]))})"
    if kind == 9 and len(c) >= 5:
        c, kind = [c[0] - 1, 0.0, *c[1:5]], 2
    return f"sellmeier({', '.join(map(repr, c[: _SELLMEIER[kind]]))})" if kind in _SELLMEIER else ""
