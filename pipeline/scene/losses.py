"""Readers and checks of losses by wavelength: coatings and absorption of a lens and its windows."""

from collections.abc import Iterator, Sequence

import numpy as np
from pxr import Usd

from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer
from pipeline.optics.glass.absorption import BAD_ABSORPTION, Absorption, measured, stated
from pipeline.optics.glass.medium import GlassError
from pipeline.optics.prescription import PrescriptionError
from pipeline.optics.rays import GRID, front_grid
from pipeline.optics.table import towards_scene
from pipeline.optics.transmission import CoatingData, Losses, steepest_deg
from pipeline.render.spectral.nodes import SpectrumError
from pipeline.scene.channels import channel_prims, illuminant_of, wavelengths_of
from pipeline.scene.lens import medium_behind
from pipeline.scene.usd.problems import Problem, problem, warning
from pipeline.scene.usd.readers import read_once
from pipeline.scene.usd.values import UnreadableValue, fields_of, need, read, target
from pipeline.scene.windows import surfaces_before_sensor

_BLAMED = {
    "coating": "plen:coatingReflectance",
    "coating-wavelengths": "plen:coatingWavelengths",
    "coating-angles": "plen:coatingAngles",
    "coating-films": "plen:coatingFilmIndices",
    BAD_ABSORPTION: "plen:internalTransmittanceTable",
    "glass-wavelengths": "plen:internalTransmittanceWavelengths",
}
"""The attribute to mend, by the code of an error; errors of other codes concern the glass."""
_SLACK_DEG = 0.005
"""Angle beyond the end of a table of which nobody is warned: half a unit of the last digit that the message prints."""


def losses_at(camera: Usd.Prim, wavelength_nm: float) -> Losses | None:
    """Losses of the lens of a camera at a wavelength; None for an ideal lens. PrescriptionError for impossible
    coatings, GlassError where the absorption of a glass is unknown at that wavelength.
    """
    lens = target(camera, "plen:camera:lens", "PlenLens")
    return read_losses(camera, wavelength_nm) if _loses_light(camera, lens) else None


def _loses_light(camera: Usd.Prim, lens: Usd.Prim) -> bool:
    """Whether surfaces and glasses of the lens of a camera lose light: a model camera has none."""
    is_real = need(camera, "plen:camera:model") == "prescription"
    return is_real and bool(need(lens, "plen:transmission") == "surfaces")


def light_wavelengths_nm(camera: Usd.Prim) -> list[float]:
    """Wavelengths that stand for the light of a camera: its own, or those of all channels of its sensor [nm]."""
    channels = channel_prims(target(camera, "plen:camera:sensor", "PlenSensor"))
    if not channels:
        return [float(need(camera, "plen:camera:wavelength"))]
    illuminant = illuminant_of(camera)
    return [float(nm) for channel in channels for nm in wavelengths_of(channel, illuminant)[0]]


def read_losses(camera: Usd.Prim, wavelength_nm: float) -> Losses:
    """Coatings and glasses of the windows and the lens of a camera at a wavelength; raises as `losses_at`."""
    surfaces = surfaces_before_sensor(camera)
    return Losses(
        coatings=tuple(_read_coating(surface).at(wavelength_nm) for surface, _ in surfaces),
        per_mm=tuple(_share_per_mm(surface, part, wavelength_nm) for surface, part in surfaces),
    )


@read_once
def _read_coating(surface: Usd.Prim) -> CoatingData:
    """Coating of a PlenSurface; raises as `CoatingData`."""
    return CoatingData(**fields_of(surface, CoatingData))


@read_once
def _read_absorption(surface: Usd.Prim, lens: Usd.Prim) -> Absorption | None:
    """Absorption behind a PlenSurface; None if it is the same at all wavelengths, GlassError without a usable table."""
    wavelengths_nm = need(surface, "plen:internalTransmittanceWavelengths")
    values = need(surface, "plen:internalTransmittanceTable")
    is_written = surface.GetAttribute("plen:internalTransmittance").HasAuthoredValue()
    if wavelengths_nm or values:
        if is_written:
            message = "an internal transmittance is stated once for all wavelengths and by wavelength"
            raise GlassError(message, hint="keep one of the two", code=BAD_ABSORPTION)
        return stated(wavelengths_nm, values, need(surface, "plen:internalTransmittanceThickness"))
    is_printed = need(lens, "plen:transmittanceSource") == "printed"
    return None if is_printed or is_written else measured(medium_behind(surface, lens))


