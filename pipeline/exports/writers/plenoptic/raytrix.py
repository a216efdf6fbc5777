"""Raytrix calibration XML as PlenopticToolbox 2.0 and TLCT read it.

One element per line in this order and without comments: a MATLAB reader counts the children. Types stand at the axial
pairs (0, 0), (0, 1), (0, -1), which readers truncate to integers.
"""

import math
from collections.abc import Iterator
from pathlib import Path

from pipeline.exports.cameras import ArrayFit, ExportCamera
from pipeline.exports.errors import ExportError
from pipeline.exports.filestorage import real
from pipeline.exports.material import Material
from pipeline.exports.thin_lens import virtual_depths

_PAIRS = ((0, 0), (0, 1), (0, -1))
"""Axial pair of a microlens of each type, from the central one."""
_TOTAL_COVERING = 2
"""Virtual depth of the total covering plane of a hexagonal array, whose micro-images tile there; no reader asks it."""
_BASES = (("lens_base_x", "1.0", "0.0"), ("lens_base_y", "0.5", "0.8660254037844386"))
_PERIOD = ("sub_grid_base", "1.7320508075688772", "3.0")
"""Basis of an array that is not turned, and the period of one type, in pitches: as texts, since constants."""


def write(material: Material, folder: Path) -> None:
    """Write a file per camera.

    Raises
    ------
    ExportError
        Microlenses are not hexagonal rows of three types, or Keplerian.
    """
    for camera in material.cameras:
        array, images = camera.array, camera.micro_images
        assert array is not None and images is not None
        if array.layout != "hexagonal" or len(images.own_types) != len(_PAIRS):
            raise ExportError(
                f"raytrix knows hexagonal rows of three types, and {camera.name} has {len(images.own_types)} on"
                f" {array.layout}",
                hint="libpleno knows others, too",
            )
        text = "\n".join([*_elements(camera, array), ""])
        (folder / f"{camera.name}.xml").write_text(text, encoding="utf-8")


def _elements(camera: ExportCamera, array: ArrayFit) -> Iterator[str]:
    depths = virtual_depths(camera)
    if min(near for near, _ in depths) <= 0:
        raise ExportError(f"raytrix knows main-lens images behind the array, and those of {camera.name} lie before it")
    if not all(map(math.isfinite, [far for _, far in depths])):
        raise ExportError(
            f"raytrix states depths of field by the main-lens image, and a type of {camera.name} is sharp up to the"
            " focal point of the main lens, which has none",
            hint="a smaller plen:camera:circleOfConfusion ends the depth of field before it",
        )
    assert camera.built.micro_images is not None
    border = max(array.pitch_px / 2 - float(camera.built.micro_images.radius_px[0]), 0)
    yield '<RayCalibData version="1.0">'
    yield from _pair("offset", "pix", (real(array.centre[0]), real(array.centre[1])))
    yield f'  <diameter units="pix">{real(array.pitch_px)}</diameter>'
    yield f'  <rotation units="rad">{real(array.turn_rad)}</rotation>'
    yield f'  <lens_border units="pix">{real(border)}</lens_border>'
    yield f'  <tcp units="virtual_depth">{real(_TOTAL_COVERING)}</tcp>'
    for name, x, y in (*_BASES, _PERIOD):
        yield from _pair(name, "lens", (x, y))
    yield from (
        '  <distortion type="radial">',
        "    <function>constant</function>",
        '    <parameter count="0">0</parameter>',
    )
    yield from (f"  {line}" for line in _pair("offset", "pix", ("0.0", "0.0")))
    yield "  </distortion>"
    for number, (pair, (near, far)) in enumerate(zip(_PAIRS, depths, strict=True)):
        yield f'  <lens_type id="{number}">'
        yield from (f"  {line}" for line in _pair("offset", "lens", (real(pair[0]), real(pair[1]))))
        yield from (
            f"  {line}" for line in _pair("depth_range", "virtual_depth", (real(near), real(far)), ("min", "max"))
        )
        yield "  </lens_type>"
    yield "</RayCalibData>"


def _pair(name: str, units: str, texts: tuple[str, str], keys: tuple[str, str] = ("x", "y")) -> Iterator[str]:
    yield f'  <{name} units="{units}">'
    yield from (f"    <{key}>{text}</{key}>" for key, text in zip(keys, texts, strict=True))
    yield f"  </{name}>"
