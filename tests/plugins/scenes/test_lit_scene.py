"""Lit scenes as a whole: the same bytes for any rows, textures by a slow twin, holes, and pictures of the sky."""

import math

import numpy as np
import pytest
from laws import rigs
from laws.rigs import conventional
from laws.test_channels import BOARD, PRINT
from plugins.scenes.lit import lamp, looked, matt, plate, scene, towards
from tolerances import LIT_ERRORS

from pipeline.camera.parts.spectrum import alone
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.plugins.scenes.lighting.lit_scene import LitView
from pipeline.plugins.scenes.lighting.materials import WRAPS, MaterialTable, Spot, input_at
from pipeline.plugins.scenes.lighting.records import Coat, Input, Lighting, Material, Texture
from pipeline.render.imaging import pictures_in_lights, white_parts
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target


def test_rows_of_an_image_are_those_of_the_whole_image():
    """Random numbers depend on the ray alone, so tiles have the same bytes."""
    rig = Rig.of(Tracer(conventional(), 7))
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 450.0
    board = Target(Checkerboard(columns=4, rows=3, square_mm=15.0, white=0.9, black=0.1))
    view = LitView(
        targets=[(board, pose)],
        occluders=[],
        lighting=Lighting(
            lamps=(lamp("sphere", (30.0, 0.0), towards((0, 0, -1), (80, 90, 300))), lamp("dome")),
            coats=(Coat(roughness=0.2),),
        ),
        pictures={},
        background=0.1,
        lights=(alone(550.0),),
    )
    white = white_parts(rig, 16)
    whole = pictures_in_lights(rig, 16, [view], white)[0]
    assert whole.std() > 0.01
    height = len(whole)
    for first, end in ((0, 5), (5, 6), (height - 7, height)):
        part = pictures_in_lights(rig, 16, [view], np.ascontiguousarray(white[:, first:end]), (first, end))[0]
        assert part.tobytes() == whole[first:end].tobytes()


def slow_texel(picture: np.ndarray, s: float, t: float, wraps: tuple[str, str]) -> float:
    """Linear interpolation between four texels; s to the right, t up from the bottom."""
    height, width = picture.shape

    def index(i: int, count: int, wrap: str) -> int | None:
        if wrap == "repeat":
            return i % count
        if wrap == "mirror":
            return [*range(count), *reversed(range(count))][i % (2 * count)]
        if wrap == "clamp":
            return min(max(i, 0), count - 1)
        return i if 0 <= i < count else None

    x, y, total = s * width - 0.5, (1 - t) * height - 0.5, 0.0
    for i in (math.floor(x), math.floor(x) + 1):
        for j in (math.floor(y), math.floor(y) + 1):
            column, line = index(i, width, wraps[0]), index(j, height, wraps[1])
            if column is not None and line is not None:
                total += (1 - abs(x - i)) * (1 - abs(y - j)) * picture[line, column]
    return total


@pytest.mark.parametrize("wraps", [("repeat", "mirror"), ("clamp", "black"), ("mirror", "clamp"), ("black", "repeat")])
def test_textures_are_those_of_a_slow_twin(wraps):
    generator = np.random.default_rng(3)
    picture = generator.random((4, 5))
    texels = np.repeat(picture[..., None], 4, axis=2).astype(np.float32)
    texture = Texture(name="it", channel="g", scale=(1, 0.5, 1, 1), bias=(0, 0.25, 0, 0), wrap=wraps)
    table = MaterialTable({"it": texels})
    table.add(Material(roughness=Input(value=(0.5,), texture=texture)))
    for s, t in generator.uniform(-2.5, 3.5, (40, 2)):
        spot = Spot(np.tile([s, t], (1, 3, 1)), 0, (0.2, 0.3, 0.5))
        found = input_at(table.arrays(np.full(3, 1 / 3), alone(550.0)[0]), 0, 2, spot)
        assert found == pytest.approx(0.25 + 0.5 * slow_texel(picture, s, t, wraps), abs=1e-6), (s, t)
    assert set(wraps) <= set(WRAPS)


def holed(opacity: float) -> Material:
    return Material(
        diffuse_color=Input(value=(1.0,) * 3), ior=1.0, opacity=Input(value=(opacity,)), opacity_threshold=0.5
    )


