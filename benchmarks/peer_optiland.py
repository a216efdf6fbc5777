"""The same race run by optiland, a design program in Python (https://github.com/optiland/optiland). Optional.

Its CPU modes are the array libraries under it: NumPy, whose conics run through Numba, and PyTorch without gradients.
No surface records its rays.
"""

import importlib.metadata
import warnings
from typing import Any

import numpy as np
from lenses import Race

from pipeline.optics.prescription import Surface

try:
    import optiland
    import optiland.backend as backend
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic
    from optiland.rays import RealRays
except ImportError:
    optiland = None  # type: ignore[assignment]

# Numba 0.68 remarks on optiland's kernels when it compiles them; results agree.
warnings.filterwarnings("ignore", message=r"\s*variable '_scalar_where")


def modes() -> list[str]:
    """What is installed of "numpy" and "torch"; empty without optiland."""
    return [mode for mode in backend.list_available_backends() if mode in ("numpy", "torch")] if optiland else []


def version(mode: str) -> str:
    """Of optiland and, in its torch mode, of PyTorch."""
    own = importlib.metadata.version("optiland")
    return f"{own}, torch {importlib.metadata.version('torch')}" if mode == "torch" else f"{own}, numpy"


def use(mode: str, threads: int) -> None:
    """Select a mode, in double precision on the CPU; NumPy's array loops run in one thread whatever is asked."""
    backend.set_backend(mode)
    if mode == "torch":
        import torch

        torch.set_num_threads(threads)
        backend.set_device("cpu")
        backend.set_precision("float64")


def optic(race: Race) -> Any:
    """The lens as optiland's, in the mode in use; every surface clips at its semi-diameter."""
    lens = Optic()
    lens.surfaces.add(index=0, thickness=np.inf)
    image = Surface(thickness_mm=0.0, semi_diameter_mm=np.inf)
    for i, surface in enumerate((*race.prescription.surfaces, image)):
        is_image = surface is image
        lens.surfaces.add(
            index=i + 1,
            radius=1 / surface.curvature_per_mm if surface.curvature_per_mm else np.inf,
            thickness=0.0 if is_image else _gap_mm(race, i),
            material=IdealMaterial(n=surface.index),
            aperture=None if is_image else 2 * surface.semi_diameter_mm,
            is_stop=surface.is_stop,
        )
    return lens.surfaces


def _gap_mm(race: Race, i: int) -> float:
    vertices = [*race.prescription.vertices_mm, race.prescription.vertices_mm[-1] + race.image_mm]
    return float(vertices[i + 1] - vertices[i])


def rays(position: np.ndarray, direction: np.ndarray) -> Any:
    """Rays of optiland, which traces them in place."""
    columns = [*position.T.copy(), *direction.T.copy(), np.ones(len(position)), np.full(len(position), 0.5876)]
    return RealRays(*(backend.array(column) for column in columns))


def trace(lens: Any, bundle: Any) -> Any:
    """Through all surfaces but the object, recording none."""
    return lens.trace(bundle, skip=1, record=False)


def landed(traced: Any) -> tuple[np.ndarray, np.ndarray]:
    """Points on the image plane, (n, 2) [mm], and which rays passed, (n,) bool."""
    x, y, intensity = (backend.to_numpy(values) for values in (traced.x, traced.y, traced.i))
    return np.stack([x, y], axis=1), np.isfinite(x) & (intensity > 0)
