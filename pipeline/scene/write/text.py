"""Writing of records as USD text, in the form that USD itself would write; used by every importer."""

import re
import textwrap
from collections.abc import Iterable
from typing import Any

from pxr import Gf, Sdf, Vt

from pipeline.optics.first_order import first_order
from pipeline.optics.printed import PrintedLens, PrintedSurface, prescription_of

_DOC_WIDTH = 112
"""Longest line of documentation [characters]: with indentation it stays within the 120 of the project."""


def lens_text(lens: PrintedLens, prim_name: str | None = None) -> str:
    """Text of a layer with a printed lens.

    Parameters
    ----------
    lens : PrintedLens
    prim_name : str, optional
        Name of the root prim; by default derived from the name of the lens.

    Raises
    ------
    PrescriptionError
        The lens cannot be represented.
    """
    prescription_of(lens)  # raises
    name = prim_name or identifier(lens.name)
    layer = new_layer(name, lens_documentation(lens), ("PlenLens", "PlenSurface"))
    prim = Sdf.PrimSpec(layer, name, Sdf.SpecifierDef, "PlenLens")
    prim.kind = "component"
    write_lens(prim, lens)
    return text_of(layer)


def write_lens(prim: Sdf.PrimSpec, lens: PrintedLens) -> None:
    """Write the attributes and surfaces of a PlenLens."""
    names = surface_names(lens)
    _author(prim, "plen:name", Sdf.ValueTypeNames.String, lens.name)
    if lens.nominal_efl_mm is not None and lens.nominal_efl_mm > 0:
        _author(prim, "plen:nominalFocalLength", Sdf.ValueTypeNames.Double, lens.nominal_efl_mm)
    _author(prim, "plen:surfaceOrder", Sdf.ValueTypeNames.TokenArray, Vt.TokenArray(names))
    _author(prim, "plen:wavelength", Sdf.ValueTypeNames.Double, lens.wavelength_nm)
    for child, surface in zip(names, lens.surfaces, strict=True):
        _write_surface(Sdf.PrimSpec(prim, child, Sdf.SpecifierDef, "PlenSurface"), surface)


def lens_documentation(lens: PrintedLens) -> str:
    """Documentation of a lens: name, provenance, nominal and computed figures."""
    figures_mm = first_order(prescription_of(lens))
    computed = (
        f"Computed at infinity with the indices below: EFL {figures_mm.efl_mm:.4f} mm, BFD {figures_mm.bfd_mm:.4f} mm,"
        f" f/{abs(figures_mm.f_number):.2f}."
    )
    figures = f"{_nominal(lens)} {computed}"
    return filled([f"{lens.name}.", *lens.provenance, figures])


def surface_names(lens: PrintedLens) -> list[str]:
    """Names of the prims of the surfaces: S1, S2 and so on, and Stop."""
    return ["Stop" if surface.is_stop else f"S{i}" for i, surface in enumerate(lens.surfaces, 1)]


def identifier(text: str) -> str:
    """A prim name derived from any text: capitalised words, other characters left out."""
    words = re.findall(r"[A-Za-z0-9]+", text)
    joined = "".join(word[:1].upper() + word[1:] for word in words)
    return joined if joined[:1].isalpha() else f"Lens{joined}"


def _nominal(lens: PrintedLens) -> str:
    known = [
        f"{name} {value:.8g} mm"
        for name, value in (("EFL", lens.nominal_efl_mm), ("BFD", lens.nominal_bfd_mm))
        if value is not None
    ]
    return f"Nominal: {', '.join(known)}." if known else "The source states neither EFL nor BFD."


def filled(paragraphs: Iterable[str]) -> str:
    """Paragraphs, wrapped for the documentation of a layer."""
    lines = [textwrap.fill(text, _DOC_WIDTH, break_long_words=False, break_on_hyphens=False) for text in paragraphs]
    return "\n\n".join(lines)


def new_layer(name: str, documentation: str, types: Iterable[str]) -> Sdf.Layer:
    """A new layer in millimetres with its default prim and fallback types for USD without our plug-in."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.defaultPrim = name
    layer.documentation = documentation
    layer.pseudoRoot.SetInfo("metersPerUnit", 0.001)
    layer.pseudoRoot.SetInfo("upAxis", "Y")
    layer.timeCodesPerSecond = 24
    fallback = Vt.TokenArray(["Scope"])
    layer.pseudoRoot.SetInfo("fallbackPrimTypes", dict.fromkeys(types, fallback))
    return layer


def text_of(layer: Sdf.Layer) -> str:
    """Text of a layer as USD itself would write it."""
    return str(layer.ExportToString().rstrip("\n") + "\n")


def _write_surface(prim: Sdf.PrimSpec, surface: PrintedSurface) -> None:
    if surface.abbe is not None:
        _author(prim, "plen:abbe", Sdf.ValueTypeNames.Double, surface.abbe)
    _write_aperture(prim, surface)
    if surface.conic:
        _author(prim, "plen:conic", Sdf.ValueTypeNames.Double, surface.conic)
    for name, first in (("plen:evenCoefficients", 2), ("plen:oddCoefficients", 3)):
        if coefficients := surface.coefficients(first):
            _author(prim, name, Sdf.ValueTypeNames.DoubleArray, Vt.DoubleArray(coefficients))
    if surface.focal_length_mm is not None:
        _author(prim, "plen:focalLength", Sdf.ValueTypeNames.Double, surface.focal_length_mm)
    if surface.glass:
        _author(prim, "plen:glass", Sdf.ValueTypeNames.String, surface.glass)
    _author(prim, "plen:index", Sdf.ValueTypeNames.Double, surface.index)
    if surface.is_stop:
        _author(prim, "plen:isStop", Sdf.ValueTypeNames.Bool, True)
    _author(prim, "plen:radius", Sdf.ValueTypeNames.Double, surface.radius_mm)
    _author(prim, "plen:semiDiameter", Sdf.ValueTypeNames.Double, surface.semi_diameter_mm)
    _author(prim, "plen:thickness", Sdf.ValueTypeNames.Double, surface.thickness_mm)


def _write_aperture(prim: Sdf.PrimSpec, surface: PrintedSurface) -> None:
    if surface.half_widths_mm is not None:
        _author(prim, "plen:apertureShape", Sdf.ValueTypeNames.Token, "rectangular")
        _author(prim, "plen:halfWidths", Sdf.ValueTypeNames.Double2, Gf.Vec2d(*surface.half_widths_mm))
        if surface.aperture_rotation_deg:
            _author(prim, "plen:apertureRotation", Sdf.ValueTypeNames.Double, surface.aperture_rotation_deg)
    elif surface.inner_semi_diameter_mm:
        _author(prim, "plen:apertureShape", Sdf.ValueTypeNames.Token, "annular")
        _author(prim, "plen:innerSemiDiameter", Sdf.ValueTypeNames.Double, surface.inner_semi_diameter_mm)
    elif surface.blades:
        _author(prim, "plen:apertureShape", Sdf.ValueTypeNames.Token, "polygonal")
        _author(prim, "plen:apertureRotation", Sdf.ValueTypeNames.Double, surface.aperture_rotation_deg)
        _author(prim, "plen:blades", Sdf.ValueTypeNames.Int, surface.blades)


def _author(prim: Sdf.PrimSpec, name: str, type_name: Sdf.ValueTypeName, value: Any) -> None:
    Sdf.AttributeSpec(prim, name, type_name, Sdf.VariabilityUniform).default = value
