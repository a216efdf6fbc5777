"""Lamps, meshes and materials as they are read from stages, and what is said about those that cannot be read."""

import functools
import gc
import hashlib
import math
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from plugins.scenes.lit import lamp, looked, scene, towards
from plugins.scenes.stage_materials import material_text
from stage_text import in_the_library, mesh_text, placed

import pipeline
from pipeline.camera.parts.spectrum import alone
from pipeline.plugins.scenes.graph import LitThings
from pipeline.plugins.scenes.lighting.lit_scene import LitScene, LitView
from pipeline.plugins.scenes.lighting.records import Lamp
from pipeline.plugins.scenes.picture_files import decoded
from pipeline.plugins.scenes.reading.lamps import shines
from pipeline.products.surroundings import placed_occluder, placed_target
from pipeline.records.plain import from_plain
from pipeline.scene.load import load
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

BESIDE = placed(2000, 0, -1500)
"""Where the board stands: in no image."""
SUN = """
    def DistantLight "Sun"
    {
        float inputs:angle = 0
        float inputs:intensity = 2
    }
"""
SQUARE = [(-50, -50, -500), (50, -50, -500), (50, 50, -500), (-50, 50, -500)]
PLACES = 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")'
WALL = mesh_text("Wall", SQUARE, PLACES, "%s", schemas="MaterialBindingAPI")
SURFACE = material_text("/Scene/Paper", "float inputs:ior = 1", "%s", beside="%s")
PICTURE = """
        def Shader "Picture%s"
        {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @picture.png@
            token inputs:sourceColorSpace = "%s"
            token inputs:wrapS = "clamp"
            token inputs:wrapT = "clamp"
            float2 inputs:st.connect = </Scene/Paper/Reader%s.outputs:result>
            float outputs:r
            float3 outputs:rgb
        }
"""
READER = """
        def Shader "Reader%s"
        {
            uniform token info:id = "UsdPrimvarReader_%s"
            string inputs:varname = "%s"
            %s
        }
"""
TEXTURED = SURFACE % (
    "color3f inputs:diffuseColor.connect = </Scene/Paper/Picture.outputs:rgb>",
    PICTURE % ("", "%s", "") + READER % ("", "float2", "st", "float2 outputs:result"),
)


@functools.lru_cache(maxsize=1)
def loaded(folder, content: str, end: int = 1):
    """A stage of some content: a test that looks at several places of it reads it once."""
    path = folder / "scene.usda"
    path.write_text(in_the_library(content, board=BESIDE, end=end), encoding="utf-8")
    return load(path)


@functools.lru_cache(maxsize=1)
def lit(folder, content: str, frame: int = 0) -> LitScene:
    """The scene of a stage, before its camera."""
    found = loaded(folder, content, frame + 1)
    assert found.errors == [], [str(problem) for problem in found.errors]
    dataset = found.dataset
    moment, camera = dataset.frames[frame], dataset.cameras[0]
    view = LitThings(dataset, painted=True).view(moment, camera, ())
    occluders, targets = list(map(placed_occluder, view.occluders)), list(map(placed_target, view.targets))
    lighting = replace(view.lighting, bounces=0)
    pictures = {one.name: decoded(b64decode(one.encoded), one.suffix, one.space) for one in dataset.pictures}
    return LitView(targets, occluders, lighting, pictures, 0.0, (alone(550.0),)).in_light(0)


def wall_light(folder, content: str, at=(0.0, 0.0, 500.0), frame: int = 0, rays: int = 16) -> float:
    return looked(lit(folder, content, frame), at, rays=rays)[0]


def test_a_matt_mesh_below_a_distant_light_has_its_display_colour(tmp_path):
    grey = WALL % "color3f[] primvars:displayColor = [(0.6, 0.6, 0.6)]"
    assert wall_light(tmp_path, SUN + grey) == pytest.approx(2 * 0.6 / math.pi, rel=1e-6)
    assert wall_light(tmp_path, SUN + WALL % "") == pytest.approx(2 * 0.18 / math.pi, rel=1e-6)


