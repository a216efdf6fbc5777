"""Light of luminaires by direction: files of the IES, ANSI/IES LM-63, of type C."""

import math
import re

import numpy as np

from pipeline.errors import PipelineError

SUFFIX = ".ies"
"""End of the names of these files."""
_TYPE_C = 1
"""Type of photometry whose polar axis is the vertical of the luminaire [1]."""
_HEAD = 13
"""Numbers before the angles [1]."""
_HALF_RAD = 0.1
"""What polar angles may exceed a quarter turn by and still be those of a hemisphere [rad], as in USD's own renderer."""


def read_ies(content: bytes) -> np.ndarray:
    """Intensities by angle, (around, polar, 4) float32: intensity times the multipliers of the file, polar angle and
    angle around [rad], and the mean intensity over the sphere, or the hemisphere, that the polar angles cover.

    Angles around run from 0 to a full turn, whatever symmetry the file makes use of.
    Raises PipelineError: the file is none of type C, or its numbers do not fit each other.
    """
    numbers = _numbers(content.decode("latin-1"))
    if len(numbers) < _HEAD:
        raise PipelineError("is no IES file that can be read", hint="it needs a line TILT= and the numbers behind it")
    multiplier, polars, arounds, kind = numbers[2], int(numbers[3]), int(numbers[4]), int(numbers[5])
    ballast, future = numbers[10], numbers[11]
    if kind != _TYPE_C:
        raise PipelineError(f"has photometry of type {kind}", hint="known is type C, which is 1")
    if polars < 2 or arounds < 1 or len(numbers) < _HEAD + polars + arounds + polars * arounds:
        raise PipelineError(
            f"has {len(numbers)} numbers, too few for {polars} by {arounds} angles", hint="write it anew"
        )
    polar, around, rest = np.split(np.array(numbers[_HEAD:]), [polars, polars + arounds])
    candela = rest[: polars * arounds].reshape(arounds, polars) * multiplier * ballast * future
    around, candela = _all_around(around, candela)
    steps = np.diff(polar).min(), np.diff(around).min()
    if min(steps) <= 0 or polar[0] < 0 or polar[-1] > 180 or not np.isfinite(candela).all() or candela.min() < 0:
        raise PipelineError("has angles that do not ascend from 0 to 180, or intensities below 0", hint="write it anew")
    table = np.zeros((*candela.shape, 4))
    table[..., 0], table[..., 1], table[..., 2] = candela, np.radians(polar), np.radians(around)[:, None]
    table[..., 3] = _mean(np.radians(polar), np.radians(around), candela)
    return table.astype(np.float32)


def _numbers(text: str) -> list[float]:
    """All numbers behind the line of the tilt, and behind the angles and factors of that, if they are there."""
    found = re.search(r"^\s*TILT\s*=\s*(\S+)[^\n]*\n", text, re.MULTILINE | re.IGNORECASE)
    if not found:
        return []
    try:
        numbers = [float(word) for word in text[found.end() :].replace(",", " ").split()]
        if not np.isfinite(numbers).all():
            raise ValueError("one of its numbers is not finite")
    except ValueError as error:
        raise PipelineError(f"is no IES file that can be read: {error}") from error
    if found[1].upper() == "INCLUDE" and len(numbers) > 1:
        return numbers[2 + 2 * int(numbers[1]) :]
    return numbers


def _all_around(around: np.ndarray, candela: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles from 0 to 360 degrees with their intensities, from those of one plane, a quarter, a half or all."""
    first, last = around[0], around[-1]
    if len(around) == 1:
        return np.array([0.0, 360.0]), np.concatenate([candela, candela])
    if (first, last) == (90.0, 270.0):  # alike on both sides of the plane through 90 and 270 degrees
        low, high = around <= 180, around >= 180
        around = np.concatenate([180 - around[low][::-1], around[1:-1], 540 - around[high][::-1]])
        return around, np.concatenate([candela[low][::-1], candela[1:-1], candela[high][::-1]])
    if first != 0:
        raise PipelineError(f"has angles around from {first:g} to {last:g} degrees", hint="they start at 0, or at 90")
    for end in (90.0, 180.0):
        if last == end:
            around = np.concatenate([around, 2 * end - around[-2::-1]])
            candela, last = np.concatenate([candela, candela[-2::-1]]), around[-1]
    if last < 360:
        around, candela = np.append(around, 360.0), np.concatenate([candela, candela[:1]])
    return around, candela


def _mean(polar: np.ndarray, around: np.ndarray, candela: np.ndarray) -> float:
    """Mean over the directions that the polar angles cover of what is linear between all angles."""
    steps = np.diff(around)
    rings = ((candela[:-1] + candela[1:]) / 2 * steps[:, None]).sum(axis=0)
    low, high = polar[:-1], polar[1:]
    slope = np.diff(rings) / np.diff(polar)
    # Integrals of sin, and of (x - low) sin, over each step.
    flat = np.cos(low) - np.cos(high)
    rising = np.sin(high) - np.sin(low) - (high - low) * np.cos(high)
    whole = 4 * math.pi if polar[-1] - polar[0] > math.pi / 2 + _HALF_RAD else 2 * math.pi
    return float(np.sum(rings[:-1] * flat + slope * rising)) / whole
