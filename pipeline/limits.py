"""Limits on the size of a dataset, checked before memory is allocated for it; see docs/limits.md."""

import os
from dataclasses import dataclass, fields

from pipeline.errors import UsageError
from pipeline.spelling import did_you_mean

VARIABLE = "PIPELINE_LIMITS"
MOST_SAMPLES = 1 << 16
"""Most rays per pixel and microlens when a noise level is requested [rays]: with independent rays, half of them black
and half white, the noise is then 0.2 %.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits on a dataset. The paper's rig, 6576 x 4384 pixels at K = 4, takes half of `pixels` and `rays`."""

    frames: int = 5_000  # of a dataset times its cameras
    pixels: int = (
        1_000_000_000  # fine pixels of a camera: width times height, times K^2 where position images are traced
    )
    rays: int = 1_000_000_000_000  # of one image of a camera, or of its bundles
    microlenses: int = 4_000_000  # of an array, counted in the square that contains it in any rotation
    points: int = 200_000  # of a target, on all its faces or steps
    triangles: int = 1_000_000  # of one mesh
    shapes: int = 20_000_000  # triangles of all occluders, those that change their shape counted in every frame
    instances: int = 10_000  # of all point instancers
    f_numbers: int = 100  # further white images of a camera
    picture_bytes: int = 256 * 2**20  # size of one picture on a surface or in the sky
    picture_pixels: int = 40_000_000


def limits() -> Limits:
    """The default limits, as changed by the environment: `PIPELINE_LIMITS="frames=2e4,rays=1e13"`.

    UsageError if the variable names an unknown limit, or a value is not a number.
    """
    raised = {}
    names = [field.name for field in fields(Limits)]
    for item in filter(None, (part.strip() for part in os.environ.get(VARIABLE, "").split(","))):
        name, _, text = item.partition("=")
        if name.strip() not in names:
            hint = did_you_mean(name.strip(), names) or f"limits are: {', '.join(names)}"
            raise UsageError(f'{VARIABLE}: "{item}" names no limit', hint=hint)
        try:
            raised[name.strip()] = int(float(text))
        except (ValueError, OverflowError):
            hint = 'write for example "frames=20000"'
            raise UsageError(f'{VARIABLE}: "{item}" holds no number', hint=hint) from None
    return Limits(**raised)


def how_to_raise(name: str, count: float) -> str:
    """Hint for an error about a limit: the setting that would accept this count."""
    return f'{VARIABLE}="{name}={count:.0f}" in the environment allows it, if memory, disk and time suffice'