@pytest.mark.parametrize(("scale", "light"), [("(1, 1, 0)", 0.36), ("(0, 0, 0)", 0.0), ("(1, 0, 0)", 0.0)])
def test_a_ball_that_is_scaled_flat_is_a_disc_and_one_without_extent_is_hidden(tmp_path, scale, light):
    """Programs hide things by a scale of 0. The normal of a disc is its axis everywhere."""
    moved = f"{placed(0, 0, -500)}\ndouble3 xformOp:scale = {scale}".replace('late"]', 'late", "xformOp:scale"]')
    ball = f'def Sphere "Ball"\n{{\ndouble radius = 50\n{moved}\n}}\n'
    assert wall_light(tmp_path, SUN + ball, at=(30.0, 0.0, 500.0)) == pytest.approx(light / math.pi, rel=1e-6)


@pytest.mark.parametrize(
    ("more", "factor"),
    [
        ("float inputs:exposure = 3", 8.0),
        ("color3f inputs:color = (0.25, 0.25, 0.25)", 0.25),
        ("bool inputs:normalize = true", 1.0),
    ],
)
def test_exposure_colour_and_normalisation_multiply_the_light(tmp_path, more, factor):
    sun = SUN.replace("float inputs:intensity", more + "\n float inputs:intensity")
    assert wall_light(tmp_path, sun + WALL % "") == pytest.approx(factor * 2 * 0.18 / math.pi, rel=1e-6)


def test_a_normalised_lamp_lights_alike_at_any_size(tmp_path):
    """From far away, by its power."""
    lights = []
    for size in (1, 4):
        lamp = f"""
        def RectLight "Lamp"
        {{
            float inputs:height = {size}
            float inputs:intensity = 1e4
            bool inputs:normalize = true
            float inputs:width = {size}
        }}"""
        lights.append(wall_light(tmp_path, lamp + WALL % "", at=(30.0, 0.0, 500.0)))
    assert lights[0] > 0
    assert lights[0] == pytest.approx(lights[1], rel=1e-3)


def test_a_normalised_point_lights_by_the_square_of_its_distance(tmp_path):
    """As spheres far away do, whose area of 4 pi r^2 its intensity is divided by: a matt wall has rho / pi of it."""
    point = """
        def SphereLight "Lamp"
        {
            float inputs:intensity = 1e6
            bool inputs:normalize = true
            float inputs:radius = 0
            double3 xformOp:translate = (0, 80, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }"""
    squared = 30.0**2 + 80.0**2 + 500.0**2
    expected = 0.18 / math.pi * 1e6 / (4 * squared) * 500.0 / math.sqrt(squared)
    assert wall_light(tmp_path, point + WALL % "", at=(30.0, 0.0, 500.0)) == pytest.approx(expected, rel=1e-5)
    [told] = [problem for problem in loaded(tmp_path, point + WALL % "", 1).problems if problem.code == "not-drawn"]
    assert "radius of 0.1 mm" in told.message


@pytest.mark.parametrize(("intensity", "is_told"), [(3.0, False), (30.0, True)])
def test_a_sky_that_makes_everything_white_is_told(tmp_path, intensity, is_told):
    sky = f'def DomeLight "Sky"\n{{\nfloat inputs:intensity = {intensity}\n}}\n'
    loaded(tmp_path, sky + WALL % "")
    codes = [problem.code for problem in load(tmp_path / "scene.usda", look=True).problems]
    assert ("bright-sky" in codes) == is_told


def test_normals_of_a_mesh_without_faces_are_no_traceback(tmp_path):
    mesh = """
        def Mesh "Nothing"
        {
            point3f[] points = [(-1, -1, 0), (1, -1, 0), (-1, 1, 0)]
            normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1)] (interpolation = "faceVarying")
        }"""
    [told] = [problem for problem in loaded(tmp_path, SUN + mesh).problems if "Nothing" in (problem.at or "")]
    assert told.code == "not-drawn" and "no faces" in told.message


def test_a_lamp_is_off_in_frames_in_which_it_is_invisible(tmp_path):
    blinking = SUN.replace("}", 'token visibility.timeSamples = {1: "inherited", 2: "invisible",}\n}')
    assert wall_light(tmp_path, blinking + WALL % "") > 0
    assert wall_light(tmp_path, blinking + WALL % "", frame=1) == 0.0


