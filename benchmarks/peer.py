"""The same race run by batoid, a lens tracer in C++ (https://github.com/jmeyers314/batoid). Optional."""

from typing import Any

import numpy as np
from lenses import Race

try:
    import batoid
    import batoid.global_vars
except ImportError:
    batoid = None  # type: ignore[assignment]


def version() -> str | None:
    """Version of batoid; None if it is not installed."""
    return batoid.__version__ if batoid else None


def use_threads(count: int) -> None:
    """Batoid would start a thread per core, whatever OMP_NUM_THREADS says."""
    batoid.global_vars._batoid_max_threads = count


def optic(race: Race) -> Any:
    """The lens as batoid's compound optic; an obscuration clips at every semi-diameter."""
    items, before = [], 1.0
    for surface, z in zip(race.prescription.surfaces, race.prescription.vertices_mm, strict=True):
        c = surface.curvature_per_mm
        place = batoid.CoordSys(origin=[0.0, 0.0, z])
        clip = batoid.ObscNegation(batoid.ObscCircle(surface.semi_diameter_mm))
        shape = batoid.Sphere(1 / c) if c else batoid.Plane()
        if surface.index == before:
            items.append(batoid.Baffle(shape, name=f"S{len(items)}", coordSys=place, obscuration=clip))
        else:
            media = {"inMedium": batoid.ConstMedium(before), "outMedium": batoid.ConstMedium(surface.index)}
            name = f"S{len(items)}"
            items.append(batoid.RefractiveInterface(shape, name=name, coordSys=place, obscuration=clip, **media))
        before = surface.index
    image = batoid.CoordSys(origin=[0.0, 0.0, race.prescription.vertices_mm[-1] + race.image_mm])
    items.append(batoid.Detector(batoid.Plane(), name="image", coordSys=image))
    return batoid.CompoundOptic(items, name="lens", inMedium=batoid.ConstMedium(1.0), outMedium=batoid.ConstMedium(1.0))


def rays(position: np.ndarray, direction: np.ndarray) -> Any:
    """Rays of batoid, which traces them in place."""
    return batoid.RayVector(*position.T.copy(), *direction.T.copy())


def landed(traced: Any) -> tuple[np.ndarray, np.ndarray]:
    """Points on the image plane, (n, 2) [mm], and which rays passed, (n,) bool."""
    return np.stack([traced.x, traced.y], axis=1), ~(traced.vignetted | traced.failed)
