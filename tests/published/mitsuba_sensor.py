"""Mitsuba 3 as it sees with the pinhole at the origin of the vision frame."""

from typing import Any

import mitsuba as mi

mi.set_variant("scalar_rgb")
WIDTH_PX, HEIGHT_PX, FOV_DEG = 24, 18, 50.0
"""Size of the pictures, and the horizontal field of view."""


def pinhole(samples: int, fov_deg: float = FOV_DEG, size_px=(WIDTH_PX, HEIGHT_PX), **more: Any) -> dict[str, Any]:
    """Mitsuba's sensor at the origin of the vision frame: a horizontal field of view, and pixels without a filter."""
    film = {"type": "hdrfilm", "width": size_px[0], "height": size_px[1], "rfilter": {"type": "box"}}
    return {
        "type": "perspective",
        "fov": fov_deg,
        "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 0], target=[0, 0, 1], up=[0, -1, 0]),
        "film": {**film, "pixel_format": "rgb"},
        "sampler": {"type": "independent", "sample_count": samples},
        **more,
    }
