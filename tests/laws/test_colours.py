"""Claim: channels see colours as integrals of light, colour and response, however steep they are over the wavelength.

Expected values are sums over tables of colour-science and of the stage, every fiftieth of a nanometre, by numpy alone.
`python -m pytest -rP tests/laws/test_colours.py` prints the errors.
"""

import re
from collections.abc import Callable
from pathlib import Path

import colour
import numpy as np
import OpenEXR
import pytest
from stage_text import head, mesh_text, placed
from tolerances import COLOUR_RMS, COLOUR_WORST, MEAN_NM, TWICE_RMS, TWICE_WORST

import pipeline
from pipeline.camera.parts.spectrum import Slice
from pipeline.render.spectral.nodes import gauss_nodes, points_of, slices_of
from pipeline.render.spectral.prints import Spectrum
from pipeline.render.spectral.spectra import illuminant, sensitivity, weights_of_rgb

LIGHTS = ("D65", "A", "FL2", "LED-B3")
FINE_NM = np.arange(360.0, 830.0, 0.02)
PATCHES = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]
PRIMARIES = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (1, 0, 1))
SENSOR = Path(__file__).parents[2] / "stages/sensors/bayer_640x480_10um.usda"
BAYER = {
    name: (np.fromstring(nm, sep=","), np.fromstring(values, sep=","))
    for name, values, nm in re.findall(
        r'PlenChannel "(\w+)".*?response = \[(.*?)\].*?wavelengths = \[(.*?)\]', SENSOR.read_text("utf-8"), re.DOTALL
    )
}
"""Responses of the sensor of the library, from the text of its stage."""
NAMED = {f"{camera[:5]}_{name}": (camera, name) for camera in colour.MSDS_CAMERA_SENSITIVITIES for name in BAYER}
"""Cameras of colour-science, and their components."""


def counted(channel: str, light: str) -> np.ndarray:
    lamp = colour.SDS_ILLUMINANTS[light]
    energy = np.interp(FINE_NM, lamp.wavelengths, lamp.values, left=0, right=0)
    if channel in BAYER:
        return energy * FINE_NM * np.interp(FINE_NM, *BAYER[channel], left=0, right=0)
    table = colour.MSDS_CAMERA_SENSITIVITIES[NAMED[channel][0]]
    response = np.maximum(table.values[:, list(BAYER).index(NAMED[channel][1])], 0)
    return energy * np.interp(FINE_NM, table.wavelengths, response, left=0, right=0)


def patch(name: str) -> np.ndarray:
    return np.interp(FINE_NM, PATCHES[name].wavelengths, PATCHES[name].values)


def srgb(rgb: tuple[float, ...]) -> np.ndarray:
    """Spectrum of a colour of linear sRGB, by Mallett and Yuksel."""
    basis = colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019
    curves = np.array([np.interp(FINE_NM, basis.wavelengths, curve) for curve in np.asarray(basis.values).T])
    return np.asarray(np.array(rgb) @ curves / curves.sum(axis=0))


def seen(channel: str, light: str, spectra: list[np.ndarray]) -> np.ndarray:
    weight = counted(channel, light)
    return np.array([weight @ one for one in spectra]) / weight.sum()


def judge(found: np.ndarray, expected: np.ndarray, most: float = COLOUR_RMS, at_worst: float = COLOUR_WORST) -> None:
    error = found / expected - 1
    rms, worst = np.sqrt(np.mean(error**2)), np.abs(error).max()
    print(f"{100 * rms:.3f} % rms, {100 * worst:.2f} % worst of {error.size} colours")
    assert rms <= most
    assert worst <= at_worst


def in_slices(channel: str, light: str, colours: Callable[[Slice], np.ndarray]) -> np.ndarray:
    """What the slices of a channel see of colours; its mean wavelength is that of its electrons."""
    response = BAYER[channel] if channel in BAYER else sensitivity(*NAMED[channel])
    points = points_of(response, illuminant(light), counts_photons=channel in BAYER)
    wavelengths_nm, shares = gauss_nodes(points, 5)
    weight = counted(channel, light)
    assert shares @ wavelengths_nm == pytest.approx(weight @ FINE_NM / weight.sum(), abs=MEAN_NM)
    return np.asarray(shares @ [np.mean(list(map(colours, slices)), axis=0) for slices in slices_of(points, shares)])


@pytest.mark.parametrize("light", LIGHTS)
def test_slices_see_patches_and_primaries_as_integrals_do(light: str) -> None:
    prints = [Spectrum(wavelengths_nm=tuple(p.wavelengths), reflectance=tuple(p.values)) for p in PATCHES.values()]

    def colours(part: Slice) -> np.ndarray:
        return np.array([*(one.mean(part) for one in prints), *(np.array(PRIMARIES) @ weights_of_rgb(part))])

    expected = [seen(one, light, [*map(patch, PATCHES), *map(srgb, PRIMARIES)]) for one in (*BAYER, *NAMED)]
    judge(np.array([in_slices(one, light, colours) for one in (*BAYER, *NAMED)]), np.array(expected))


@pytest.mark.parametrize("light", LIGHTS)
def test_slices_are_so_thin_that_light_reflected_twice_has_its_colour(light: str) -> None:
    """Surfaces in light of coloured lamps, and of other surfaces: within a slice a mean of products is one of means."""
    pairs = [(one, other) for one in ((1, 0.3, 0.1), (0.1, 0.4, 1), (0.2, 1, 0.2)) for other in (*PRIMARIES, one)]

    def colours(part: Slice) -> np.ndarray:
        return np.array([np.prod(np.array(pair) @ weights_of_rgb(part)) for pair in pairs])

    expected = [seen(one, light, [srgb(a) * srgb(b) for a, b in pairs]) for one in (*BAYER, *NAMED)]
    found = np.array([in_slices(one, light, colours) for one in (*BAYER, *NAMED)])
    judge(found, np.array(expected), TWICE_RMS, TWICE_WORST)