@pytest.mark.parametrize(("space", "low"), [("raw", 0.5), ("sRGB", 0.214), ("auto", 0.214)])
def test_a_picture_stands_upright_and_knows_its_colour_space(tmp_path, space, low):
    """t = 1 is the first row of the file, and s = 0 its left end; 128 of 255 is 0.216 in sRGB."""
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[0, 0], pixels[0, 1], pixels[1, 0] = 255, 128, 64
    Image.fromarray(pixels).save(tmp_path / "picture.png")
    content = SUN + WALL % "rel material:binding = </Scene/Paper>" + TEXTURED % space
    scale = math.pi / 2
    # The camera's y points down; a texel's centre is a quarter of the edge from the corner.
    top_left, top_right, bottom_right = (
        scale * wall_light(tmp_path, content, at=place) for place in ((-25, -25, 500), (25, -25, 500), (25, 25, 500))
    )
    assert top_left == pytest.approx(1.0, rel=1e-6)
    assert top_right == pytest.approx(low, abs=0.003)
    assert bottom_right == 0.0


def test_a_picture_without_a_wrap_mode_is_black_beyond_its_edges(tmp_path):
    Image.fromarray(np.full((8, 8, 3), 255, np.uint8)).save(tmp_path / "picture.png")
    twice = """def Shader "Twice"
        {
            uniform token info:id = "UsdTransform2d"
            float2 inputs:in.connect = </Scene/Paper/Reader.outputs:result>
            float2 inputs:scale = (2, 1)
            float2 outputs:result
        }
        def Shader "Reader"
"""
    content = (TEXTURED % "raw").replace('token inputs:wrapS = "clamp"', "").replace('def Shader "Reader"', twice)
    content = BOUND % "" + content.replace("st.connect = </Scene/Paper/Reader", "st.connect = </Scene/Paper/Twice")
    light = [drawn_with(tmp_path, content, at=(x, 0.0, 500.0))[0] for x in (-25.0, 25.0)]
    assert light == pytest.approx([1.0, 0.0], rel=1e-6)


def test_the_flattened_stage_names_pictures_by_their_content_and_no_folder_of_this_machine(tmp_path):
    Image.fromarray(np.full((1, 1, 3), 7, np.uint8)).save(tmp_path / "picture.png")
    found = loaded(tmp_path, SUN + TEXTURED % "raw" + WALL % "rel material:binding = </Scene/Paper>")
    content = (tmp_path / "picture.png").read_bytes()
    file = f"pictures/{hashlib.sha256(content).hexdigest()[:16]}.png"
    assert f"asset inputs:file = @./{file}@" in found.flattened
    assert str(tmp_path) not in found.flattened
    assert [one.file for one in found.dataset.pictures] == [file]
    out = tmp_path / "out"
    assert pipeline.build(tmp_path / "scene.usda", out, targets=["dataset.usda", file], jobs=1).exit_code == 0
    assert (out / file).read_bytes() == content
    again = load(out / "dataset.usda")
    assert (again.errors, again.dataset.pictures) == ([], found.dataset.pictures)


def test_instances_are_seen_each_at_its_place(tmp_path):
    card = mesh_text("Card", [(-9, -9, -500), (9, -9, -500), (0, 9, -500)])
    part = "(\ninherits = </Scene/Part>\ninstanceable = true\n)"
    both = f'def Xform "One" {part} {{\n}}\ndef Xform "Other" {part} {{\n{placed(50, 0, 0)}\n}}\n'
    content = f'{SUN}class Xform "Part" {{\n{card}}}\n{both}'
    places = [(0.0, 0.0, 500.0), (50.0, 0.0, 500.0), (25.0, 0.0, 500.0)]
    assert [wall_light(tmp_path, content, at=place) > 0 for place in places] == [True, True, False]


def test_a_mesh_of_a_lit_dataset_hides_points_and_one_of_a_dark_one_does_not(tmp_path):
    assert [one.prim_path for one in loaded(tmp_path, SUN + WALL % "").dataset.occluders] == ["/Scene/Wall"]
    dark = loaded(tmp_path, WALL % "").dataset
    assert dark.occluders == () and dark.lamps == () and dark.pictures == ()


def drawn_with(folder, content: str, **at) -> tuple[float, list]:
    """Light of the wall below the sun over what a white one has, and the warnings about what is not drawn."""
    warnings = [one for one in loaded(folder, content, 1).problems if one.code == "not-drawn"]
    return wall_light(folder, content, **at) * math.pi / 2, warnings


