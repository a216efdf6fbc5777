"""Raytrix calibration XML in the form that PlenopticToolbox 2.0 and TLCT read.

One element per line in this order and without comments: a MATLAB reader counts the children. Types are stated at the
axial pairs (0, 0), (0, 1), (0, -1), which readers truncate to integers.
"""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

from pipeline.exports.material import ExportCamera, Material
from pipeline.exports.micro_images import GridMesh
from pipeline.formats import Cameras, ExportError, Format, ImageAxes, Microlenses, Origin

FORMAT = Format(
    consumer="PlenopticToolbox 2.0, TLCT: calibration as RxLive writes it",
    source="proof: load_from_xml of freerafiki/PlenopticToolbox2.0 79f2761. Read: SIGS-TZ/TLCT 9ef550c",
    cameras=Cameras.PLENOPTIC,
    reads=frozenset(),
    files=("<camera>.xml",),
    origin=Origin.IMAGE_CENTRE,
    axes=ImageAxes.X_UP,
    microlenses=Microlenses.FROM_CENTRAL,
)

_PAIRS = ((0, 0), (0, 1), (0, -1))
"""Axial pair of a microlens of each type, from the central one."""
_TOTAL_COVERING = 2
"""Virtual depth of the total covering plane of a hexagonal array, whose micro-images tile there; no reader uses it."""
_BEYOND = 1e-6
"""Distance of an object beyond the focal point from which it counts as imaged, over the focal length [1]."""
_BASES = (("lens_base_x", "1.0", "0.0"), ("lens_base_y", "0.5", "0.8660254037844386"))
_PERIOD = ("sub_grid_base", "1.7320508075688772", "3.0")
"""Basis of an unrotated array, and the period of one type, in pitches: constant, so given as text."""


def write(material: Material, folder: Path) -> None:
    """Write a file per camera."""
    for camera in material.cameras:
        images, mesh = camera.array
        if mesh.layout != "hexagonal" or len(images.own_types) != len(_PAIRS):
            raise ExportError(
                f"raytrix supports only hexagonal rows of three types, and {camera.name} has {len(images.own_types)} on"
                f" {mesh.layout}",
                hint="libpleno supports others, too",
            )
        text = "\n".join([*_elements(camera, mesh), ""])
        (folder / f"{camera.name}.xml").write_text(text, encoding="utf-8")


def _elements(camera: ExportCamera, mesh: GridMesh) -> Iterator[str]:
    """Lines of the calibration; ExportError if virtual depths cannot state the depth of field."""
    depths = _virtual_depths(camera)
    if min(near for near, _ in depths) <= 0:
        raise ExportError(
            f"raytrix supports only main-lens images behind the array, and those of {camera.name} lie before it"
        )
    if not all(map(math.isfinite, [far for _, far in depths])):
        raise ExportError(
            f"raytrix states depths of field by the main-lens image, and a type of {camera.name} is sharp up to the"
            " focal point of the main lens, which has none",
            hint="a smaller plen:camera:circleOfConfusion ends the depth of field before it",
        )
    assert camera.built.micro_images is not None
    border = max(mesh.pitch_px[0] / 2 - float(camera.built.micro_images.radius_px[0]), 0)
    yield '<RayCalibData version="1.0">'
    yield from _pair("offset", "pix", mesh.middle.tolist())
    yield f'  <diameter units="pix">{mesh.pitch_px[0]}</diameter>'
    yield f'  <rotation units="rad">{mesh.angle_rad}</rotation>'
    yield f'  <lens_border units="pix">{border}</lens_border>'
    yield f'  <tcp units="virtual_depth">{_TOTAL_COVERING:.1f}</tcp>'
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
        yield from (f"  {line}" for line in _pair("offset", "lens", map(float, pair)))
        yield from (f"  {line}" for line in _pair("depth_range", "virtual_depth", (near, far), ("min", "max")))
        yield "  </lens_type>"
    yield "</RayCalibData>"


def _pair(name: str, units: str, values: Iterable[object], keys: tuple[str, str] = ("x", "y")) -> Iterator[str]:
    yield f'  <{name} units="{units}">'
    yield from (f"    <{key}>{value}</{key}>" for key, value in zip(keys, values, strict=True))
    yield f"  </{name}>"


def _virtual_depths(camera: ExportCamera) -> list[tuple[float, float]]:
    """Depth of field of each type as virtual depths; an end at the front focal point of the main lens is inf."""
    record = camera.built.record
    model = camera.thin_lens
    types = record["mla"]["types"]
    front = record["lens"]["principal_planes_mm"][0]
    ends = []
    for number in camera.array[0].own_types.tolist():
        distances = [float(end) - front for end in types[number]["depth_of_field_mm"]]
        image_distances = [_image_mm(model.focal_mm, distance) - model.main_lens_mm for distance in distances]
        depths = sorted(distance / model.sensor_mm for distance in image_distances)
        ends.append((depths[0], depths[-1]))
    return ends


def _image_mm(focal_mm: float, away_mm: float) -> float:
    """Image distance of a thin lens; inf for objects at its focal point and nearer, which have no real image."""
    is_beyond = away_mm > (1 + _BEYOND) * focal_mm
    return 1 / (1 / focal_mm - 1 / away_mm) if is_beyond else float("inf")
