"""Raw converters and viewers see the colours that a sensor can tell: a chart, from the stage to files that others read.

Expected are integrals of colour-science, and the matrix of the sensor that is best for this very chart.
"""

from dataclasses import replace
from pathlib import Path

import colour
import numpy as np
import OpenEXR
import pytest
import rawpy
from laws import rigs
from PIL.TiffImagePlugin import ImageFileDirectory_v2
from stage_text import stage_in

from pipeline.files.exr import Part, read_exr, texts_of, write_exr
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.jsonfile import write_json
from pipeline.files.npy import write_npy
from pipeline.products.cameras import FOCUSED, light_file
from pipeline.products.colours import make as colour_image
from pipeline.products.colours.params import ColourImage
from pipeline.products.graph import graph_of
from pipeline.products.light import ChannelLabel
from pipeline.products.raw.make import expose
from pipeline.products.raw.params import Expose
from pipeline.records.plain import from_plain, to_plain
from pipeline.scene.load import load

STAGE = Path(__file__).parents[2] / "examples" / "04_stereo_colour" / "dataset.usda"
SHAPE = colour.SpectralShape(380, 730, 1)
CHART = [*colour.SDS_COLOURCHECKERS["BabelColor Average"].values(), colour.sd_ones()]
"""Patches by another spectrometer than the one of the matrix, and white."""
RESPONSES = {
    "red": ([560, 575, 590, 605, 630, 655, 680, 700], [0, 0.05, 0.3, 0.42, 0.38, 0.3, 0.2, 0]),
    "green": ([455, 480, 500, 525, 545, 570, 590, 610], [0, 0.12, 0.4, 0.55, 0.5, 0.3, 0.1, 0]),
    "blue": ([402, 420, 440, 460, 480, 500, 520], [0, 0.25, 0.4, 0.45, 0.35, 0.15, 0]),
}
"""Those of the library's Bayer sensor, which the stage has."""
EDGE = 32
"""Pixels along an edge of a patch, of which the inner half counts: what lies beside a patch mixes with it."""
D65 = colour.xy_to_XYZ(colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"])


def values(spectrum):
    return spectrum.copy().align(SHAPE).values


def chart(light):
    """What the sensor counts of each patch, over white, and X, Y and Z of it."""
    reflected = np.array([values(one) for one in CHART]) * values(colour.SDS_ILLUMINANTS[light])
    curves = np.array([np.interp(SHAPE.wavelengths, *one) for one in RESPONSES.values()]) * SHAPE.wavelengths
    observer = values(colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"])
    return reflected @ curves.T / (curves @ reflected[-1]), reflected @ observer / (reflected[-1] @ observer[:, 1])


def lab(xyz, white):
    return colour.XYZ_to_Lab(colour.chromatic_adaptation(xyz, white, D65), colour.XYZ_to_xy(D65))


def apart(one, other):
    return colour.delta_E(one, other, method="CIE 2000")


def light(folder, pixels):
    """The output of a task that renders an image, (h, w)."""
    folder.mkdir(exist_ok=True)
    write_npy(folder / light_file("image"), pixels.astype(np.float32))
    write_exr(folder / "image.exr", [Part(name="image", channels={"Y": pixels})])
    return {path.name: path for path in folder.iterdir()}


@pytest.fixture(params=["D65", "A", "FL2", "LED-B3"])
def taken(request, tmp_path):
    """Light, values of the chart, folder with its raw image, and the graph of a dataset of that light."""
    text = STAGE.read_text(encoding="utf-8").replace("../../stages", str(STAGE.parents[2] / "stages"))
    graph, *_ = graph_of(load(stage_in(tmp_path, text.replace('nant = "A"', f'nant = "{request.param}"'))).dataset)
    rgb, xyz = chart(request.param)
    pixels = np.repeat(np.repeat(rgb[None], EDGE, axis=1), EDGE, axis=0)
    names = ("red", "green", "blue")
    images = {f"image_{name}": light(tmp_path / name, pixels[..., i]) for i, name in enumerate(names)}
    params = from_plain(Expose, graph["expose/Left.Camera/0001"].params)
    write_json(tmp_path / FOCUSED, to_plain(rigs.conventional()))  # whose F-number and focal length a negative states
    expose(params, {**images, "camera": {FOCUSED: tmp_path / FOCUSED}}, tmp_path)
    return request.param, rgb, xyz, tmp_path, graph


def test_raw_converters_see_the_colours_that_the_sensor_can_tell(taken):
    _, rgb, xyz, folder, _ = taken
    with rawpy.imread(str(folder / "raw.dng")) as raw:
        seen = raw.postprocess(
            use_camera_wb=True, no_auto_bright=True, gamma=(1, 1), output_bps=16, output_color=rawpy.ColorSpace.XYZ
        )
    inner = slice(EDGE // 4, -EDGE // 4)
    seen = seen.reshape(EDGE, len(CHART), EDGE, 3)[inner, :, inner].mean(axis=(0, 2))
    best = rgb @ np.linalg.lstsq(rgb, xyz, rcond=None)[0]
    off = apart(lab(seen / seen[-1, 1], D65), lab(best, xyz[-1]))
    assert off.mean() < 3


def tags_of(path):
    """Those of a negative, and those of its directory of Exif."""
    with path.open("rb") as stream:
        tags, exif = ImageFileDirectory_v2(start := stream.read(8)), ImageFileDirectory_v2(start)
        stream.seek(tags.next)
        tags.load(stream)
        stream.seek(tags[34665])
        exif.load(stream)
    return tags, exif


def test_tags_say_white_light_and_time_as_the_specification_of_dng_wants(taken):
    """Its own way: the matrix makes white neutral, and its inverse makes X, Y and Z of what was counted."""
    light, rgb, xyz, folder, _ = taken
    tags, exif = tags_of(folder / "raw.dng")
    matrix, neutral = np.array(tags[50721], float).reshape(3, 3), np.array(tags[50728], float)
    assert exif[33434] == pytest.approx(0.01)
    assert (tags[50778], tags.get(50779)) == {"D65": (21, None), "A": (17, 21)}.get(light, (255, 21))
    np.testing.assert_allclose(neutral, np.array([0.42, 0.55, 0.45]) / 0.55, rtol=1e-6)
    np.testing.assert_allclose(matrix @ xyz[-1], neutral, atol=2e-3)
    assert apart(lab(np.linalg.solve(matrix, (rgb * neutral).T).T, xyz[-1]), lab(xyz, xyz[-1])).mean() < 2


def test_viewers_find_the_primaries_of_a_colour_image(taken):
    """By them R, G and B are as near to the chart as the sensor can tell; by those of Rec. 709 they are 3 off."""
    illuminant, rgb, xyz, folder, graph = taken
    inputs = {f"channel{i}": light(folder / str(i), pixels[None]) for i, pixels in enumerate(rgb.T)}
    colour_image.colour_image(from_plain(ColourImage, graph["colour_image/Left.Camera/0001"].params), inputs, folder)
    header = OpenEXR.File(str(folder / "image.exr")).parts[0].header
    primaries = np.array(header["chromaticities"]).reshape(4, 2)
    matrix = colour.normalised_primary_matrix(primaries[:3], primaries[3])
    assert apart(lab(rgb @ matrix.T, xyz[-1]), lab(xyz, xyz[-1])).mean() < 2
    assert illuminant in header["colours"]
    assert "chromaticities" not in read_exr(folder / "image.exr")["image"].attributes


def test_a_sensor_without_colours_is_given_none(taken):
    """Nor is one of other filters, of which nobody knows what red, green and blue would be."""
    *_, folder, graph = taken
    params = from_plain(Expose, graph["expose/Left.Camera/0001"].params)
    grey = replace(params.response, filters=("green",), quantum_efficiency=(0.5,))
    inputs = {"image": light(folder / "grey", np.ones((4, 4))), "camera": {FOCUSED: folder / FOCUSED}}
    expose(replace(params, response=grey), inputs, folder)
    tags, exif = tags_of(folder / "raw.dng")
    assert 33434 in exif
    assert not {50721, 50722, 50728, 50778, 50779} & set(tags)


RAYS = "float32, cuda sm_90, numba-cuda 0.30.4"


@pytest.mark.parametrize("rays", [{}, {"rays": RAYS}])
def test_the_picture_and_the_spectrum_name_the_device_of_their_channels(rays, tmp_path):
    inputs, channels = {}, []
    for i, (name, nm) in enumerate((("red", 640.0), ("green", 550.0), ("blue", 460.0))):
        (folder := tmp_path / name).mkdir()
        pixels = np.full((4, 5), 0.25 * (i + 1), np.float32)
        part = BandedPart(
            name="image",
            shape=pixels.shape,
            channels=("Y",),
            rows=lambda first, end, pixels=pixels: pixels[first:end],
            attributes={"content": "relative irradiance", **rays},
        )
        inputs[f"channel{i}"] = light(folder, pixels)
        write_bands(folder / "image.exr", [part])
        channels.append(ChannelLabel(name=name, wavelengths_nm=(nm,), shares=(1.0,)))
    colour_image.colour_image(ColourImage(name="image", channels=tuple(channels)), inputs, tmp_path)
    found = [texts_of(tmp_path / f"{file}.exr", part) for file, part in (("image", "image"), ("spectral", "spectral"))]
    assert [texts.get("rays") for texts in found] == [rays.get("rays")] * 2
    blue = read_exr(tmp_path / "image.exr")["image"].channels["B"]
    np.testing.assert_array_equal(blue, np.full((4, 5), 0.75, np.float32))
