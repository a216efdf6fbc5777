"""Tasks `micro_images` and `micro_images_tile`: centre, centroid, radius and outline of every micro-image."""

import dataclasses
from pathlib import Path

import numpy as np

from pipeline.camera.micro_images.light import OUTLINE_DEG, MicroLight, micro_light
from pipeline.camera.tracer import Tracer
from pipeline.files.npy import write_npy
from pipeline.files.tables import write_table
from pipeline.products.cameras import Inputs, rig_of, stacked
from pipeline.products.micro_images.params import MicroImagesTile, MicroImageTables

_PIXELS = "positions in px: (0, 0) is the centre of the top-left pixel, x right, y down"
_ALONE = (
    "light of a microlens: all that passes its own aperture onto the sensor plane, in whatever cell it falls, and also"
    " beyond the image"
)
HEADER = (
    "micro-images: one row per microlens, k and l are axial indices of the lattice",
    f"{_PIXELS}; vertices in the sensor frame, mm, from the sensor's centre",
    "centre: sensor hit of the real ray through the centre of the aperture stop and the microlens vertex",
    _ALONE,
    "centroid: mean position of that light, weighted by its irradiance and the acceptance of the pixels",
    "radius: paraxial exit-pupil radius * B / P, the contour of half illumination",
    "area_radius: of the disc with the area that light through the vertex fills, the real and vignetted exit pupil",
    "complete: all of the light lies in the image (its outline, see micro_image_outlines)",
    "empty: centroid and area_radius where no light of the microlens reaches the image",
)
OUTLINES_HEADER = (
    "outlines of micro-images: one row per microlens whose light reaches the image",
    f"{_PIXELS}; radii in px, from the centroid of micro_images along directions in degrees from +x towards +y",
    _ALONE,
    "pupil_<direction>_px: where light through the vertex ends, the exit pupil's image; about half illumination",
    "light_<direction>_px: where all light ends; from the farther one on no ray passes any point of the aperture",
    "empty: the vertex throws no light onto the centroid",
)
_DECIMALS = 6
"""Decimals of the radii of outlines [px]: two more than the accuracy of their bisection."""


def micro_images(params: MicroImageTables, inputs: Inputs, out: Path) -> None:
    """Both tables of the micro-images of a camera."""
    rig = rig_of(inputs, 0)
    tracer = rig.tracer
    images = rig.images
    grid = tracer.lattice
    array = tracer.camera.microlenses
    assert images is not None and grid is not None and array is not None
    names = [field.name for field in dataclasses.fields(MicroLight)]
    parts = [stacked(inputs, params.tiles, f"{name}.npy") for name in names if params.tiles]
    light = MicroLight(*parts) if parts else micro_light(tracer, images)
    pitch = tracer.camera.sensor.pitch_mm
    centre = tracer.pixels_at(images.centre_mm)
    centroid = np.full((len(grid.k), 2), np.nan)
    area_radius = np.full(len(grid.k), np.nan)
    complete = np.zeros(len(grid.k), np.int64)
    centroid[light.rows] = tracer.pixels_at(light.centroid_mm)
    area_radius[light.rows] = np.sqrt(light.pupil_area_mm2 / np.pi) / pitch
    complete[light.rows] = _is_inside(tracer, light)
    columns = {
        "microlens_k": grid.k,
        "microlens_l": grid.l,
        "microlens_type": grid.type,
        "vertex_x_mm": grid.x_mm,
        "vertex_y_mm": grid.y_mm,
        "centre_x_px": centre[:, 0],
        "centre_y_px": centre[:, 1],
        "centroid_x_px": centroid[:, 0],
        "centroid_y_px": centroid[:, 1],
        "radius_px": np.full(len(grid.k), images.radius_mm / pitch),
        "area_radius_px": area_radius,
        "focal_length_mm": np.array(array.focal_lengths_mm)[grid.type],
        "complete": complete,
    }
    write_table(out / "micro_images.csv", HEADER, columns)
    outlines = {name: values[light.rows] for name, values in columns.items() if name.startswith(("micro", "centroid"))}
    for name, radii_mm in (("pupil", light.pupil_mm), ("light", light.light_mm)):
        # Bisected to about 1e-4 px: more digits would be meaningless.
        radii = np.round(radii_mm / pitch, _DECIMALS)
        outlines |= {f"{name}_{angle}_px": radii[:, i] for i, angle in enumerate(OUTLINE_DEG)}
    write_table(out / "micro_image_outlines.csv", OUTLINES_HEADER, outlines)


def _is_inside(tracer: Tracer, light: MicroLight) -> np.ndarray:
    """Whether the whole outline of each micro-image lies in the image, (n,)."""
    sensor = tracer.camera.sensor
    angle = np.deg2rad(OUTLINE_DEG)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline = tracer.pixels_at(light.centroid_mm)[:, None] + light.light_mm[..., None] / sensor.pitch_mm * along
    size = np.array([sensor.width_px, sensor.height_px])
    return ((outline >= -0.5) & (outline <= size - 0.5)).all(axis=(1, 2))


def micro_images_tile(params: MicroImagesTile, inputs: Inputs, out: Path) -> None:
    """The light of some of the microlenses: the fields of `MicroLight`, a file each."""
    rig = rig_of(inputs, 0)
    assert rig.images is not None
    light = micro_light(rig.tracer, rig.images, params.tile, params.tiles)
    for field in dataclasses.fields(light):
        write_npy(out / f"{field.name}.npy", getattr(light, field.name))