BOUND = SUN + WALL % "rel material:binding = </Scene/Paper>\n%s"


@pytest.mark.parametrize(
    ("change", "drawn", "words"),
    [
        (("token outputs:surface.connect", "token outputs:mtlx:surface.connect"), 0.3, "outputs:mtlx:surface"),
        (('"UsdPreviewSurface"', '"ND_standard_surface"'), 0.3, "ND_standard_surface"),
        (("token outputs:surface.connect = </Scene/Paper/Surface.outputs:surface>", ""), 0.3, "no surface"),
        (("inputs:ior = 1", "inputs:ior = 1\nfloat inputs:displacement = 2"), 0.6, "displacement"),
        (("inputs:ior = 1", "inputs:ior = 1\nnormal3f inputs:normal = (0.6, 0, 0.8)"), 0.6, "normals without pictures"),
        (
            ("color3f inputs:diffuseColor = ", "color3f inputs:diffuseColor.timeSamples = {1: (0.6, 0.6, 0.6), 9: "),
            0.6,
            "first frame",
        ),
        (
            ("inputs:diffuseColor = (0.6, 0.6, 0.6)", "inputs:diffuseColor.connect = </Scene/Paper/Surface.outputs:x>"),
            0.18,
            '"inputs:diffuseColor" is connected to </Scene/Paper/Surface.outputs:x>, which is not there',
        ),
    ],
)
def test_what_a_material_of_others_asks_for_and_is_not_drawn_is_one_warning(tmp_path, change, drawn, words):
    colour = "color3f inputs:diffuseColor = (0.6, 0.6, 0.6)" + ("}" if "timeSamples" in change[1] else "")
    content = BOUND % "color3f[] primvars:displayColor = [(0.3, 0.3, 0.3)]" + (SURFACE % (colour, "")).replace(*change)
    found, warnings = drawn_with(tmp_path, content)
    assert found == pytest.approx(drawn, rel=1e-6)
    assert len(warnings) == 1 and words in warnings[0].message and warnings[0].at.startswith("/Scene/Paper")


def test_a_material_for_previews_is_drawn_where_the_full_one_cannot_be(tmp_path):
    other = SURFACE.replace('"Paper"', '"Other"').replace("/Paper/", "/Other/").replace("UsdPreviewSurface", "mdl")
    binding = "rel material:binding:preview = </Scene/Paper>\nrel material:binding:full = </Scene/Other>"
    content = SUN + WALL % binding + SURFACE % ("color3f inputs:diffuseColor = (0.4, 0.4, 0.4)", "") + other % ("", "")
    assert drawn_with(tmp_path, content) == (pytest.approx(0.4, rel=1e-6), [])


def test_a_binding_to_a_shader_binds_nothing_and_is_named(tmp_path):
    content = SUN + WALL % "rel material:binding = </Scene/Paper/Surface>" + SURFACE % ("", "")
    light, [told] = drawn_with(tmp_path, content)
    assert light == pytest.approx(0.18, rel=1e-6)
    assert told.at == "/Scene/Wall.material:binding" and "which is a Shader" in told.message


CORNERS = [(-45.0, 45.0), (45.0, 45.0), (45.0, -45.0), (-45.0, -45.0)]
"""Places near the corners of the wall in the order of its vertices; the camera's y points down."""


@pytest.mark.parametrize("interpolation", ["vertex", "varying", "faceVarying"])
@pytest.mark.parametrize("by_reader", [False, True])
def test_colours_at_vertices_lie_linearly_between_them(tmp_path, interpolation, by_reader):
    """By the display colour alone, and by a material that reads it."""
    colours = f"""color3f[] primvars:displayColor = [(0.1, 0.1, 0.1), (0.7, 0.7, 0.7)] (
            interpolation = "{interpolation}"
        )
        int[] primvars:displayColor:indices = [0, 1, 1, 0]"""
    reader = "color3f inputs:diffuseColor.connect = </Scene/Paper/Reader.outputs:result>"
    material = SURFACE % (reader, READER % ("", "float3", "displayColor", "float3 outputs:result"))
    content = BOUND % colours + material if by_reader else SUN + WALL % colours
    for (x, y), expected in zip(CORNERS, (0.13, 0.67, 0.67, 0.13), strict=True):
        assert drawn_with(tmp_path, content, at=(x, y, 500.0))[0] == pytest.approx(expected, rel=1e-6)


