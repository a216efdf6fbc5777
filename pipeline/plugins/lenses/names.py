"""Glass names in files of lens-design programs: makers by their dated catalogues, obsolete glasses and glasses without
a formula here, and codes of n_d and V_d. README.md here names the source of the table of names.

For importers, which report every substitution: in a stage a name is one glass, or an error.
"""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

from pipeline.optics.glass.catalogue import find, listed, nearest, rows_of
from pipeline.optics.glass.fluids import FLUIDS, fluid
from pipeline.optics.glass.medium import D_UM, GAS, Constant, GlassError, Medium
from pipeline.optics.glass.row import MAX_ABBE_DIFFERENCE, MAX_INDEX_DIFFERENCE, medium

_INDICES = (1.2, 5.0)
"""Least and largest index of a glass [1]: aerogels have less, germanium has 4.1 in the infrared."""
_OVER_2 = 200
"""Six-digit codes below this stand for an index above 2 [1e-3]: no glass has an index below 1.2, S-LAH79 is 003283
[1]."""
_NEAR = 3
"""Names that are proposed for an unknown one: more would not be read."""
_NOBODY, _MATERIAL = "", "material"
"""Vendors of names in catalogues of many makers, Zemax's MISC and CODE V's SPECIAL, and of their substitutes here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Named:
    """A medium by its name in a lens file."""

    medium: Medium
    glass: str = ""  # as `plen:glass` of a stage has it; empty where index and Abbe number say all
    remark: str = ""  # the substitute for the name, and how it differs; empty for the glass itself
    maker: str = _NOBODY

    def printed(self, wavelength_nm: float | None) -> tuple[float, float | None, str]:
        """Index at a wavelength, by default the d line, with Abbe number and name; OutOfRange beyond its formula."""
        return self.medium.index(wavelength_nm or 1000 * D_UM), self.medium.vd, self.glass


AIR = Named(medium=Medium(label="air", dispersion=Constant(n=1.0)))


def model(nd: float, vd: float | None, glass: str = "") -> Named:
    """A glass given by n_d and V_d alone, None for no dispersion; GlassError for an index that no glass has."""
    if not (_INDICES[0] <= nd <= _INDICES[1] or abs(nd - 1) <= GAS):
        raise GlassError(f"no medium of a lens has an index of {nd:g}", hint="glasses have 1.2 to 5, gases about 1")
    if vd:
        line = medium(glass="", index=nd, abbe=vd, wavelength_nm=1000 * D_UM)
        return Named(medium=replace(line, label=glass or line.label), glass=glass)
    return Named(medium=Medium(label=glass or f"{nd:g}", dispersion=Constant(n=nd)), glass=glass)


def named(name: str, catalogues: Sequence[str] = ()) -> Named:
    """The glass of a name or code, with or without `vendor:` in front; `catalogues` are those that its file names.

    A glass of these catalogues takes precedence, of the first one before the next. GlassError: no glass has that name,
    or none in these catalogues and several elsewhere that differ.
    """
    if numbers := _coded(name):
        close = nearest(*numbers, MAX_INDEX_DIFFERENCE, MAX_ABBE_DIFFERENCE)[:1]
        near = "".join(f"; the nearest glass is {listed([glass])}{_differences(glass, *numbers)}" for glass in close)
        remark = f"{name} is read as the normal line through {numbers[0]:g}/{numbers[1]:g}{near}"
        return replace(model(*numbers), remark=remark)
    # Glasses of that name, those of the named catalogues first.
    vendor, _, bare = name.rpartition(":")
    makers = [vendor.casefold()] if vendor else [maker(text) for text in catalogues]
    glasses = [glass for glass in _entries(bare) if vendor or glass.maker != _MATERIAL]
    own = sorted((glass for glass in glasses if glass.maker in makers), key=lambda glass: makers.index(glass.maker))
    if not own and (vendor or not glasses):
        near = ", ".join(_label(_entries(key)[0]) for key in difflib.get_close_matches(_plain(bare), _rows(), _NEAR, 0))
        raise GlassError(f'no glass "{name}" is known', hint=f"near names: {near}", code="unknown-glass")
    # Other makers' glasses of that name, if they are no copies of it.
    first, *alternatives = own or glasses
    rivals = ", ".join(dict.fromkeys(_label(glass) for glass in alternatives if _differ(glass.medium, first.medium)))
    if rivals and not own:
        message = f'"{name}" is a glass of several makers: {_label(first)}, {rivals}'
        raise GlassError(message, code="ambiguous-glass")
    remark = first.remark
    if rivals:
        remark = f"{name} is taken from the first of the file's catalogues, {_label(first)}; it is also {rivals}"
    elif not own and (catalogues or alternatives) and not remark:
        reason = "is in no catalogue that the file names" if catalogues else "is a glass of several makers that agree"
        remark = f"{name} {reason}; taken is {_label(first)}"
    return replace(first, remark=remark)


def maker(text: str) -> str:
    """The maker of a catalogue from its name, as CDGM-ZEMAX202206 or OLD_SCHO; empty for a catalogue of many makers."""
    words = re.findall("[a-z]{3,}", text.casefold())
    makers = {entry["vendor"] for rows in _rows().values() for entry in rows} - {_NOBODY, _MATERIAL}
    return next((name for word in words for name in makers if word.startswith(name) or name.startswith(word)), _NOBODY)


def _coded(text: str) -> tuple[float, float] | None:
    """n_d and V_d of a code: 517642, 620410.603236 of CODE V, or 1.5168:64.17; None for a name."""
    if six := re.fullmatch(r"(\d{3})(\d{3})", text):
        return 1 + int(six[1]) / 1000 + (int(six[1]) < _OVER_2), int(six[2]) / 10
    if long := re.fullmatch(r"(\d{3,})\.(\d{2})(\d+)", text):
        return float(f"1.{long[1]}"), float(f"{long[2]}.{long[3]}")
    pair = re.fullmatch(r"(\d+\.\d+):(\d+\.?\d*)", text)
    return (float(pair[1]), float(pair[2])) if pair else None


def _entries(bare: str) -> list[Named]:
    """Glasses of a name in the catalogue and in the table of names; hyphens count only if a name matches exactly."""
    rows = _rows().get(_plain(bare), [])
    exact = [entry for entry in rows if entry["glass"].casefold() == bare.casefold()]
    return list(map(_glass_of_row, exact or rows))


def _glass_of_row(entry: dict[str, str]) -> Named:
    """The glass of a row of either table: itself, its substitute, or the normal line through its numbers."""
    name, vendor = entry["glass"], entry["vendor"]
    # Rows of the catalogue have no column `stands`. In the table of names it names the substitute; empty: none.
    if "stands" not in entry:
        glass = find(f"{vendor}:{name}")
        return Named(medium=glass, glass=glass.label, maker=vendor)
    nd, vd = (float(entry[number]) if entry[number] else None for number in ("nd", "Vd"))
    name_and_maker = f"{name} of {vendor}" if vendor else name
    if nd and not entry["stands"]:
        if vd:
            stated = f"{nd:.5f}/{vd:.2f}"
            dispersion = "the normal line through these"
        else:
            stated = f"{nd:g}"
            dispersion = "no dispersion"
        remark = f"{name_and_maker} ({stated}) has no formula here and gets {dispersion}"
        return replace(model(nd, vd, name), remark=remark, maker=vendor)
    substitute = fluid(entry["stands"]) if entry["stands"] in FLUIDS else find(entry["stands"])
    differences = f" ({nd:.5f}/{vd:.2f}){_differences(substitute, nd, vd)}" if nd and vd else ""
    remark = f"{listed([substitute])} stands for {name_and_maker}{differences}"
    return Named(medium=substitute, glass=substitute.label, remark=remark, maker=vendor)


def _differences(glass: Medium, nd: float, vd: float) -> str:
    """Differences of n_d and V_d of a glass from stated values, in words; empty if it lacks either."""
    if glass.nd is None or glass.vd is None:
        return ""
    return f": n_d {round(glass.nd - nd, 5) + 0.0:+.5f}, V_d {round(glass.vd - vd, 2) + 0.0:+.2f}"


def _differ(glass: Medium, other: Medium) -> bool:
    dn = (glass.nd or 0) - (other.nd or 0)
    dv = (glass.vd or 0) - (other.vd or 0)
    return abs(dn) > MAX_INDEX_DIFFERENCE or abs(dv) > MAX_ABBE_DIFFERENCE


def _label(glass: Named) -> str:
    return listed([glass.medium]) + (f" of {glass.maker}" if glass.maker and ":" not in glass.medium.label else "")


def _plain(name: str) -> str:
    """A name as programs compare it: nsk2 is N-SK2, which CODE V calls NSK2."""
    return name.replace("-", "").casefold()


@cache
def _rows() -> dict[str, list[dict[str, str]]]:
    """Rows of the catalogue, then of the table of names, by plain name."""
    rows = dict[str, list[dict[str, str]]]()
    for entry in (*rows_of("catalogue.csv.gz"), *rows_of("names.csv.gz", __file__)):
        rows.setdefault(_plain(entry["glass"]), []).append(entry)
    return rows