def _share_per_mm(surface: Usd.Prim, lens: Usd.Prim, wavelength_nm: float) -> float:
    """Share of light that a millimetre of the medium behind a surface lets pass."""
    absorption = _read_absorption(surface, lens)
    if absorption is not None:
        return absorption.share_per_mm(wavelength_nm)
    thickness_mm = need(surface, "plen:internalTransmittanceThickness")
    return float(need(surface, "plen:internalTransmittance") ** (1 / thickness_mm))


def check_losses(camera: Usd.Prim) -> Iterator[Problem]:
    """Problems of coatings and absorption of the lens of a Camera, at the wavelengths of its light."""
    lens = target(camera, "plen:camera:lens", "PlenLens")
    if not lens:
        return
    try:
        counts = read(camera, "plen:image:exposure") == "radiance" and _loses_light(camera, lens)
        lights_nm = light_wavelengths_nm(camera) if counts else []
    except (SpectrumError, UnreadableValue):
        return  # reported where the channel or the value is checked
    for surface, part in surfaces_before_sensor(camera):
        try:
            coating = _read_coating(surface)
            absorption = _read_absorption(surface, part) if lights_nm else None
            if absorption is not None:
                for nm in (min(lights_nm), max(lights_nm)):
                    absorption.share_per_mm(nm)
        except UnreadableValue:
            continue  # reported where the value is checked
        except (PrescriptionError, GlassError) as error:
            attribute = surface.GetAttribute(_BLAMED.get(error.code, "plen:glass"))
            table = surface.GetAttribute("plen:internalTransmittanceWavelengths")
            if error.code == "wavelength-out-of-range" and table.HasAuthoredValue():
                attribute = table
            at = attribute if attribute.HasAuthoredValue() else surface
            yield problem(at, error.code, error.message, hint=error.hint)
        else:
            yield from _check_covered(surface, coating, lights_nm)


def check_angles(camera: Usd.Prim, parts: Camera) -> Iterator[Problem]:
    """Warnings of coatings that the light on the axis of a focused camera meets at angles beyond their tables."""
    lens = target(camera, "plen:camera:lens", "PlenLens")
    if read(camera, "plen:image:exposure") != "radiance" or not lens or not _loses_light(camera, lens):
        return
    surfaces = [surface for surface, _ in surfaces_before_sensor(camera)]
    tables = [_read_coating(surface).angles_deg for surface in surfaces]
    if not any(tables):
        return
    # Trace the cone of the film's centre over the rear surface.
    table = towards_scene(parts.prescription)
    film_mm = np.array([0.0, 0.0, Tracer(parts).film_z_mm])
    direction = front_grid(table, GRID) - film_mm
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    steepest = steepest_deg(table, np.tile(film_mm, (len(direction), 1)), direction)[::-1]
    for surface, angles_deg, largest_deg in zip(surfaces, tables, steepest, strict=True):
        if angles_deg and largest_deg > angles_deg[-1] + _SLACK_DEG:
            message = f"the table of the coating ends at {angles_deg[-1]:g} degrees, and light of the axis comes at"
            yield _short_table(surface, "plen:coatingAngles", f"{message} up to {largest_deg:.2f}")


def _check_covered(surface: Usd.Prim, coating: CoatingData, lights_nm: Sequence[float]) -> Iterator[Problem]:
    """Warnings of a coating whose table does not reach the wavelengths of its camera or the axis."""
    table_nm = coating.wavelengths_nm
    outside = [nm for nm in lights_nm if not table_nm[0] <= nm <= table_nm[-1]] if table_nm else []
    if outside:
        message = f"the table of the coating covers {table_nm[0]:.7g} to {table_nm[-1]:.7g} nm, and the camera sees"
        yield _short_table(
            surface, "plen:coatingWavelengths", f"{message} {', '.join(f'{nm:.5g}' for nm in outside)} nm"
        )
    if lights_nm and coating.angles_deg and coating.angles_deg[0] > 0:
        message = f"the table of the coating starts at {coating.angles_deg[0]:g} degrees"
        yield _short_table(surface, "plen:coatingAngles", f"{message}, and light of the axis comes at 0")


def _short_table(surface: Usd.Prim, name: str, message: str) -> Problem:
    """The warning of a table of a coating that ends too early."""
    hint = "the last value counts beyond the end: add entries if that is wrong"
    return warning(surface.GetAttribute(name), "coating-range", message, hint=hint)