def test_colours_and_opacities_of_faces_are_those_of_the_faces(tmp_path):
    two = (
        (WALL % "")
        .replace("[4]", "[3, 3]")
        .replace("[0, 1, 2, 3]", "[0, 1, 2, 0, 2, 3]")
        .replace(
            "uniform token subd",
            """color3f[] primvars:displayColor = [(0.2, 0.2, 0.2), (0.5, 0.5, 0.5)] (interpolation = "uniform")
        float[] primvars:displayOpacity = [1, 0] (interpolation = "uniform")
        uniform token subd""",
        )
    )
    (first, warnings), (second, _) = (drawn_with(tmp_path, SUN + two, at=(x, x, 500.0)) for x in (20.0, -20.0))
    assert (first, second) == (pytest.approx(0.2, rel=1e-6), 0.0)
    assert len(warnings) == 1 and "hides points as if it were opaque" in warnings[0].message


def test_a_primvar_that_is_not_there_is_its_fallback(tmp_path):
    reader = "color3f inputs:diffuseColor.connect = </Scene/Paper/Reader.outputs:result>"
    fallback = "float3 inputs:fallback = (0.4, 0.4, 0.4)\nfloat3 outputs:result"
    found, warnings = drawn_with(tmp_path, BOUND % "" + SURFACE % (reader, READER % ("", "vector", "paint", fallback)))
    assert found == pytest.approx(0.4, rel=1e-6)
    assert len(warnings) == 1 and '"primvars:paint"' in warnings[0].message and "0.4, 0.4, 0.4" in warnings[0].message


@pytest.mark.parametrize(
    ("name", "kind", "value", "output", "expected"),
    [("diffuseColor", "float3", "color3f primvars:paint = (0.6, 0.6, 0.6)", "float3", 0.6),
     ("opacity", "float", "float primvars:paint = 0", "float", 0.0)],
)  # fmt: skip
def test_a_primvar_that_is_no_array_is_its_value_everywhere(tmp_path, name, kind, value, output, expected):
    reader = f"{'color3f' if kind == 'float3' else kind} inputs:{name}.connect = </Scene/Paper/Reader.outputs:result>"
    material = SURFACE % (reader, READER % ("", kind, "paint", f"{output} outputs:result"))
    shade, warnings = drawn_with(tmp_path, BOUND % value + material)
    assert shade == pytest.approx(expected, rel=1e-6)
    assert not any("paint" in warning.message for warning in warnings)


def test_two_textures_of_a_material_have_each_their_coordinates(tmp_path):
    """Half as opaque, and only where the second set says so."""
    pixels = np.zeros((1, 2, 3), np.uint8)
    pixels[0, 0] = 255
    Image.fromarray(pixels).save(tmp_path / "picture.png")
    sets = """texCoord2f[] primvars:other = [(0.25, 0.5), (0.25, 0.5), (0.75, 0.5), (0.75, 0.5)] (
            interpolation = "vertex"
        )"""
    inputs = """color3f inputs:diffuseColor.connect = </Scene/Paper/Picturest.outputs:rgb>
            float inputs:opacity.connect = </Scene/Paper/Pictureother.outputs:r>
            float inputs:opacityThreshold = 0.5"""
    result = "float2 outputs:result"
    shaders = "".join(PICTURE % (st, "raw", st) + READER % (st, "float2", st, result) for st in ("st", "other"))
    content = BOUND % sets + SURFACE % (inputs, shaders)
    places = {(-45.0, 40.0): 1.0, (45.0, 40.0): 0.0, (-45.0, -40.0): 0.0}
    for (x, y), expected in places.items():
        assert drawn_with(tmp_path, content, at=(x, y, 500.0))[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("last", "warned"), [(None, 0), (255, 0), (128, 1)])