def test_holes_let_light_and_sight_pass():
    sun = lamp("distant", (0.0, 0.0), towards((0.6, 0.0, -1.0)))
    lights = [
        looked(scene([(plate(500.0), matt(0.5)), *veils], [sun]), (0.0, 0.0, 500.0), rays=8)[0]
        for veils in ([], [(plate(400.0), holed(0.4)), (plate(300.0), holed(0.2))], [(plate(400.0), holed(0.6))])
    ]
    bare, holes, solid = lights
    assert bare == pytest.approx(0.5 / math.pi / math.hypot(0.6, 1.0))
    assert holes == bare
    assert solid == pytest.approx(2 * bare)  # the veil itself is visible


def sky(place: tuple[int, int]) -> dict[str, np.ndarray]:
    picture = np.zeros((8, 16, 4), np.float32)
    picture[place] = 1.0
    return {"sky": picture}


@pytest.mark.parametrize(
    ("place", "direction"), [((0, 7), (0, 1, 0)), ((7, 8), (0, -1, 0)), ((4, 8), (0, 0, 1)), ((4, 4), (1, 0, 0))]
)
def test_a_picture_of_the_sky_lies_as_usdlux_says(place, direction):
    """The first row is up (+y), the middle column is +z, and a quarter of the width left of it is +x."""
    lit = scene([], [lamp("dome", texture="sky")], pictures=sky(place))
    away = tuple(-component for component in direction)
    assert looked(lit, direction, rays=2)[0] > 0.2
    assert looked(lit, away, rays=2)[0] == 0.0


def test_an_even_picture_of_the_sky_lights_like_an_even_sky():
    even = {"sky": np.ones((8, 16, 4), np.float32)}
    eye = (100.0, 20.0, 400.0)
    found, error = looked(
        scene([(plate(500.0), matt(0.5))], [lamp("dome", texture="sky")], pictures=even), (0, 0, 500.0), eye
    )
    assert abs(found - 0.5) <= LIT_ERRORS * error
    assert error < 0.01


def test_a_bright_spot_of_the_sky_lights_by_its_irradiance():
    """Against a sum over directions of the interpolated picture."""
    pictures = sky((2, 6))
    lit = scene([(plate(500.0), matt(0.5))], [lamp("dome", texture="sky", pose=np.diag([1.0, 1.0, -1.0, 1.0]))],
                pictures=pictures)  # fmt: skip
    found, error = looked(lit, (0.0, 0.0, 500.0), (100.0, 20.0, 400.0))
    latitude, longitude = np.meshgrid(
        (0.5 - (np.arange(800) + 0.5) / 800) * np.pi, (0.5 - (np.arange(1600) + 0.5) / 1600) * 2 * np.pi, indexing="ij"
    )
    values = [
        slow_texel(pictures["sky"][..., 0], 0.5 - b / (2 * np.pi), 0.5 + a / np.pi, ("repeat", "clamp"))
        for a, b in zip(latitude[::8, ::8].ravel(), longitude[::8, ::8].ravel(), strict=True)
    ]
    # The dome's +z is turned to the camera, where the plate faces.
    cosine = np.maximum(np.cos(latitude) * np.cos(longitude), 0)[::8, ::8].ravel()
    expected = np.sum(values * cosine * np.cos(latitude[::8, ::8].ravel())) * 2 * np.pi**2 / len(values)
    assert abs(math.pi / 0.5 * found - expected) <= LIT_ERRORS * math.pi / 0.5 * error + 0.01 * expected
    assert expected > 0.01


def test_below_an_even_sky_ink_and_paper_have_the_radiance_of_their_reflectance() -> None:
    """The radiance of a matt surface below a sky of 1 is its reflectance, here at two wavelengths."""
    wavelengths, lighting = (520.0, 590.0), Lighting(lamps=(lamp("dome"),), coats=(None,), bounces=0)
    lights = tuple(map(alone, wavelengths))
    view = LitView([(BOARD, rigs.facing(434.4))], [], lighting, {}, 0.0, lights, [PRINT.colours(BOARD, lights)])
    for number, nm in enumerate(wavelengths):
        found = sorted(looked(view.in_light(number), (0.0, y, 434.4)) for y in (-20.0, 20.0))
        expected = sorted(np.interp(nm, one.wavelengths_nm, one.reflectance) for one in (PRINT.ink, PRINT.paper))
        for (mean, error), value in zip(found, expected, strict=True):
            assert abs(mean - value) <= LIT_ERRORS * error + 1e-9
