"""Coatings of the surfaces of a lens and absorption in its glasses, as a stage states them, and so at a wavelength."""

from pxr import Usd

from pipeline.optics.glass.absorption import Absorption, measured, stated
from pipeline.optics.glass.errors import BadAbsorption
from pipeline.optics.transmission.coatings import CoatingData
from pipeline.optics.transmission.losses import Losses
from pipeline.scene.read.channels import channel_prims, illuminant_of, wavelengths_of
from pipeline.scene.read.media import medium_behind, ordered_surfaces
from pipeline.scene.usd.values import need, read_once, target

_COATING = {
    "wavelengths_nm": "plen:coatingWavelengths",
    "angles_deg": "plen:coatingAngles",
    "reflectance": "plen:coatingReflectance",
    "film_indices": "plen:coatingFilmIndices",
    "film_thicknesses_nm": "plen:coatingFilmThicknesses",
}
"""Attributes of PlenSurface by the fields of `CoatingData`."""


def losses_at(camera: Usd.Prim, wavelength_nm: float) -> Losses | None:
    """Losses of the lens of a camera at a wavelength; None: it is ideal.

    Raises
    ------
    PrescriptionError
        A coating is none.
    GlassError
        The absorption of a glass is not known, or not at that wavelength.
    """
    lens = target(camera, "plen:camera:lens", "PlenLens")
    return read_losses(lens, wavelength_nm) if loses_light(camera, lens) else None


def loses_light(camera: Usd.Prim, lens: Usd.Prim) -> bool:
    """Whether surfaces and glasses of the lens of a camera take light: a model camera has none."""
    is_ideal = need(camera, "plen:camera:model") != "prescription"
    return not is_ideal and bool(need(lens, "plen:transmission") == "surfaces")


def wavelengths_seen(camera: Usd.Prim) -> list[float]:
    """Wavelengths that stand for the light of a camera: its own, or those of all channels of its sensor [nm]."""
    channels = channel_prims(target(camera, "plen:camera:sensor", "PlenSensor"))
    if not channels:
        return [float(need(camera, "plen:camera:wavelength"))]
    illuminant = illuminant_of(camera)
    return [float(nm) for channel in channels for nm in wavelengths_of(channel, illuminant)[0]]


def read_losses(lens: Usd.Prim, wavelength_nm: float) -> Losses:
    """Coatings and glasses of a lens at a wavelength; raises as `losses_at`."""
    surfaces = ordered_surfaces(lens)
    return Losses(
        coatings=tuple(read_coating(one).at(wavelength_nm) for one in surfaces),
        per_mm=tuple(_share_per_mm(one, lens, wavelength_nm) for one in surfaces),
    )


@read_once
def read_coating(surface: Usd.Prim) -> CoatingData:
    """Coating of a PlenSurface; raises as `CoatingData`."""
    return CoatingData(**{field: tuple(need(surface, name)) for field, name in _COATING.items()})


@read_once
def read_absorption(surface: Usd.Prim, lens: Usd.Prim) -> Absorption | None:
    """Absorption over the wavelength behind a PlenSurface; None where its medium is the same at all.

    Raises
    ------
    GlassError
        The table is none, or no table has the glass.
    """
    wavelengths_nm = tuple(need(surface, "plen:internalTransmittanceWavelengths"))
    values = tuple(need(surface, "plen:internalTransmittanceTable"))
    if wavelengths_nm or values:
        if _is_written(surface):
            what = "an internal transmittance is stated once for all wavelengths and by wavelength"
            raise BadAbsorption(what, hint="keep one of the two")
        return stated(wavelengths_nm, values, need(surface, "plen:internalTransmittanceThickness"))
    is_printed = need(lens, "plen:transmittanceSource") == "printed"
    return None if is_printed or _is_written(surface) else measured(medium_behind(surface, lens))


def _is_written(surface: Usd.Prim) -> bool:
    return bool(surface.GetAttribute("plen:internalTransmittance").HasAuthoredValue())


def _share_per_mm(surface: Usd.Prim, lens: Usd.Prim, wavelength_nm: float) -> float:
    """Share of light that a millimetre of the medium behind a surface lets pass."""
    absorption = read_absorption(surface, lens)
    if absorption is not None:
        return absorption.share_per_mm(wavelength_nm)
    thickness_mm = need(surface, "plen:internalTransmittanceThickness")
    return float(need(surface, "plen:internalTransmittance") ** (1 / thickness_mm))