def test_a_picture_without_a_hole_is_opaque_and_no_warning_says_that_light_passes(tmp_path, last, warned):
    """Exporters connect the fourth component whether the picture has one or not."""
    pixels = np.full((2, 2, 3 if last is None else 4), 255, np.uint8)
    if last is not None:
        pixels[0, 0, 3] = last
    Image.fromarray(pixels).save(tmp_path / "picture.png")
    inputs = "color3f inputs:diffuseColor = (1, 1, 1)\nfloat inputs:opacity.connect = </Scene/Paper/Picture.outputs:a>"
    shaders = PICTURE.replace("float outputs:r", "float outputs:a") % ("", "auto", "")
    shaders += READER % ("", "float2", "st", "float2 outputs:result")
    found, warnings = drawn_with(tmp_path, BOUND % "" + SURFACE % (inputs, shaders), at=(20.0, -20.0, 500.0))
    assert len(warnings) == warned and (found == pytest.approx(1.0, rel=1e-6)) != warned


LAMP = """
    def %s "Lamp" (
        prepend apiSchemas = ["ShapingAPI"]
    )
    {
        %s
        double3 xformOp:translate = (0, 0, 500)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
"""
"""A lamp a metre before the wall, which shines onto it."""


def test_a_lamp_is_shaped_as_its_stage_says(tmp_path):
    plain = "float inputs:radius = 5"
    cone = plain + "\nfloat inputs:shaping:cone:angle = 30\nfloat inputs:shaping:focus = 2"
    lights = {
        at: [
            wall_light(tmp_path, LAMP % ("SphereLight", lines) + WALL % "", at, rays=1 << 12) for lines in (plain, cone)
        ]
        for at in ((30.0, 0.0, 500.0), (-45.0, 45.0, 500.0))
    }
    for (x, y, _), (even, focused) in lights.items():
        angle = math.atan(math.hypot(x, y) / 1000.0)
        assert focused == pytest.approx(even * math.cos(angle) ** 2, rel=2e-4)
    away = LAMP.replace("(0, 0, 500)", "(0, 0, -400)") % ("SphereLight", cone) + WALL % ""
    assert wall_light(tmp_path, away, (-45.0, 45.0, 500.0)) == 0.0


def test_a_profile_of_a_luminaire_is_refused(tmp_path):
    (tmp_path / "down.ies").touch()
    profile = LAMP % ("SphereLight", "float inputs:radius = 5\nasset inputs:shaping:ies:file = @down.ies@")
    (error,) = loaded(tmp_path, profile).errors
    assert "IES" in error.message and "cone:angle" in error.hint and error.line and "ies:file" in error.at


@pytest.mark.parametrize(
    ("kind", "lines", "words"),
    [
        ("SphereLight", "rel light:filters = </Scene/Rig>", "without filters"),
        ("SphereLight", "rel collection:lightLink:includes = </Scene/Rig>", "lights everything"),
        ("SphereLight", "float inputs:specular = 0.5", "all materials alike"),
        ("SphereLight", "float inputs:intensity.timeSamples = {0: 1, 9: 5}", "time code 0"),
        ("DistantLight", "float inputs:shaping:cone:angle = 20", "it shines evenly"),
        ("PortalLight", "", "shine nothing here"),
    ],
)
def test_what_a_light_of_others_asks_for_and_is_not_drawn_is_one_warning(tmp_path, kind, lines, words):
    found = loaded(tmp_path, SUN + LAMP % (kind, lines))
    warnings = [one for one in found.problems if one.code == "not-drawn"]
    assert found.errors == []
    assert len(warnings) == 1 and words in warnings[0].message and warnings[0].at.startswith("/Scene/Lamp")


def test_a_rect_that_is_scaled_unevenly_has_the_size_that_results_and_a_ball_is_drawn_as_one(tmp_path):
    stretched = LAMP.replace("double3", "double3 xformOp:scale = (3, 2, 7)\ndouble3").replace(
        'late"', 'late", "xformOp:scale"'
    )
    found = loaded(tmp_path, stretched % ("RectLight", "float inputs:width = 4\nfloat inputs:height = 5"))
    assert found.dataset.lamps[0].lamp.size == pytest.approx((6.0, 5.0), rel=1e-12)
    assert [one.code for one in found.problems] == []
    found = loaded(tmp_path, stretched % ("SphereLight", "float inputs:radius = 5"))
    assert found.dataset.lamps[0].lamp.size[0] == pytest.approx(5 * 42 ** (1 / 3))
    assert [one.code for one in found.problems] == ["not-drawn"]


