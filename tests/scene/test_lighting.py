"""Lamps, meshes and materials as they are read from stages, and what is said about those that cannot be read."""

import hashlib
import math
from base64 import b64decode

import numpy as np
import pytest
from laws.lit import lamp, looked, scene, towards
from PIL import Image
from stage_text import head

import pipeline
from pipeline.camera.parts.spectrum import alone
from pipeline.files.pictures import decoded
from pipeline.graph.poses import Things, target_poses
from pipeline.records.plain import from_plain
from pipeline.render.lighting.lit_scene import LitScene, LitView
from pipeline.render.lighting.records import Lamp
from pipeline.scene.lamps import shines
from pipeline.scene.load import load
from pipeline.targets.mesh import Occluder
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target, target_from_plain

DATASET = """
def PlenDataset "Scene"
{
    rel plen:cameras = </Scene/Rig/Camera>
    rel plen:targets = </Scene/Board>

    def "Rig" (
        prepend references = @rigs/conventional_100mm.usda@
    )
    {
    }

    def "Board" (
        prepend references = @targets/checkerboard_4x7.usda@
    )
    {
        double3 xformOp:translate = (2000, 0, -1500)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    %s
}
"""
SUN = """
    def DistantLight "Sun"
    {
        float inputs:angle = 0
        float inputs:intensity = 2
    }
"""
WALL = """
    def Mesh "Wall" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        %s
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-50, -50, -500), (50, -50, -500), (50, 50, -500), (-50, 50, -500)]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (
            interpolation = "vertex"
        )
        uniform token subdivisionScheme = "none"
    }
"""
TEXTURED = """
    def Material "Paper"
    {
        token outputs:surface.connect = </Scene/Paper/Surface.outputs:surface>

        def Shader "Surface"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </Scene/Paper/Picture.outputs:rgb>
            float inputs:ior = 1
            token outputs:surface
        }

        def Shader "Picture"
        {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @picture.png@
            token inputs:sourceColorSpace = "%s"
            float2 inputs:st.connect = </Scene/Paper/Reader.outputs:result>
            float3 outputs:rgb
        }

        def Shader "Reader"
        {
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }
    }
"""


def loaded(folder, content: str, end: int = 1):
    path = folder / "scene.usda"
    path.write_text(head("Scene", end=end) + DATASET % content, encoding="utf-8")
    return load(path)


def lit(folder, content: str, frame: int = 0) -> LitScene:
    """The scene of a stage, before its camera."""
    found = loaded(folder, content, frame + 1)
    assert found.errors == [], [str(problem) for problem in found.errors]
    dataset, name = found.dataset, "Rig.Camera"
    things, moment = Things(dataset, painted=True), dataset.frames[frame]
    occluders = [
        (from_plain(Occluder, one.occluder), np.array(one.vision_from_occluder))
        for one in things.occluders(moment, name)
    ]
    targets = [
        (target_from_plain(one.target), np.array(one.vision_from_target))
        for one in things.targets(target_poses(dataset, moment, name))
    ]
    lighting = things.lighting(moment, name, 0)
    assert lighting is not None
    pictures = {one.name: decoded(b64decode(one.encoded), one.suffix, one.space) for one in dataset.pictures}
    return LitView(targets, occluders, lighting, pictures, 0.0, (alone(550.0),)).in_light(0)


def wall_light(folder, content: str, at=(0.0, 0.0, 500.0), frame: int = 0) -> float:
    return looked(lit(folder, content, frame), at, rays=16)[0]


def test_a_matt_mesh_below_a_distant_light_has_its_display_colour(tmp_path):
    grey = WALL % "color3f[] primvars:displayColor = [(0.6, 0.6, 0.6)]"
    assert wall_light(tmp_path, SUN + grey) == pytest.approx(2 * 0.6 / math.pi, rel=1e-6)
    assert wall_light(tmp_path, SUN + WALL % "") == pytest.approx(2 * 0.18 / math.pi, rel=1e-6)


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


def test_what_is_hidden_or_for_viewers_alone_is_in_no_image(tmp_path):
    veil = (WALL % "").replace('"Wall"', '"Veil"').replace("-500)", "-400)")
    shown = SUN + WALL % "color3f[] primvars:displayColor = [(0.6, 0.6, 0.6)]"
    bare = wall_light(tmp_path, shown)
    for hiding in (
        'uniform token purpose = "guide"',
        'uniform token purpose = "proxy"',
        'token visibility = "invisible"',
    ):
        assert wall_light(tmp_path, shown + veil.replace("int[]", f"{hiding}\n int[]", 1)) == bare
    assert wall_light(tmp_path, shown + veil) == pytest.approx(2 * 0.18 / math.pi, rel=1e-6)


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
    content = (
        SUN
        + """
    class Xform "Part"
    {
        def Mesh "Card"
        {
            int[] faceVertexCounts = [3]
            int[] faceVertexIndices = [0, 1, 2]
            point3f[] points = [(-9, -9, -500), (9, -9, -500), (0, 9, -500)]
            uniform token subdivisionScheme = "none"
        }
    }

    def Xform "One" (
        inherits = </Scene/Part>
        instanceable = true
    )
    {
    }

    def Xform "Other" (
        inherits = </Scene/Part>
        instanceable = true
    )
    {
        double3 xformOp:translate = (50, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    """
    )
    places = [(0.0, 0.0, 500.0), (50.0, 0.0, 500.0), (25.0, 0.0, 500.0)]
    assert [wall_light(tmp_path, content, at=place) > 0 for place in places] == [True, True, False]


def test_a_mesh_of_a_lit_dataset_hides_points_and_one_of_a_dark_one_does_not(tmp_path):
    assert [one.prim_path for one in loaded(tmp_path, SUN + WALL % "").dataset.occluders] == ["/Scene/Wall"]
    dark = loaded(tmp_path, WALL % "").dataset
    assert dark.occluders == () and dark.lamps == () and dark.pictures == ()


def test_a_texture_without_file_or_coordinates_is_named_at_its_shader(tmp_path):
    content = SUN + WALL % "rel material:binding = </Scene/Paper>" + TEXTURED % "raw"
    Image.new("RGB", (2, 2)).save(tmp_path / "picture.png")
    broken = [
        (content.replace("@picture.png@", "@absent.png@"), "asset-missing", "absent.png"),
        (content.replace("texCoord2f[] primvars:st", "texCoord2f[] primvars:uv"), "unreadable-value", "primvars:st"),
        (content.replace("UsdPrimvarReader_float2", "UsdPrimvarReader_float3"), "not-yet-supported", "connect a"),
        (content.replace('Space = "raw"', 'Space = "linear"'), "unreadable-value", "raw, sRGB, auto"),
    ]
    for text, code, word in broken:
        errors = loaded(tmp_path, text).errors
        assert [one.code for one in errors][:1] == [code], [str(one) for one in errors]
        assert word in f"{errors[0].message} {errors[0].hint}"
        assert errors[0].line


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
