"""Reader of PlenGlassAPI: a Material with it refracts light."""

import contextlib
from collections.abc import Iterator

import numpy as np
from pxr import Usd, UsdShade

from pipeline.optics.glass import row
from pipeline.optics.glass.medium import Constant, GlassError, Medium
from pipeline.plugins.scenes.lighting.records import Glass
from pipeline.scene.channels import readable_wavelengths_nm
from pipeline.scene.usd.problems import Problem, warning
from pipeline.scene.usd.values import UnreadableValue, need, targets

_RANGE_NM = 200.0, 20000.0
"""Wavelengths at which indices are tabled where a formula holds everywhere: all that a camera may have."""
_MOST_INDEX = 10.0
"""Largest index [1]: germanium has 4."""
_ENTRIES = 300
"""Entries of a table of indices [1]: between two of them N-BK7 is linear to 2e-6."""


def read_glass(material: UsdShade.Material, surface: UsdShade.Shader, ior: float) -> tuple[Glass | None, list[Problem]]:
    """The glass of a Material with PlenGlassAPI, None without it, and doubts about it; UnreadableValue for glass of
    unknown or impossible index at a wavelength of a camera.

    `ior`: index of its UsdPreviewSurface, which counts where no glass is named.
    """
    prim = material.GetPrim()
    if not prim.HasAPI("PlenGlassAPI"):
        return None, []
    name = need(prim, "plen:glass")
    source = prim.GetAttribute("plen:glass") if name else surface.GetInput("ior").GetAttr() or surface.GetPrim()
    lights_nm = list(_camera_nm(prim.GetStage())) or [_RANGE_NM[0]]
    try:
        medium = Medium(label="glass", dispersion=Constant(n=ior))
        if name:
            medium = row.medium(glass=name, index=None, abbe=None, wavelength_nm=lights_nm[0])
        doubts = [row.doubt_of(medium, nm) for nm in lights_nm]
        unphysical = next((index for index in map(medium.index, lights_nm) if not 1 <= index <= _MOST_INDEX), None)
    except GlassError as error:
        raise UnreadableValue(error.message, source, error.hint, error.code) from None
    if unphysical is not None:
        hint = "glass, acrylic and water have indices from 1.3 to 2"
        raise UnreadableValue(f"the index of this glass is {unphysical:g}, not 1 to {_MOST_INDEX:g}", source, hint)
    nm, indices = _tabled(medium)
    glass = Glass(
        wavelengths_nm=nm,
        indices=indices,
        transmittance=need(prim, "plen:internalTransmittanceColor"),
        thickness_mm=need(prim, "plen:internalTransmittanceThickness"),
    )
    doubt = next(filter(None, doubts), None)
    flaws = [warning(source, "glass-resonance", doubt.message, hint=doubt.hint)] if doubt else []
    return glass, flaws


def _camera_nm(stage: Usd.Stage) -> Iterator[float]:
    """Wavelengths of all cameras of a dataset."""
    root = stage.GetDefaultPrim()
    for camera in targets(root, "plen:cameras", "Camera") if root and root.IsA("PlenDataset") else ():
        with contextlib.suppress(UnreadableValue):  # reported where the camera is checked
            yield from readable_wavelengths_nm(camera)


def _tabled(medium: Medium) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Wavelengths [nm] and indices of a medium, over the range of its formula."""
    if isinstance(medium.dispersion, Constant):
        return (_RANGE_NM[0],), (medium.dispersion.n,)
    table = list[tuple[float, float]]()
    for nm in np.geomspace(max(medium.min_nm, _RANGE_NM[0]), min(medium.max_nm, _RANGE_NM[1]), _ENTRIES).tolist():
        nm = min(max(nm, medium.min_nm), medium.max_nm)
        with contextlib.suppress(GlassError):  # no camera sees such light
            table.append((nm, medium.index(nm)))
    return tuple(nm for nm, _ in table), tuple(index for _, index in table)