STAGE = """
def PlenDataset "D" (kind = "assembly")
{
    rel plen:cameras = </D/Rig/Camera>
    uniform string plen:illuminant = "%s"
    rel plen:targets = [%s]
    def "Rig" (prepend references = @rigs/conventional_100mm.usda@)
    {
        over "Camera"
        {
            uniform int plen:image:bounces = 0
            uniform token plen:camera:model = "%s"
            uniform int plen:image:samples = %d
        }
        over "Lens"
        {
            uniform token plen:indexSource = "catalogue"
        }
        over "Sensor"
        {
            uniform double plen:pixelPitch = 0.2
            uniform int2 plen:resolution = (64, 48)
            %s
        }
    }
%s
}
"""


def pixels(
    folder: Path, light: str, channels: tuple[str, ...], things: list[str], places: list[tuple[float, float]], lit: int
) -> np.ndarray:
    """What a build sees at some places at the distance in focus, over the white image, (channels, n).

    `lit`: in so many pixels to each side, with few samples, by a lens whose opening is the same at all wavelengths.
    """
    said = []
    for one in channels:
        camera, component = NAMED.get(one, ("", "red"))
        nm, response = (np.asarray(values).tolist() for values in BAYER.get(one, ((), ())))
        values = (f'string plen:sensitivity = "{camera}"', f'token plen:component = "{component}"')
        tables = f"double[] plen:wavelengths = {nm}", f"double[] plen:response = {response}"
        lines = "\n".join(f"uniform {value}" for value in (values if camera else tables))
        said.append(f'def PlenChannel "{one}"\n{{\n{lines}\n}}')
    path = folder / "dataset.usda"
    boards = ", ".join(f"</D/{name}>" for name in re.findall(r'PlenCheckerboard "(\w+)"', "".join(things)))
    # Some glasses of the lens are not known at all wavelengths of those cameras.
    model, samples = "thinLens" if lit or set(channels) & set(NAMED) else "prescription", 64
    path.write_text(head("D") + STAGE % (light, boards, model, samples, "\n".join(said), "".join(things)), "utf-8")
    out = pipeline.build(path, folder / "out", jobs=1, targets=("frames/*/image.exr", "cameras/*/white.exr")).out
    x, y = np.array(places).T
    found = pipeline.ready(path, f"Rig.Camera@{channels[0]}").project(np.stack([x, -y, np.full(len(x), 434.4)], axis=1))
    row, column = np.rint([found.y_px, found.x_px]).astype(int)
    image, white = (
        np.stack([OpenEXR.File(str(out / one / channel / name)).channels()["Y"].pixels for channel in channels])
        for one, name in (("frames/0001/Rig.Camera", "image.exr"), ("cameras/Rig.Camera", "white.exr"))
    )
    near = np.arange(-lit, lit + 1)
    block = row[:, None, None] + near[:, None], column[:, None, None] + near
    return np.asarray((image[:, *block] / white[:, *block]).mean(axis=(2, 3)))


def board(name: str, x_mm: float, y_mm: float, more: str = "") -> str:
    return f"""
    def PlenCheckerboard "{name}"
    {{
        uniform int plen:columns = 2
        uniform int plen:rows = 1
        uniform double plen:squareSize = 2
        {more}
        {placed(x_mm, y_mm, -434.4)}
    }}"""


@pytest.mark.heavy
@pytest.mark.parametrize("light", LIGHTS)
def test_pixels_of_all_sensors_have_the_colours_of_the_colorchecker(tmp_path: Path, light: str) -> None:
    """All patches of the ColorChecker as ink and paper of twelve boards that glow."""
    boards, places, names, channels = list[str](), [], list(PATCHES), (*BAYER, *NAMED)
    for k, (ink, paper) in enumerate(zip(names[::2], names[1::2], strict=True)):
        x, y = 10.0 * (k % 4) - 15, 10.0 * (k // 4) - 10
        inks = f'uniform string plen:ink:patch = "{ink}"\nuniform string plen:paper:patch = "{paper}"'
        boards.append(board(f"B{k}", x, y, inks))
        places += [(x, y - 1), (x, y + 1)]  # the middle column of squares: black below, white above
    expected = [seen(one, light, [patch(name) for name in names]) for one in channels]
    judge(pixels(tmp_path, light, channels, boards, places, 0), np.array(expected))


@pytest.mark.parametrize(
    ("light", "channels"),
    [("D65", tuple(BAYER)), *(pytest.param(light, (*BAYER, *NAMED), marks=pytest.mark.heavy) for light in LIGHTS)],
)
def test_lit_pixels_have_the_colours_of_surfaces(tmp_path: Path, light: str, channels: tuple[str, ...]) -> None:
    """Matt plates in the primaries and secondaries of sRGB, below an even white sky."""
    things, places = [board("Board", 17.0, 0.0), '\ndef DomeLight "Sky"\n{\n}'], []
    for k, rgb in enumerate(PRIMARIES):
        x, y = 10.0 * (k % 3) - 15, 12.0 * (k // 3) - 6
        corners = [(x + a, y + b, -434.4) for a, b in ((-4.5, -5), (4.5, -5), (4.5, 5), (-4.5, 5))]
        things.append(mesh_text(f"P{k}", corners, f"color3f[] primvars:displayColor = [{rgb}]"))
        places.append((x, y))
    expected = [seen(one, light, list(map(srgb, PRIMARIES))) for one in channels]
    judge(pixels(tmp_path, light, channels, things, places, 5), np.array(expected))
