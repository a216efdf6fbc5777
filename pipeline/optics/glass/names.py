"""Names of glasses in files of lens-design programs: makers by their dated catalogues, glasses that have no formula
here or are no longer made, and codes of n_d and V_d. README.md here says where the table of names comes from.

Importers ask here, and report what they take: in a stage a name is one glass, or an error.
"""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

from pipeline.optics.glass import catalogue
from pipeline.optics.glass.catalogue import listed, without_hyphens
from pipeline.optics.glass.fluids import FLUIDS, fluid
from pipeline.optics.glass.medium import D_UM, GAS, Constant, GlassError, Medium, NormalLine
from pipeline.optics.glass.row import MAX_ABBE_DIFFERENCE, MAX_INDEX_DIFFERENCE, MODEL_RANGE_NM

_INDICES = (1.2, 5.0)
"""Least and largest index of a glass [1]: aerogels have less, germanium has 4.1 in the infrared."""
_OVER_2 = 200
"""Codes of six figures count from 2 below it [1e-3]: no glass has an index below 1.2, S-LAH79 is 003283 [1]."""
_NEAR = 3
"""Names that are proposed for an unknown one: more would not be read."""
_ANY = ""
"""Maker of names that are nobody's: those in MISC and INFRARED of Zemax, and in SPECIAL of CODE V."""
_MATERIAL = "material"
"""Vendor of entries that are no maker's; programs have names of their own for them."""
_OTHER_NAMES = {"nikon": "hikari"}
"""Names of catalogues that are not those of their makers here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Named:
    """A medium by the name that a lens file gives it."""

    medium: Medium
    glass: str = ""  # as `plen:glass` of a stage has it; empty where index and Abbe number say all
    remark: str = ""  # says which glass stands for the name, and how it differs; empty for the glass itself
    maker: str = _ANY

    def printed(self, wavelength_nm: float | None) -> tuple[float, float | None, str]:
        """Index at a wavelength, by default the d line, with Abbe number and name; OutOfRange if it has none there."""
        return self.medium.index(wavelength_nm or 1000 * D_UM), self.medium.vd, self.glass


AIR = Named(medium=Medium(label="air", dispersion=Constant(n=1.0)))


def model(nd: float, vd: float | None, glass: str = "") -> Named:
    """A glass of which only n_d and V_d are known, None for no dispersion; GlassError for an index that none has."""
    if not (_INDICES[0] <= nd <= _INDICES[1] or abs(nd - 1) <= GAS):
        raise GlassError(f"no medium of a lens has an index of {nd:g}", hint="glasses have 1.2 to 5, gases about 1")
    if not vd:
        return Named(medium=Medium(label=glass or f"{nd:g}", dispersion=Constant(n=nd)), glass=glass)
    low_nm, high_nm = MODEL_RANGE_NM
    label = glass or f"normal line {nd:g}/{vd:g}"
    medium = Medium(label=label, dispersion=NormalLine(nd=nd, vd=vd), min_nm=low_nm, max_nm=high_nm)
    return Named(medium=medium, glass=glass)


def named(name: str, catalogues: Sequence[str] = ()) -> Named:
    """The glass of a name or code, with `vendor:` in front or without; `catalogues` are those that its file names.

    One of these counts before all others, and the first before the next. GlassError: no glass has that name, or none in
    these catalogues and several elsewhere that differ.
    """
    if coded := _coded(name):
        return coded
    vendor, _, bare = name.rpartition(":")
    makers = [vendor.casefold()] if vendor else [maker(text) for text in catalogues]
    every = [one for one in _entries(bare) if one.maker != _MATERIAL or vendor]
    own = sorted((one for one in every if one.maker in makers), key=lambda one: makers.index(one.maker))
    if not own and (vendor or not every):
        raise GlassError(f'no glass "{name}" is known', hint=_proposed(bare), code="unknown-glass")
    first, *others = own or every
    rivals = ", ".join(dict.fromkeys(_shown(one) for one in others if _differ(one.medium, first.medium)))
    if rivals and not own:
        what = f'"{name}" is a glass of several makers: {_shown(first)}, {rivals}'
        raise GlassError(what, code="ambiguous-glass")
    said = [first.remark]
    if rivals:
        said.append(f"{name} is taken from the first of the file's catalogues, {_shown(first)}; it is also {rivals}")
    elif not own and (catalogues or others) and not first.remark:
        why = "is in no catalogue that the file names" if catalogues else "is a glass of several makers that agree"
        said.append(f"{name} {why}; taken is {_shown(first)}")
    return replace(first, remark="; ".join(filter(None, said)))


def maker(text: str) -> str:
    """The maker of a catalogue by its name, as CDGM-ZEMAX202206 or OLD_SCHO; empty for a catalogue of many."""
    for word in re.findall("[a-z]{3,}", text.casefold()):
        named_so = _OTHER_NAMES.get(word, word)
        for one in _makers():
            if named_so.startswith(one) or one.startswith(named_so):
                return one
    return _ANY


def _coded(text: str) -> Named | None:
    """The model of a code: 517642, 620410.603236 of CODE V, or 1.5168:64.17; None for a name."""
    if six := re.fullmatch(r"(\d{3})(\d{3})", text):
        nd, vd = 1 + int(six[1]) / 1000 + (int(six[1]) < _OVER_2), int(six[2]) / 10
    elif long := re.fullmatch(r"(\d{3,})\.(\d{3,})", text):
        nd, vd = float(f"1.{long[1]}"), float(f"{long[2][:2]}.{long[2][2:]}")
    elif pair := re.fullmatch(r"(\d+\.\d+):(\d+\.?\d*)", text):
        nd, vd = float(pair[1]), float(pair[2])
    else:
        return None
    close = catalogue.nearest(nd, vd, MAX_INDEX_DIFFERENCE, MAX_ABBE_DIFFERENCE)[:1]
    near = "".join(f"; the nearest glass is {listed([glass])}{_apart(glass, nd, vd)}" for glass in close)
    return replace(model(nd, vd), remark=f"{text} is read as the normal line through {nd:g}/{vd:g}{near}")


def _entries(bare: str) -> list[Named]:
    """Glasses of a name, of the catalogue and of the table of names; hyphens aside where none has it to the letter."""
    plain = without_hyphens(bare)
    made = [
        (glass.name, Named(medium=glass, glass=glass.label, maker=glass.vendor)) for glass in catalogue.spelt(plain)
    ]
    made += [(row["glass"], _of_row(row)) for row in _rows().get(plain, ())]
    exact = [one for name, one in made if name.casefold() == bare.casefold()]
    return exact or [one for _, one in made]


def _of_row(row: dict[str, str]) -> Named:
    """The glass that stands for a name of the table, or the normal line through its n_d and V_d."""
    stands, nd, vd = row["stands"], *(float(row[name]) if row[name] else None for name in ("nd", "Vd"))
    whose = f"{row['glass']} of {row['vendor']}" if row["vendor"] else row["glass"]
    if not stands:
        assert nd is not None, row
        line = "no dispersion" if vd is None else "the normal line through them"
        known = f"{nd:.5f}" if vd is None else f"{nd:.5f}/{vd:.2f}"
        said = f"{whose} ({known}) has no formula here: it gets {line}"
        return replace(model(nd, vd, row["glass"]), remark=said, maker=row["vendor"])
    medium = fluid(stands) if stands in FLUIDS else catalogue.find(stands)
    if nd is None or vd is None:
        said = f"{medium.label} stands for {whose}"
    else:
        said = f"{listed([medium])} stands for {whose} ({nd:.5f}/{vd:.2f}){_apart(medium, nd, vd)}"
    return Named(medium=medium, glass=medium.label, remark=said, maker=row["vendor"])


def _apart(glass: Medium, nd: float, vd: float) -> str:
    """How far n_d and V_d of a glass are from stated ones."""
    if glass.nd is None or glass.vd is None:
        return ""
    return f": n_d {round(glass.nd - nd, 5) + 0.0:+.5f}, V_d {round(glass.vd - vd, 2) + 0.0:+.2f}"


def _shown(one: Named) -> str:
    return listed([one.medium]) + (f" of {one.maker}" if one.maker and ":" not in one.medium.label else "")


def _differ(one: Medium, other: Medium) -> bool:
    if one.nd is None or one.vd is None or other.nd is None or other.vd is None:
        return one.label != other.label
    return abs(one.nd - other.nd) > MAX_INDEX_DIFFERENCE or abs(one.vd - other.vd) > MAX_ABBE_DIFFERENCE


def _proposed(bare: str) -> str:
    """Names that resemble an unknown one, as a hint."""
    rows = [*catalogue.table(), *(row for rows in _rows().values() for row in rows)]
    names = {row["glass"].casefold() for row in rows}
    near = difflib.get_close_matches(bare.casefold(), names, n=_NEAR, cutoff=0)
    return f"near names: {', '.join(_shown(_entries(name)[0]) for name in near)}"


@cache
def _makers() -> frozenset[str]:
    rows = [*catalogue.table(), *(row for rows in _rows().values() for row in rows)]
    return frozenset(row["vendor"] for row in rows) - {_ANY, _MATERIAL}


@cache
def _rows() -> dict[str, list[dict[str, str]]]:
    """Rows of the table of names, by name without hyphens."""
    rows = dict[str, list[dict[str, str]]]()
    for row in catalogue.rows_of("names.csv.gz"):
        rows.setdefault(without_hyphens(row["glass"]), []).append(row)
    return rows
