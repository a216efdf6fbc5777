"""Catalogues of glass makers in the AGF format of Zemax: NM begins a glass, CD has coefficients, LD wavelengths.

Each formula becomes a `plen:glass` text, so that a stage needs no catalogue.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from pipeline.optics.glass.row import MAX_INDEX_DIFFERENCE, medium
from pipeline.optics.printed import D_LINE_NM
from pipeline.plugins.lenses.names import Named
from pipeline.plugins.lenses.text import UnreadableLens, number, read_lines

_EXPONENTS = {
    1: (2, -2, -4, -6, -8),
    10: (2, -2, -4, -6, -8, -10, -12),
    12: (2, -2, -4, -6, -8, 4, 6),
    13: (2, 4, -2, -4, -6, -8, -10, -12),
}
"""Powers of the wavelength after the constant of n^2, by the number of the formula."""
_SELLMEIER = {2: 6, 6: 8, 11: 10}
"""Numbers of coefficients of Sellmeier's formulas: pairs of strength and squared resonance."""
_UNSUPPORTED = {3: "Herzberger", 4: "Sellmeier 2", 5: "Conrady", 7: "Handbook of Optics 1", 8: "Handbook of Optics 2"}


def read_agf(path: str | Path, raw: bytes | None = None) -> dict[str, Callable[[], Named]]:
    """Glasses of a catalogue by their lower-case names, each a function that raises UnreadableLens for a formula that
    is not supported. `raw`: the content of a catalogue in an archive.
    """
    # Of each glass the words of its lines, by keyword, and the number of its first line.
    glasses = dict[str, dict[str, list[str]]]()
    rows = dict[str, list[str]]()
    for line, text in enumerate(read_lines(path, raw), 1):
        keyword, *words = text.split() or [""]
        if keyword == "NM":
            if len(words) < 4:
                raise UnreadableLens(path, "NM has no name, formula, number and index", line=line)
            rows = glasses[words[0].casefold()] = {"line": [str(line)]}
        rows[keyword] = words
    if not glasses:
        raise UnreadableLens(path, "holds no glass", hint="lines of an AGF catalogue begin with NM, CD and LD")
    return {name: partial(_glass, path, rows) for name, rows in glasses.items()}


def _glass(path: str | Path, rows: dict[str, list[str]]) -> Named:
    """The glass of one block of lines; UnreadableLens if its formula contradicts the index in its line NM."""
    line = int(rows["line"][0])
    name, formula, _, index = rows["NM"][:4]
    kind = number(path, line, formula, f"NM of {name}")
    nd = number(path, line, index, f"NM of {name}")
    coefficients = [number(path, line, word, f"CD of {name}") for word in rows.get("CD", ())]
    low_um, high_um = (number(path, line, word, f"LD of {name}") for word in [*rows.get("LD", ()), "0", "1e6"][:2])
    text = _text(int(kind), coefficients)
    if not text:
        reason = f"{kind:g}, {_UNSUPPORTED.get(int(kind), 'unknown')}, which we do not have"
        raise UnreadableLens(path, f"glass {name} has the dispersion formula {reason}", line=line)
    glass = medium(glass=text, index=None, abbe=None, wavelength_nm=D_LINE_NM)
    glass = replace(glass, label=f"{name} of {Path(path).name}", min_nm=1000 * low_um, max_nm=1000 * high_um)
    if glass.nd is not None and nd > 1 and abs(glass.nd - nd) > MAX_INDEX_DIFFERENCE:
        reason = f"glass {name} has n_d {nd:g} in its line NM and {glass.nd:.6g} by its formula {kind:g}"
        raise UnreadableLens(path, reason, line=line)
    remark = f"{glass.label} is known from {glass.min_nm:g} to {glass.max_nm:g} nm, which its formula does not say"
    return Named(medium=glass, glass=text, remark=remark)


def _text(kind: int, c: list[float]) -> str:
    """A dispersion formula as `plen:glass` text; empty if there is no equivalent."""
    if kind in _EXPONENTS:
        terms = [value for pair in zip(c[1:], _EXPONENTS[kind], strict=False) if pair[0] for value in pair]
        return f"polynomial({', '.join(map(repr, [*c[:1], *terms]))})"
    if kind == 9 and len(c) >= 5:
        c = [c[0] - 1, 0.0, *c[1:5]]
        kind = 2
    return f"sellmeier({', '.join(map(repr, c[: _SELLMEIER[kind]]))})" if kind in _SELLMEIER else ""
