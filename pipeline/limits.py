"""Limits of the size of a dataset, checked before memory is allocated for it; see docs/limits.md."""

import os
from dataclasses import dataclass, fields

from pipeline.errors import UsageError
from pipeline.spelling import did_you_mean

VARIABLE = "PIPELINE_LIMITS"
MOST_SAMPLES = 1 << 16
"""Most samples of a pixel through a microlens where a noise is asked for [rays]: independent rays, half of them black
and half white, then have a noise of 0.2 %.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of a dataset.

    The paper's rig, 6576 x 4384 pixels at K = 4, takes half of `pixels` and `rays`.

    Attributes
    ----------
    frames : int
        Frames of a dataset times its cameras.
    pixels : int
        Fine pixels of a camera: width times height, times K^2 where position images are traced.
    rays : int
        Rays of one image of a camera, or of its bundles.
    microlenses : int
        Microlenses of an array, counted in the square that contains it in any rotation.
    points : int
        Points of a target, on all its faces or steps.
    triangles : int
        Triangles of one mesh.
    f_numbers : int
        Further white images of a camera.
    picture_bytes, picture_pixels : int
        Size of one picture on a surface or in the sky, and its pixels.
    """

    frames: int = 5_000
    pixels: int = 1_000_000_000
    rays: int = 1_000_000_000_000
    microlenses: int = 4_000_000
    points: int = 200_000
    triangles: int = 1_000_000
    f_numbers: int = 100
    picture_bytes: int = 256 * 2**20
    picture_pixels: int = 40_000_000


def limits() -> Limits:
    """The default limits, changed by the environment: `PIPELINE_LIMITS="frames=2e4,rays=1e13"`.

    Raises
    ------
    UsageError
        The variable names an unknown limit, or a value is not a number.
    """
    raised = {}
    for item in filter(None, (part.strip() for part in os.environ.get(VARIABLE, "").split(","))):
        name, _, text = item.partition("=")
        raised[_name(name.strip(), item)] = _count(text, item)
    return Limits(**raised)


def how_to_raise(name: str, count: float) -> str:
    """The hint of an error about a limit: the setting with which a count is accepted."""
    return f'{VARIABLE}="{name}={count:.0f}" in the environment allows it, if memory, disk and time suffice'


def _name(name: str, item: str) -> str:
    known = [field.name for field in fields(Limits)]
    if name in known:
        return name
    hint = did_you_mean(name, known) or f"limits are: {', '.join(known)}"
    raise UsageError(f'{VARIABLE}: "{item}" names no limit', hint=hint)


def _count(text: str, item: str) -> int:
    try:
        return int(float(text))
    except (ValueError, OverflowError):
        raise UsageError(f'{VARIABLE}: "{item}" holds no number', hint='write for example "frames=20000"') from None
