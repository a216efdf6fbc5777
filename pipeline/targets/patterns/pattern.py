"""Common parts of all patterns: a drawing, marks with ids, and the radiance of black and white."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from pipeline.errors import PipelineError
from pipeline.records.shapes import Float64
from pipeline.targets.drawing import Drawing


class TargetError(PipelineError):
    """A target that cannot be built, or whose orientation is ambiguous."""

    code = "bad-target"


@dataclass(frozen=True, slots=True)
class Marks:
    """Points of a pattern whose image positions are computed, in the order of their ids, in the chart."""

    xy_mm: Float64[np.ndarray, "n 2"]
    kinds: list[str]  # `corner`, `marker-corner`, `disc`, `centre`, `rim`, `crossing` or `end`
    radius_mm: Float64[np.ndarray, "n"]  # radius of the disc about a mark; NaN without a disc

    @staticmethod
    def of(*groups: tuple[str, np.ndarray], radius_mm: float = np.nan) -> "Marks":
        """Marks of several kinds, one kind after the other."""
        xy = np.concatenate([np.asarray(points, float).reshape(-1, 2) for _, points in groups])
        kinds = [kind for kind, points in groups for _ in range(len(points))]
        return Marks(xy, kinds, np.full(len(xy), radius_mm))


@dataclass(frozen=True, slots=True, kw_only=True)
class Pattern:
    """A flat pattern about the origin of the chart, x right, y up, with the relative radiance of its two colours.

    The schema states the ranges of its fields; a record rejects only inconsistent combinations. Each field is annotated
    with its attribute in a stage. The class of the schema is `Plen` and the name of the record.
    """

    KIND: ClassVar[str]
    ORDER: ClassVar[str]

    white: Annotated[float, "plen:white"] = 1.0
    black: Annotated[float, "plen:black"] = 0.0

    @property
    def drawing(self) -> Drawing:
        raise NotImplementedError

    def marks(self) -> Marks:
        raise NotImplementedError

    def title(self) -> str:
        """One line for a print: kind, size and ids."""
        raise NotImplementedError

    def for_face(self, number: int) -> "Pattern":
        """The pattern on another face of the target, where the numbers of tags continue."""
        return self

    def radiance(self, x_mm: Float64[np.ndarray, "n"], y_mm: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Radiance at points of the chart, (n,); NaN beside the sheet."""
        whiteness = self.drawing.whiteness(x_mm, y_mm)
        return np.where(np.isnan(whiteness), np.nan, np.where(whiteness == 1, self.white, self.black))


def drawn_once(draw: Callable[[Any], Drawing]) -> Callable[[Any], Drawing]:
    """Decorate the drawing of a pattern, so that equal patterns are drawn once.

    A large board has tens of thousands of pieces, and every tile of a truth uses its drawing. Eight are kept: the faces
    of a cube, and two more.
    """
    return functools.lru_cache(maxsize=8)(draw)


def grid(columns: int, rows: int, spacing_mm: float) -> np.ndarray:
    """Points of a grid about the origin, rows from the top, each from the left, (rows * columns, 2)."""
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    x = (column - (columns - 1) / 2) * spacing_mm
    y = ((rows - 1) / 2 - row) * spacing_mm
    return np.stack([x.ravel(), y.ravel()], axis=1)