def test_the_pole_of_a_dome_is_the_axis_that_it_names(tmp_path):
    """The first row of the picture is at the pole: straight up, or towards the viewer."""
    pixels = np.zeros((4, 4, 3), np.uint8)
    pixels[0] = 255
    Image.fromarray(pixels).save(tmp_path / "picture.png")
    dome = """
    def DomeLight_1 "Sky"
    {
        asset inputs:texture:file = @picture.png@
        uniform token poleAxis = "%s"
    }
"""
    for pole, (up, back) in {"Y": (1.0, 0.0), "scene": (1.0, 0.0), "Z": (0.0, 1.0)}.items():
        sky = lit(tmp_path, dome % pole)
        assert looked(sky, (0.0, -500.0, 0.0), rays=2)[0] == pytest.approx(up, abs=1e-6)
        assert looked(sky, (0.0, 0.0, -500.0), rays=2)[0] == pytest.approx(back, abs=1e-6)


@pytest.mark.parametrize(("mode", "seen"), [("materialGlowTintsLight", 3.0), ("noMaterialResponse", 3.0)])
def test_a_mesh_that_is_a_light_shines_and_lights_a_dataset_without_lamps(tmp_path, mode, seen):
    light = f'float inputs:intensity = 1.5\nfloat inputs:exposure = 1\nuniform token light:materialSyncMode = "{mode}"'
    shining = (WALL % light).replace('["MaterialBindingAPI"]', '["MaterialBindingAPI", "MeshLightAPI"]')
    assert wall_light(tmp_path, shining) == pytest.approx(seen, rel=1e-6)
    floor = (WALL % "").replace('"Wall"', '"Floor"').replace("-500)", "-900)").replace("50,", "400,")
    assert wall_light(tmp_path, shining + floor, (150.0, 0.0, 900.0)) > 0.001  # from its back as well
    assert loaded(tmp_path, shining).dataset.lamps == ()


BOARD = Target(Checkerboard(columns=4, rows=3, square_mm=10.0, white=1.0, black=1.0))
SPOT = (5.0, 5.0, 500.0)
SIZES = {
    "rect": (20.0, 10.0),
    "disk": (15.0, 0.0),
    "sphere": (12.0, 0.0),
    "cylinder": (20.0, 5.0),
    "distant": (0.1, 0.0),
}


@pytest.mark.parametrize("kind", SIZES)
@pytest.mark.parametrize("z", [(0.0, 0.1, -1.0), (0.1, 0.0, 1.0)])
@pytest.mark.parametrize("centre", [(30.0, 0.0, 200.0), (30.0, 0.0, 800.0)])
def test_what_the_check_says_is_what_an_image_shows(kind: str, z: tuple, centre: tuple) -> None:
    pose = np.diag([1.0, -1.0, -1.0, 1.0])  # the front of the board faces the eye at the origin
    pose[2, 3] = SPOT[2]
    placed = lamp(kind, SIZES[kind], towards(z, centre))
    around = scene([], [placed], targets=[(BOARD, pose, None)])
    is_lit = looked(around, SPOT, (100.0, 0.0, 0.0), 256)[0] > 0
    places, fronts = np.array([SPOT]), pose[None, :3, 2]
    is_reached = shines(from_plain(Lamp, placed.lamp), np.array(placed.vision_from_lamp), places, fronts)
    assert is_reached == is_lit


@pytest.mark.parametrize(
    ("flaw", "mended"),
    [
        ("normal3f[] normals = [(0, 0, 1), (0, 1, 0)]", "normal3f[] normals = []"),
        ("rel material:binding = </Scene/Paper>", "rel material:binding"),
    ],
)
def test_a_file_that_was_mended_is_read_again_in_the_same_process(tmp_path, flaw, mended):
    """USD shares what is open: a flaw that held its stage would be there for ever."""
    other = (SURFACE % ("", "")).replace("UsdPreviewSurface", "Other")
    path, codes = tmp_path / "dataset.usda", []
    gc.disable()
    try:
        for line in (flaw, mended):
            path.write_text(in_the_library(SUN + other + WALL % line, board=BESIDE), encoding="utf-8")
            codes.append([each.code for each in load(path, look=True).problems])
    finally:
        gc.enable()
    assert "not-drawn" in codes[0] and "not-drawn" not in codes[1]
