"""Share of light that passes the surfaces and the glass of a lens, ray by ray, by NumPy.

Fresnel's equations for unpolarised light at every bare surface: half of it is polarised along the surface, half across,
and both halves keep to themselves in a centred lens near its meridional planes. Light that is reflected twice and
arrives after all is lost here.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.rays import incidence, traced
from pipeline.optics.table import INDEX_RATIO, TERMS
from pipeline.optics.transmission.coatings import Coating, angles_deg
from pipeline.records.declared import settle
from pipeline.records.shapes import Float64


@dataclass(frozen=True, slots=True, kw_only=True)
class Losses:
    """Losses of a lens at one wavelength, from the scene to the sensor.

    Attributes
    ----------
    coatings : tuple of Coating or None
        Coating of each surface; None: a bare one.
    per_mm : tuple of float
        Share of light that a millimetre of the medium behind each surface lets pass.
    """

    coatings: tuple[Coating | None, ...]
    per_mm: tuple[float, ...]

    def __post_init__(self) -> None:
        settle(self, PrescriptionError)
        if not all(0 < share <= 1 for share in self.per_mm):
            raise PrescriptionError(f"a medium lets a share of light above 0 and up to 1 pass: {self.per_mm} per mm")


def transmitted(
    table: Float64[np.ndarray, "surfaces columns"],
    position_mm: Float64[np.ndarray, "n 3"],
    direction: Float64[np.ndarray, "n 3"],
    losses: Losses,
) -> np.ndarray:
    """Share of the light of rays that leaves the last surface of a table, (n,); 0 for those that do not pass.

    Parameters
    ----------
    table : (surfaces, columns) float64
        Table from `optics.table`.
    position_mm, direction : (n, 3) float64
        Points on the rays and unit directions with a positive z.
    losses : Losses
        Losses in the order of the table. Light comes from air.
    """
    across, along = np.ones(len(position_mm)), np.ones(len(position_mm))
    alive = np.ones(len(position_mm), bool)
    met = _met(table, position_mm, direction)
    for at, coat, glass in zip(met, losses.coatings, (1.0, *losses.per_mm[:-1]), strict=True):
        inside = np.asarray(glass ** np.where(np.isfinite(at.way_mm), np.maximum(at.way_mm, 0.0), 0.0))
        if coat is not None:
            shares = coat.passed(at.before, at.behind, at.cosine)
        elif at.row[TERMS] < 0 or at.row[INDEX_RATIO] == 1:
            shares = np.ones((2, len(alive)))
        else:
            shares = fresnel(at.row[INDEX_RATIO], at.direction, at.bent)
        across, along = across * shares[0] * inside, along * shares[1] * inside
        alive &= at.passes
    return np.where(alive, (across + along) / 2, 0.0)


def steepest_deg(
    table: Float64[np.ndarray, "surfaces columns"],
    position_mm: Float64[np.ndarray, "n 3"],
    direction: Float64[np.ndarray, "n 3"],
) -> np.ndarray:
    """Largest angle at which rays that pass a table meet each surface, (surfaces,), as tables of coatings count it;
    0 where no ray passes. The arguments are those of `transmitted`.
    """
    alive, angles = np.ones(len(position_mm), bool), []
    for at in _met(table, position_mm, direction):
        angles.append(angles_deg(at.before, at.behind, at.cosine))
        alive &= at.passes
    return np.array([angle[alive].max(initial=0.0) for angle in angles])


class _Met(NamedTuple):
    """Rays at a surface: its row, the way there, directions before and behind, which pass, cosines of the angles of
    incidence, and the indices before and behind.
    """

    row: np.ndarray
    way_mm: np.ndarray
    direction: np.ndarray
    bent: np.ndarray
    passes: np.ndarray
    cosine: np.ndarray
    before: float
    behind: float


def _met(table: np.ndarray, position_mm: np.ndarray, direction: np.ndarray) -> Iterator[_Met]:
    """Rays at one surface after the other."""
    behind = 1.0
    for row in table:
        before, behind = behind, behind / row[INDEX_RATIO]
        point, bent, passes = traced(row[None], position_mm, direction)
        way_mm = np.sum((point - position_mm) * direction, axis=1)
        yield _Met(row, way_mm, direction, bent, passes, incidence(row, point, direction), before, behind)
        position_mm, direction = point, bent


def fresnel(index_ratio: float, before: Float64[np.ndarray, "n 3"], behind: Float64[np.ndarray, "n 3"]) -> np.ndarray:
    """Share of light that a bare surface lets pass, polarised across the plane of incidence and in it, (2, n).

    With i and r the angles of incidence and of refraction, reflectances are (sin(i - r) / sin(i + r))^2 and
    (tan(i - r) / tan(i + r))^2 (Fresnel 1823), here by cosines, which hold at normal incidence, too.

    Parameters
    ----------
    index_ratio : float
        Index before the surface over that behind it.
    before, behind : (n, 3) float64
        Unit directions of rays.
    """
    # The normal lies along n' d' - n d, whose length is n' cos r - n cos i.
    normal = behind - index_ratio * before
    with np.errstate(invalid="ignore"):
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        i, r = (np.abs(np.sum(normal * way, axis=1)) for way in (before, behind))
        n = index_ratio
        s, p = (n * i - r) / (n * i + r), (n * r - i) / (n * r + i)
    return np.stack([1 - s**2, 1 - p**2])
