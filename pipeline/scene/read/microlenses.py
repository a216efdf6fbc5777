"""Reading of PlenMicrolensArray prims, and the attributes that belong together."""

from typing import Any

from pxr import Usd

from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.optics.glass import row
from pipeline.scene.usd.values import need, read

FACES = {
    "front_radii_mm": "plen:frontRadii",
    "rear_radii_mm": "plen:rearRadii",
    "front_conics": "plen:frontConics",
    "rear_conics": "plen:rearConics",
}
"""Attributes of refractive microlenses, by the fields of `MicrolensArray`."""

_OPTIONAL = {
    "cross_pitch_mm": "plen:crossPitch",
    "width_mm": "plen:width",
    "height_mm": "plen:height",
    "columns": "plen:columns",
    "rows": "plen:rows",
    "type_period": "plen:typePeriod",
}


def read_microlenses(prim: Usd.Prim, distance_mm: float, wavelength_nm: float) -> MicrolensArray:
    """The record of a PlenMicrolensArray at a distance from the sensor, at the wavelength of a camera."""
    model, aperture = need(prim, "plen:model"), need(prim, "plen:aperture")
    parts: dict[str, Any] = {field: read(prim, name) for field, name in _OPTIONAL.items()}
    if model != "refractive":
        parts["focal_lengths_mm"] = need(prim, "plen:focalLengths")
    else:
        parts |= {field: need(prim, name) for field, name in FACES.items()}
    if model != "thin":
        parts |= {"index": microlens_index(prim, wavelength_nm), "thickness_mm": need(prim, "plen:thickness")}
    if aperture == "disc":
        parts["disc_diameter_mm"] = need(prim, "plen:discDiameter")
    (offset_x_mm, offset_y_mm), (tilt_x_deg, tilt_y_deg) = need(prim, "plen:offset"), need(prim, "plen:tilt")
    return MicrolensArray(
        layout=need(prim, "plen:layout"),
        pitch_mm=need(prim, "plen:pitch"),
        type_table=need(prim, "plen:typeTable"),
        distance_mm=distance_mm,
        rotation_deg=need(prim, "plen:rotation"),
        offset_x_mm=offset_x_mm,
        offset_y_mm=offset_y_mm,
        tilt_x_deg=tilt_x_deg,
        tilt_y_deg=tilt_y_deg,
        aperture=aperture,
        model=model,
        **parts,
    )


def microlens_index(prim: Usd.Prim, wavelength_nm: float) -> float:
    """Index of the microlenses of a PlenMicrolensArray at a wavelength: of its glass, or as printed.

    Raises
    ------
    GlassError
        The glass is unknown, or unknown at that wavelength.
    """
    glass = need(prim, "plen:glass")
    if not glass:
        return float(need(prim, "plen:index"))
    return row.medium(glass=glass, index=None, abbe=None, wavelength_nm=wavelength_nm).index(wavelength_nm)
