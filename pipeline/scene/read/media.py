"""Media behind the surfaces of a lens, and so their indices at a wavelength.

Dispersion formulas are evaluated here, while a stage is read: records carry plain numbers, and tasks know no glass.
"""

from collections.abc import Sequence
from dataclasses import replace

from pxr import Usd

from pipeline.optics.glass import row
from pipeline.optics.glass.medium import Medium
from pipeline.optics.prescription import Surface
from pipeline.scene.usd.values import need, read


def uses_catalogue(lens: Usd.Prim) -> bool:
    """Whether the indices of a lens come from its glasses instead of print."""
    return bool(need(lens, "plen:indexSource") == "catalogue")


def medium_behind(surface: Usd.Prim, lens: Usd.Prim) -> Medium:
    """The medium behind a surface, from its glass and compared with the printed index.

    Raises
    ------
    GlassError
        The glass is unknown, or contradicts the printed index.
    """
    has_index = surface.GetAttribute("plen:index").HasAuthoredValue()
    return row.medium(
        glass=need(surface, "plen:glass"),
        index=need(surface, "plen:index") if has_index else None,
        abbe=read(surface, "plen:abbe"),
        wavelength_nm=need(lens, "plen:wavelength"),
    )


def with_indices(
    lens: Usd.Prim, prims: Sequence[Usd.Prim], surfaces: Sequence[Surface], wavelength_nm: float | None
) -> tuple[Surface, ...]:
    """Surfaces with their indices at a wavelength; printed indices are valid at their own wavelength only and are
    not changed.
    """
    if not uses_catalogue(lens):
        return tuple(surfaces)
    light_nm = need(lens, "plen:wavelength") if wavelength_nm is None else wavelength_nm
    return tuple(
        replace(surface, index=medium_behind(prim, lens).index(light_nm) + 0.0)
        for prim, surface in zip(prims, surfaces, strict=True)
    )


def index_source(lens: Usd.Prim, prims: Sequence[Usd.Prim]) -> str:
    """Source of the indices of a lens for reports and tables, with the medium of every element."""
    if not uses_catalogue(lens):
        return str(need(lens, "plen:indexSource"))
    labels = [medium_behind(prim, lens).label for prim in prims]
    return f"catalogue ({', '.join(label for label in labels if label != 'air')})"
