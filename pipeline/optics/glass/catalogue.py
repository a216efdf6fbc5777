"""Glasses by vendor and name: the catalogue that ships with the package; README.md here names its source.

Names are compared without case. `vendor:name` is one glass, a name alone is one only if a single vendor uses it: F5 of
CDGM and F5 of Schott differ by 0.02 in n_d.
"""

import csv
import difflib
import gzip
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from pipeline.optics.glass.medium import Dispersion, GlassError, Medium, Polynomial, Sellmeier

_NEAR_NAMES = 4
"""Most names in a hint: more would not be read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Glass(Medium):
    """An entry of the catalogue; its `label` is `vendor:name`."""

    vendor: str
    name: str
    stated_nd: float | None  # as the vendor prints them, rounded; for tests only
    stated_vd: float | None


def find(name: str) -> Glass:
    """The glass of a name, with or without `vendor:` in front.

    Raises GlassError: no entry has this name, or several vendors have one, and none is named.
    """
    vendor, _, bare = name.rpartition(":")
    glasses = [glass for glass in _named(bare) if vendor.casefold() in ("", glass.vendor)]
    if not glasses:
        near = near_names(name)
        hint = f"near names: {listed(near)}" if near else "write vendor:name, as in schott:N-BK7"
        raise GlassError(f'no glass "{name}" in the catalogue', hint=hint, code="unknown-glass")
    if len(glasses) > 1:
        message = f'"{name}" is a glass of {len(glasses)} vendors: {listed(glasses)}'
        hint = f'write one of them with its vendor, as in "{glasses[-1].label}"'
        raise GlassError(message, hint=hint, code="ambiguous-glass")
    return glasses[0]


def near_names(name: str) -> list[Glass]:
    """Glasses whose name resembles an unknown one: the same name at another vendor first."""
    vendor, _, bare = name.casefold().rpartition(":")
    exact = _named(bare)
    if exact:
        return exact
    names = list(_rows_by_name())
    prefixed = [entry for entry in names if entry.endswith("-" + bare)]  # N-BK7 for BK7
    spelt_nearly = difflib.get_close_matches(bare, names, n=_NEAR_NAMES, cutoff=0.6)
    close = [glass for entry in dict.fromkeys([*prefixed, *spelt_nearly]) for glass in _named(entry)]
    return ([glass for glass in close if glass.vendor == vendor] or close)[:_NEAR_NAMES]


def nearest(nd: float, vd: float, max_dnd: float, max_dvd: float) -> list[Glass]:
    """Glasses within limits of an n_d and a V_d, nearest first; the limits are the units of distance."""
    ranked = []
    for glass in catalogue():
        if glass.nd is None or glass.vd is None:
            continue
        dnd, dvd = abs(glass.nd - nd) / max_dnd, abs(glass.vd - vd) / max_dvd
        if max(dnd, dvd) <= 1:
            ranked.append((dnd + dvd, glass.label, glass))
    return [glass for _, _, glass in sorted(ranked, key=lambda row: row[:2])]


def listed(glasses: Iterable[Medium]) -> str:
    """Names with n_d and V_d, for messages."""
    return ", ".join(
        glass.label if glass.nd is None or glass.vd is None else f"{glass.label} ({glass.nd:.5f}/{glass.vd:.2f})"
        for glass in glasses
    )


@cache
def catalogue() -> tuple[Glass, ...]:
    """All glasses, in the order of the table: by vendor, then by name."""
    return tuple(map(_glass, range(len(_table()))))


@cache
def _table() -> list[dict[str, str]]:
    return rows_of("catalogue.csv.gz")


def rows_of(table: str, beside: str = __file__) -> list[dict[str, str]]:
    """Rows of a table that ships beside a module, by default this one."""
    with gzip.open(Path(beside).with_name(table), "rt", encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


@cache
def _rows_by_name() -> dict[str, list[int]]:
    """Numbers of the rows of each name without vendor, in lower case."""
    rows: dict[str, list[int]] = {}
    for number, row in enumerate(_table()):
        rows.setdefault(row["glass"].casefold(), []).append(number)
    return rows


def _named(bare: str) -> list[Glass]:
    """The glasses of a name without vendor."""
    return [_glass(number) for number in _rows_by_name().get(bare.casefold(), ())]


@cache
def _glass(number: int) -> Glass:
    """The glass of a row, made on demand: a lens needs a handful, and making all takes longer than reading them."""
    row = _table()[number]
    return Glass(
        label=f"{row['vendor']}:{row['glass']}",
        dispersion=_dispersion(row),
        min_nm=1000.0 * float(row["wl_min_um"]),
        max_nm=1000.0 * float(row["wl_max_um"]),
        vendor=row["vendor"],
        name=row["glass"],
        stated_nd=_number(row["nd_vendor"]),
        stated_vd=_number(row["Vd_vendor"]),
    )


def _dispersion(row: dict[str, str]) -> Dispersion:
    """The dispersion formula of a row, by its number in README.md here."""
    numbers = [float(row[f"c{i}"]) for i in range(15) if row[f"c{i}"]]
    constant = numbers[0]
    terms = tuple(zip(numbers[1::2], numbers[2::2], strict=True))
    if row["formula"] == "3":
        return Polynomial(constant=constant, terms=terms)
    if row["formula"] == "1":  # prints resonances, formula 2 their squares
        terms = tuple((strength, resonance * resonance) for strength, resonance in terms)
    return Sellmeier(constant=constant, terms=terms)


def _number(text: str) -> float | None:
    return float(text) if text else None
