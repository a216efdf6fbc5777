"""Scenes of others compose: what a stage references is taken as USD takes it, and what cannot be drawn is a warning."""

import re
from base64 import b64decode
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from PIL import Image
from plugins.scenes.stage_materials import material_text
from plugins.scenes.test_shapes import ARM
from pxr import Sdf, Usd, UsdGeom, UsdUtils
from stage_text import edited, head, in_the_library, mesh_text, placed, stage_in
from tolerances import SINGLE

from pipeline.errors import PipelineError
from pipeline.plugins.scenes.picture_files import decoded
from pipeline.scene.load import Loaded, load

SKY_AND_MAN = 'def DomeLight "Sky"\n{\n}\ndef Xform "Man" (\nprepend references = @asset.usda@\n)\n{\n%s\n}\n'
STAGE = in_the_library(SKY_AND_MAN, rig=placed(0, 0, 9000), board=placed(2000, 0, -1500))
PLACES = 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (0, 1)] (interpolation = "vertex")'
MAN = """
def Xform "Man" (
    %s
)
{
    %s
    %s
    %s
}
"""
BODY = mesh_text("Body", [(0, 0, 0), (0.4, 0, 0), (0, 0, 1.8)], PLACES, "%s", schemas="MaterialBindingAPI")
PAINT = material_text(
    "/Man/Paint",
    "color3f inputs:diffuseColor.connect = </Man/Paint/Picture.outputs:rgb>",
    "float inputs:roughness.connect = </Man/Paint/Picture.outputs:g>",
    own="asset inputs:picture = @%s@",
    beside="""
        def Shader "Picture"
        {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file.connect = </Man/Paint.inputs:picture>
            float2 inputs:st.connect = </Man/Paint/Reader.outputs:result>
            float3 outputs:rgb
            float outputs:g
            %s
        }

        def Shader "Reader"
        {
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }
""",
)
BOUND = "rel material:binding = </Man/Paint>"
METRES = head("Man", unit="1").replace('"Y"', '"Z"')
CONVERTED = """double xformOp:rotateX:unitsResolve = -90
        double3 xformOp:scale:unitsResolve = (1000, 1000, 1000)
        uniform token[] xformOpOrder = ["xformOp:rotateX:unitsResolve", "xformOp:scale:unitsResolve"]"""


def asset(top: str = METRES, meta: str = "", own: str = "", body: str = "", beside: str = "") -> str:
    return top + MAN % (meta, own, BODY % body, beside)


def written(folder: Path, man: str, over: str = CONVERTED) -> Path:
    (folder / "asset.usda").write_text(man, encoding="utf-8")
    return stage_in(folder, STAGE % over)


def untyped(stage: Path, kind: str = "") -> Path:
    """The stage whose own prim for the man has another type, or none."""
    stage.write_text(edited(stage.read_text(), ('def Xform "Man"', f'def {kind} "Man"')), encoding="utf-8")
    return stage


def told(loaded: Loaded) -> list[tuple[str, str]]:
    assert loaded.errors == [] and loaded.dataset
    return [(problem.code, (problem.at or "").rpartition("/")[2]) for problem in loaded.problems]


def box_mm(path: Path) -> tuple[list[float], list[float]]:
    """Least coordinates and size of the man."""
    stage = Usd.Stage.Open(str(path))
    man, cache = stage.GetPrimAtPath("/Scene/Man"), UsdGeom.BBoxCache(Usd.TimeCode(1), [UsdGeom.Tokens.default_])
    box = cache.ComputeWorldBound(man).ComputeAlignedRange()
    return list(box.GetMin()), list(box.GetSize())


@pytest.mark.parametrize(
    "own", ["", 'double3 xformOp:translate = (1, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:translate"]']
)
def test_who_does_not_convert_is_told_the_size_and_the_hint_converts(tmp_path, own):
    """By the hint the man is as tall as its file says, upright, and where the file puts it."""
    loaded = load(written(tmp_path, asset(own=own), ""))
    assert told(loaded) == [("asset-units", "Man")]
    [problem] = loaded.problems
    assert "is 1.8 m large by its own units and 1.8 mm here" in problem.message and "Z is up" in problem.message
    ops = re.findall(r"(double3? xformOp:\S+ = \S+(?: \S+, \S+\))?)(?:,| and)", problem.hint)
    order = re.search(r"uniform token\[\] xformOpOrder = \[.*\]", problem.hint)
    hint = "\n".join([op.rstrip(",") for op in ops] + [order[0]])
    path = written(tmp_path, asset(own=own), hint)
    assert told(load(path)) == []
    start, size = box_mm(path)
    assert size == pytest.approx([400, 1800, 0], abs=1e-3)
    assert start == pytest.approx([1000 if own else 0, 0, 0], abs=1e-3)


@pytest.mark.parametrize(
    ("over", "says"),
    [
        (CONVERTED, []),
        (CONVERTED.replace("1000", "100"), []),  # a thing that is fitted in
        (CONVERTED.replace("1000", "2"), ["metersPerUnit"]),
        (CONVERTED.replace("= [", '= ["xformOp:scale", ') + "\ndouble3 xformOp:scale = (0.001, 0.001, 0.001)", []),
        (CONVERTED.replace("-90", "5"), ["Z is up"]),
        (CONVERTED.replace("-90", "30").replace("1000", "1"), ["metersPerUnit", "Z is up"]),
    ],
)
def test_a_transform_converts_if_it_turns_the_axis_and_has_about_the_ratio(tmp_path, over, says):
    loaded = load(written(tmp_path, asset(), over))
    assert told(loaded) == [("asset-units", "Man")] * bool(says)
    assert [words for words in ("metersPerUnit", "Z is up") if any(words in p.message for p in loaded.problems)] == says


def test_a_prim_above_may_convert_and_what_converts_inside_is_not_asked_again(tmp_path):
    """A file in metres that references one in centimetres and scales it, below an Xform that converts metres."""
    (tmp_path / "inner.usda").write_text(
        asset(METRES.replace("metersPerUnit = 1", "metersPerUnit = 0.01")), encoding="utf-8"
    )
    inside = 'def Xform "In" (\nprepend references = @inner.usda@\n)\n{\n%s\n}'
    scaled = 'double3 xformOp:scale = (0.01, 0.01, 0.01)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    assert told(load(written(tmp_path, asset(beside=inside % scaled)))) == []
    path = written(tmp_path, asset(beside=inside % ""))
    assert told(load(path)) == [("asset-units", "In")]
    [problem] = load(path).problems
    assert problem.file.endswith("asset.usda") and "and 1 in " in problem.message
    assert problem.hint.endswith('xformOpOrder = ["xformOp:scale:unitsResolve"]')
    outer = f'{CONVERTED}\nover "In"\n{{\n{scaled}\n}}'
    assert told(load(written(tmp_path, asset(beside=inside % ""), outer))) == []


@pytest.mark.parametrize(("where", "part"), [("beside", 'def PlenSensor "S"\n{\n}'), ("body", "double plen:x = 1")])
def test_layers_with_parts_of_ours_and_sublayers_have_the_units_of_the_stage(tmp_path, where, part):
    codes = {problem.code for problem in load(written(tmp_path, asset(**{where: part}))).errors}
    assert {"layer-metersPerUnit", "layer-upAxis"} <= codes
    path = written(tmp_path, asset())
    path.write_text(path.read_text().replace("\n)\n", "\n    subLayers = [@asset.usda@]\n)\n", 1))
    assert {"layer-metersPerUnit", "layer-upAxis"} <= {problem.code for problem in load(path).errors}


def test_pictures_of_packages_are_read_even_of_one_in_another(tmp_path, monkeypatch):
    Image.fromarray(np.full((2, 2, 3), (255, 0, 51), np.uint8)).save(tmp_path / "p.png")
    (tmp_path / "man.usda").write_text(asset(body=BOUND, beside=PAINT % ("p.png", "")), encoding="utf-8")
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "man.usda"), str(tmp_path / "inner.usdz"))
    with Sdf.ZipFileWriter.CreateNew(str(tmp_path / "outer.usdz")) as package:
        (tmp_path / "top.usda").write_text(METRES + 'def Xform "Man" (\nprepend references = @inner.usdz@\n)\n{\n}\n')
        package.AddFile(str(tmp_path / "top.usda"), "top.usda")
        package.AddFile(str(tmp_path / "inner.usdz"), "inner.usdz")
    path = written(tmp_path, "")
    for name in ("inner.usdz", "outer.usdz"):
        path.write_text((STAGE % CONVERTED).replace("asset.usda", name), encoding="utf-8")
        loaded = load(path)
        assert told(loaded) == []
        [picture] = loaded.dataset.pictures
        assert (picture.suffix, b64decode(picture.encoded)) == (".png", (tmp_path / "p.png").read_bytes())
        assert str(tmp_path) not in loaded.flattened
        [surface] = loaded.dataset.occluders[0].finish.materials
        assert surface.diffuse_color.texture.name == picture.name
    monkeypatch.setenv("PIPELINE_LIMITS", "picture_bytes=20")
    assert told(load(path)) == [("file-size", "Paint.inputs:picture")]


@pytest.mark.parametrize(
    ("picture", "code"),
    [("away.png", "asset-missing"), ("t.<UDIM>.png", "asset-missing"), ("p.psd", "not-yet-supported")],
)
@pytest.mark.parametrize("fallback", ["", "float4 inputs:fallback = (1, 0.5, 0.25, 1)"])
def test_an_asset_without_its_picture_is_drawn_with_the_fallback(tmp_path, picture, code, fallback):
    """That of the texture if it has one, else those of UsdPreviewSurface."""
    (tmp_path / "p.psd").write_bytes(b"8BPS")
    loaded = load(written(tmp_path, asset(body=BOUND, beside=PAINT % (picture, fallback))))
    assert told(loaded) == [(code, "Paint.inputs:picture")]
    [surface] = loaded.dataset.occluders[0].finish.materials
    colour, roughness = ((1.0, 0.5, 0.25), (0.5,)) if fallback else ((0.18, 0.18, 0.18), (0.5,))
    assert (surface.diffuse_color.value, surface.roughness.value) == (colour, roughness)
    assert (surface.diffuse_color.texture, surface.roughness.texture) == (None, None)
    over = 'over "Paint"\n{\nasset inputs:picture = @also_away.png@\n}'
    path = written(tmp_path, asset(body=BOUND, beside=PAINT % (picture, fallback)), f"{CONVERTED}\n{over}")
    assert [problem.code for problem in load(path).errors] == ["asset-missing"], (
        "what the stage itself says is an error"
    )


@pytest.mark.parametrize(("samples", "codes"), [("1: @p.png@", []), ("1: @p.png@, 2: @q.png@", ["not-drawn"] * 2)])
def test_pictures_are_those_of_the_first_frame_in_the_space_of_their_interface(tmp_path, samples, codes):
    """Of a texture and of a sky; there are programs that write all values as samples."""
    for value, name in enumerate("pq"):
        Image.fromarray(np.full((2, 4, 3), value, np.uint8)).save(tmp_path / f"{name}.png")
    paint = (PAINT % ("p.png", "token inputs:sourceColorSpace.connect = </Man/Paint.inputs:space>")).replace(
        "asset inputs:picture = @p.png@",
        f'token inputs:space = "raw"\nasset inputs:picture.timeSamples = {{{samples}}}',
    )
    sky = f'def DomeLight "Sky"\n{{\nasset inputs:texture:file.timeSamples = {{{samples}}}\n}}'
    loaded = load(written(tmp_path, asset(own=sky, body=BOUND, beside=paint)))
    assert [code for code, _ in told(loaded)] == codes
    [surface], names = loaded.dataset.occluders[0].finish.materials, {entry.name for entry in loaded.dataset.pictures}
    assert {surface.diffuse_color.texture.name, loaded.dataset.lamps[1].lamp.texture} == names
    assert {entry.space for entry in loaded.dataset.pictures} == {"raw", "auto"}
    assert {b64decode(entry.encoded) for entry in loaded.dataset.pictures} == {(tmp_path / "p.png").read_bytes()}


def test_a_space_that_only_metadata_names_has_no_effect_and_a_warning(tmp_path):
    Image.fromarray(np.full((2, 2, 3), 9, np.uint8)).save(tmp_path / "p.png")
    own = "asset inputs:file.connect = </Man/Paint.inputs:picture>"
    for line, codes in (("", ["not-drawn"]), ('token inputs:sourceColorSpace = "raw"', [])):
        paint = (PAINT % ("p.png", line)).replace(own, 'asset inputs:file = @p.png@ (\ncolorSpace = "raw"\n)')
        assert [code for code, _ in told(load(written(tmp_path, asset(body=BOUND, beside=paint))))] == codes


@pytest.mark.parametrize("depth", [8, 16])
def test_deep_colours_keep_their_bits_and_are_linear(tmp_path, depth):
    """USD's rule for `auto`: 8 bits of colour are sRGB, 16 are not."""
    values = np.array([25700, 40001, 65535]) >> (16 - depth)
    picture = values[None, None, ::-1].astype(np.uint8 if depth == 8 else np.uint16)
    pixel = decoded(cv2.imencode(".png", picture)[1].tobytes(), ".png", "auto")[0, 0]
    share = values / (2**depth - 1)
    assert pixel == pytest.approx([*(share if depth == 16 else ((share + 0.055) / 1.055) ** 2.4), 1], abs=SINGLE)


@pytest.mark.parametrize(("space", "light"), [("auto", [0.5, 2.0, 0.25]), ("sRGB", [0.214041, 4.953846, 0.050876])])
def test_pictures_of_floats_are_linear_unless_their_texture_says_that_they_are_not(space, light):
    """sRGB's curve by colour-science's `eotf_sRGB`."""
    content = cv2.imencode(".hdr", np.full((2, 9, 3), (0.25, 2.0, 0.5), np.float32))[1].tobytes()
    assert decoded(content, ".hdr", space)[0, 0] == pytest.approx([*light, 1], rel=1e-5)


def test_pictures_of_radiance_are_read_and_their_size_first(monkeypatch):
    content = cv2.imencode(".hdr", np.full((3, 2, 3), (1.0, 8.0, 16.0), np.float32))[1].tobytes()
    assert decoded(content, ".hdr", "auto") == pytest.approx(np.full((3, 2, 4), (16.0, 8.0, 1.0, 1.0)))
    for bad, what in ((content[:30], "no Radiance HDR"), (b"#?RADIANCE\n\n-Y 9999999 +X 9999999\n", "may have")):
        with pytest.raises(PipelineError, match=what):
            decoded(bad, ".hdr", "auto")


@pytest.mark.parametrize(("mode", "hole"), [("L", 64), ("RGB", (64, 0, 9))])
def test_a_colour_that_stands_for_holes_is_transparent(tmp_path, mode, hole):
    """tRNS of a PNG, beside a pixel of another colour."""
    picture = Image.new(mode, (2, 1))
    picture.putpixel((0, 0), hole)
    picture.save(tmp_path / "key.png", transparency=hole)
    assert decoded((tmp_path / "key.png").read_bytes(), ".png", "raw")[0, :, 3].tolist() == [0, 1]


@pytest.mark.parametrize(("fourth", "opacity"), [([0, 51], [0, 51]), ([0, 0], [255, 255])])
def test_the_fourth_components_of_a_bmp_are_opacity_unless_all_are_zero(tmp_path, fourth, opacity):
    """As USD's own reader has it, in both orders of rows."""
    Image.fromarray(np.array([[[9, 8, 7, each]] for each in fourth], np.uint8)).save(tmp_path / "p.bmp")
    content = (tmp_path / "p.bmp").read_bytes()
    flipped = content[:22] + (-2).to_bytes(4, "little", signed=True) + content[26:]  # the height, below zero
    for rows, picture in ((1, content), (-1, flipped)):
        pixels = decoded(picture, ".bmp", "raw")[::rows, 0] * 255
        assert pixels == pytest.approx(np.array([(9, 8, 7, each) for each in opacity]), abs=SINGLE)


def test_halves_that_are_infinite_are_refused(tmp_path):
    """Suns of skies are, where the file has half precision."""
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Y": np.array([[1.0, np.inf]], np.float16)}).write(str(tmp_path / "sun.exr"))
    with pytest.raises(PipelineError, match="1 numbers that are not finite"):
        decoded((tmp_path / "sun.exr").read_bytes(), ".exr", "auto")


MOVED = """double xformOp:rotateY = 30
uniform token[] xformOpOrder = ["xformOp:rotateY"]"""


@pytest.mark.parametrize("beside", ["", 'def PlenChannel "Ours"\n{\n}'])
def test_an_order_of_the_stage_leaves_out_what_a_weaker_file_moves(tmp_path, beside):
    """Whether that is of others, or has a part of ours."""
    over = 'double3 xformOp:scale = (1, 1, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    errors = load(written(tmp_path, asset(head("Man"), own=MOVED, beside=beside), over)).errors
    assert "unused-xform-op" not in [error.code for error in errors]


@pytest.mark.parametrize("own", ["", MOVED])
def test_an_op_of_the_stage_that_no_order_names_is_an_error(tmp_path, own):
    """Whether the order is missing, or that of the asset, which the stage would have to replace."""
    [error] = load(written(tmp_path, asset(own=own), "double3 xformOp:scale = (1000, 1000, 1000)")).errors
    assert (error.code, error.at) == ("unused-xform-op", "/Scene/Man.xformOp:scale")


CUSTOMS = """string unity:shaderName = "Standard"
        float3[] extentsHint = [(0, 0, 0), (1, 1, 1)]
        asset sound:file = @beep.wav@
        token exporter:kind = "x"
        custom string note = "a\tb"
"""


@pytest.mark.parametrize("where", ["asset", "stage"])
def test_what_programs_add_for_themselves_is_no_error(tmp_path, where):
    (tmp_path / "beep.wav").write_bytes(b"")
    own, over = (CUSTOMS, CONVERTED) if where == "asset" else ("", f"{CONVERTED}\n{CUSTOMS}")
    meta, more = 'prepend apiSchemas = ["OmniThingAPI"]', 'def OmniSound "Sound"\n{\n}'
    loaded = load(written(tmp_path, asset(meta=meta, own=own, beside=more), over))
    assert told(loaded) == [("unknown-type", "Sound")]
    assert str(tmp_path) not in loaded.flattened


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("bool doublesided = 1", "unknown-property"),
        ("double plen:radianc = 1", "unknown-property"),
        ("token visibility = 'hidden'", "bad-token"),
        ("rel material:binding = </Scene/Nothing>", "missing-target"),
        ('int3 xformOp:scale = (2, 2, 2)\nuniform token[] xformOpOrder = ["xformOp:scale"]', "unreadable-value"),
    ],
)
def test_what_the_stage_misspells_is_an_error(tmp_path, line, code):
    over = f'{CONVERTED}\nover "Body"\n{{\n{line}\n}}'
    assert [error.code for error in load(written(tmp_path, asset(), over)).errors] == [code]


LAMPS = 'def SphereLight "Point"\n{\n%s\n}\ndef SphereLight "Ball"\n{\n}'


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("float inputs:radius = 0", "lamp-size"),
        ("float inputs:radius = -1", "unreadable-value"),
        ("float inputs:exposure = 300", "unreadable-value"),
    ],
)
def test_a_lamp_of_others_that_cannot_shine_is_left_out(tmp_path, line, code):
    """Beside one that shines."""
    loaded = load(written(tmp_path, asset(own=LAMPS % line), CONVERTED))
    assert [kind for kind, _ in told(loaded)] == [code]
    assert [entry.prim_path for entry in loaded.dataset.lamps] == ["/Scene/Sky", "/Scene/Man/Ball"]


@pytest.mark.parametrize(
    ("line", "light"),
    [("color3f inputs:color = (1, 1, -0.25)", (1, 1, 0)), ("float inputs:intensity = -2", (0, 0, 0))],
)
def test_light_below_zero_counts_as_none(tmp_path, line, light):
    loaded = load(written(tmp_path, asset(own=LAMPS % line), CONVERTED))
    assert told(loaded) == [("not-drawn", "Point")]
    assert loaded.dataset.lamps[1].lamp.radiance == light


@pytest.mark.parametrize(
    ("line", "is_colour"),
    [
        ("asset inputs:file = @@\nfloat4 inputs:fallback = (1, 0.5, 0.25, 1)", False),
        ('token inputs:wrapS = "Repeat"\nfloat inputs:scale = 2', True),
    ],
)
def test_inputs_of_others_that_mean_nothing_count_as_not_written(tmp_path, line, is_colour):
    """Each with a warning; a texture without a file is its fallback."""
    paint = (PAINT % ("p.png", line)).replace(
        "asset inputs:file.connect = </Man/Paint.inputs:picture>" * ("file" in line), ""
    )
    Image.fromarray(np.full((2, 2, 3), 9, np.uint8)).save(tmp_path / "p.png")
    loaded = load(written(tmp_path, asset(body=BOUND, beside=paint)))
    assert len(told(loaded)) == 2
    [surface] = loaded.dataset.occluders[0].finish.materials
    texture = surface.diffuse_color.texture
    assert (texture is not None) is is_colour
    assert is_colour or (surface.diffuse_color.value, surface.roughness.value) == ((1, 0.5, 0.25), (0.5,))
    assert not texture or (texture.scale, texture.wrap) == ((1, 1, 1, 1), ("black", "black"))


@pytest.mark.parametrize(
    ("where", "line", "code"),
    [
        ("body", "bool doublesided = 1", "unknown-property"),
        ("body", "token visibility = 'hidden'", "bad-token"),
        ("body", "normal3d[] normals = [(0, 0, 1)]", "wrong-type"),
        (
            "beside",
            'def Mesh "Odd"\n{\nfloat subdivisionScheme = 1\nint[] faceVertexCounts = [3]\n'
            "int[] faceVertexIndices = [0, 1, 2]\npoint3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n}",
            "wrong-type",
        ),
        ("body", "float3[] extent = [(inf, 0, 0), (1, 1, nan)]", "not-finite"),
        ("body", "rel material:binding = </Man/Nothing>", "missing-target"),
        ("own", 'uniform token[] xformOpOrder = ["xformOp:gone"]', "missing-xform-op"),
        ("own", 'double3 xformOp:scale = (nan, 1, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]', "not-finite"),
        (
            "own",
            "matrix4d xformOp:transform = ((1, 0, 0, 2), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))\n"
            'uniform token[] xformOpOrder = ["xformOp:transform"]',
            "not-affine",
        ),
        (
            "own",  # as products of matrices leave it
            "matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1.0000000000000002))\n"
            'uniform token[] xformOpOrder = ["xformOp:transform"]',
            None,
        ),
        ("own", 'int3 xformOp:scale = (2, 2, 2)\nuniform token[] xformOpOrder = ["xformOp:scale"]', "unreadable-value"),
        (
            "own",
            'float4 xformOp:orient = (1, 0, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:orient"]',
            "unreadable-value",
        ),
        (
            "own",
            'float xformOp:foo = 1\nuniform token[] xformOpOrder = ["xformOp:foo", "", "radius"]',
            "missing-xform-op",
        ),
        ("beside", 'def Cone "Odd"\n{\nuniform token axis = "W"\n}', "bad-token"),
        ("own", 'custom rel xformOp:scale\nuniform token[] xformOpOrder = ["xformOp:scale"]', "missing-xform-op"),
        ("meta", "prepend references = @gone.usda@", "usd-invalid-asset-path"),
        ("meta", "prepend payload = @./asset.usda@</Gone>", "usd-unresolved-prim-path"),
        ("meta", 'variants = {\nstring look = "red"\n}\nprepend variantSets = "look"', "unknown-variant"),
        ("beside", 'over "Gone"\n{\n}', None),
        ("beside", 'def SpatialAudio "Beep"\n{\nuniform asset filePath = @beep.wav@\n}', None),
        ("beside", 'def Camera "View"\n{\nfloat focalLength = 50\n}', None),
        ("body", "float3[] primvars:displayColor = [(1, 0, 0)]", None),
        ("meta", 'variants = {\nstring look = "red"\n}', None),
        ("meta", 'kind = "strange"', None),
    ],
)
def test_what_an_asset_has_wrong_is_a_warning_at_most_and_the_rest_is_drawn(tmp_path, where, line, code):
    """No error, because only its author could mend it; the body is in the images all the same."""
    top, over = (head("Man"), "") if where == "own" else (METRES, CONVERTED)
    path = written(tmp_path, asset(top, **{where: line}), over)
    loaded = load(path)
    assert {kind for kind, _ in told(loaded)} == ({code} if code else set())
    drawn = [entry.prim_path for entry in loaded.dataset.occluders]
    assert "/Scene/Man/Body" in drawn and np.isfinite(list(loaded.dataset.frames[0].world_from_occluder.values())).all()


def test_clips_move_a_thing_as_USD_says(tmp_path):
    (tmp_path / "clip.usda").write_text(
        '#usda 1.0\ndef "Man"\n{\ndouble3 xformOp:translate.timeSamples = {\n1: (1, 0, 0),\n3: (5, 0, 0)\n}\n}\n'
    )
    clips = """clips = {
        dictionary default = {
            asset[] assetPaths = [@./clip.usda@]
            asset manifestAssetPath = @./clip.usda@
            string primPath = "/Man"
            double2[] active = [(0, 0)]
            double2[] times = [(0, 0), (10, 10)]
        }
    }"""
    own = 'double3 xformOp:translate\nuniform token[] xformOpOrder = ["xformOp:translate"]'
    path = written(tmp_path, asset(head("Man"), meta=clips, own=own), "")
    path.write_text(path.read_text().replace("endTimeCode = 1", "endTimeCode = 3"))
    loaded = load(path)
    assert told(loaded) == []
    assert [frame.world_from_occluder["/Scene/Man/Body"][0][3] for frame in loaded.dataset.frames] == [1, 3, 5]


def test_splines_move_a_thing_as_USD_says(tmp_path):
    """A line from 0 to 90 degrees, with a value in every frame."""
    spline = "double xformOp:rotateY.spline = {\n1: 0; post linear,\n3: 90,\n}"
    path = written(
        tmp_path, asset(head("Man"), own=f'{spline}\nuniform token[] xformOpOrder = ["xformOp:rotateY"]'), ""
    )
    path.write_text(path.read_text().replace("endTimeCode = 1", "endTimeCode = 3"))
    loaded = load(path)
    assert told(loaded) == []
    turned = [frame.world_from_occluder["/Scene/Man/Body"][0][:3:2] for frame in loaded.dataset.frames]
    assert np.allclose(turned, [(1, 0), (0.5**0.5, 0.5**0.5), (0, 1)], rtol=0, atol=SINGLE)


@pytest.mark.parametrize(
    ("line", "drawn"),
    [
        ('uniform token purpose = "render"', True),
        ('uniform token purpose = "guide"', False),
        ('uniform token purpose = "proxy"', False),
        ('token visibility = "invisible"', False),
        ('token visibility.timeSamples = {\n1: "inherited", 2: "invisible"\n}', True),
    ],
)
def test_purpose_and_visibility_of_an_asset_decide(tmp_path, line, drawn):
    loaded = load(written(tmp_path, asset(own=line)))
    assert told(loaded) == []
    assert ("/Scene/Man/Body" in loaded.dataset.frames[0].world_from_occluder) is drawn


def test_classes_and_inactive_prims_are_not_drawn_and_nothing_is_asked_of_them(tmp_path):
    bad = 'def Mesh "Bad"\n{\npoint3f[] points = [(nan, 0, 0)]\n}\nclass Mesh "_Kind"\n{\n}'
    path = written(tmp_path, asset(beside=bad), f'{CONVERTED}\nover "Bad" (\nactive = false\n)\n{{\n}}')
    loaded = load(path)
    assert told(loaded) == []
    assert [entry.prim_path for entry in loaded.dataset.occluders] == ["/Scene/Man/Body"]


FEW = 'color3f[] primvars:displayColor = [(0, 0, 0), (1, 1, 1)] (interpolation = "vertex")'
ROBOT = '''prepend apiSchemas = ["PhysxArticulationAPI", "SemanticsAPI:x", "CollectionAPI"]
    variants = { string look = "away" }
    prepend variantSets = "look"'''
JOINTS = """float physics:linearVelocity = inf
    rel physics:body0 = </Man/Away>
    float drive:angular:physics:maxForce = -inf
    string physics:axis = "Q"
    rel proxyPrim = </Man/Away>
    def NewtonActuator "Motor" { }
    def PhysicsRevoluteJoint "Joint" {
    point3f physics:localPos0 = (nan, 0, 0)
    }
    def RenderSettings "Settings" {
    rel camera = </Man/Away>
    }
    variantSet "look" = { "near" { } }"""


@pytest.mark.parametrize("kind", ["Xform", "Xfrom", "MadeElsewhere"])
def test_what_a_file_says_of_its_root_is_as_little_an_error_as_below_it(tmp_path, kind):
    """Schemas of other programs and physics are silent; a type and a variant that are missing are told at its line."""
    man = asset(head("Man"), meta=ROBOT, own=JOINTS).replace('def Xform "Man"', f'def {kind} "Man"')
    inside = f'{head("Man")}def Xform "Man" {{{man.removeprefix(head("Man")).replace("/Man/", "/Man/Man/")}}}'
    lines = []
    for text in (man, inside):
        loaded = load(untyped(written(tmp_path, text, "")))
        codes = ["unknown-variant"] if kind == "Xform" else ["unknown-type", "unknown-variant"]
        assert [code for code, _ in told(loaded)] == codes
        assert {Path(problem.file).name for problem in loaded.problems} == {"asset.usda"}
        lines.append([problem.line for problem in loaded.problems])
    assert lines[0] == lines[1]


def test_a_lamp_of_others_that_cannot_shine_is_left_out_also_as_the_root(tmp_path):
    loaded = load(
        untyped(written(tmp_path, head("Man") + 'def SphereLight "Man"\n{\nfloat inputs:radius = 0\n}\n', ""))
    )
    assert told(loaded) == [("lamp-size", "Man")]
    assert [lamp.prim_path for lamp in loaded.dataset.lamps] == ["/Scene/Sky"]


@pytest.mark.parametrize(
    "many",
    [
        'def PointInstancer "Crowd"\n{\nint[] protoIndices = [0, 0, 0]\nrel prototypes = </Man/Many/Crowd/One>\n'
        "point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]\n"
        'def "One" (references = </Man/Away>)\n{\n}\n}',
        "".join(f'def "Man{k}" (\ninstanceable = true\nreferences = </Man/Away>\n)\n{{\n}}\n' for k in range(3)),
    ],
    ids=["point instancer", "instances"],
)
def test_instances_are_told_of_once_per_line(tmp_path, many):
    body = mesh_text("Body", [(0, 0, 0), (0.4, 0, 0), (0, 0, 1.8)], "rel material:binding = </Paint>", FEW)
    thing = f'class Xform "Away"\n{{{body}'
    wrong = thing + 'def Sphere "Dot"\n{\ndouble radius = -1\ntoken purpose = "rendr"\n}\n}\n'
    loaded = load(written(tmp_path, asset(beside=f'{wrong}def "Many"\n{{\n{many}\n}}')))
    places = [(problem.code, problem.line) for problem in loaded.problems]
    assert loaded.errors == [] and len(places) == len(set(places))
    assert {"outside-reference", "bad-token", "not-drawn", "not-in-image"} == {code for code, _ in places}
    [beside] = [problem for problem in loaded.problems if problem.code == "outside-reference"]
    assert "(the same at" in beside.message


def test_a_material_outside_of_the_referenced_prim_is_named_and_the_hint_brings_it(tmp_path):
    paint = (PAINT % ("p.png", "")).replace("/Man/Paint", "/Paint").replace("color3f inputs:diffuseColor.connect", "#")
    man = asset(body="rel material:binding = </Paint>") + paint.replace(
        "float2 inputs", "color3f inputs:diffuseColor = (1, 0, 0)\n#"
    )
    Image.fromarray(np.full((2, 2, 3), 255, np.uint8)).save(tmp_path / "p.png")
    path = written(tmp_path, man)
    loaded = load(path)
    assert told(loaded) == [("outside-reference", "Body.material:binding")]
    [problem] = loaded.problems
    assert "</Paint>" in problem.message and problem.file.endswith("asset.usda")
    assert loaded.dataset.occluders[0].finish.materials[0].diffuse_color.value == (0.18, 0.18, 0.18)
    prim = re.search(r'def "Paint" \(references = @\S+@</Paint>\)', problem.hint)[0]
    over = f'{CONVERTED}\nover "Body"\n{{\nrel material:binding = </Scene/Man/Paint>\n}}\n{prim} {{ }}'
    path = written(tmp_path, man, over)
    assert not {code for code, _ in told(load(path))} & {"outside-reference", "missing-target"}
    assert load(path).dataset.occluders[0].finish.materials[0].diffuse_color.texture is None


@pytest.mark.parametrize(
    ("kind", "codes", "z_mm"), [("", [], 0.5), ("SkelRoot", [], 0.5), ("Xform", ["not-drawn"], 0.0)]
)
def test_a_SkelRoot_that_another_type_covers_is_told_of(tmp_path, kind, codes, z_mm):
    man = ARM.replace("/Scene/Things/Hero", "/Man").replace("Hero", "Man")
    loaded = load(untyped(written(tmp_path, head("Man") + man, ""), kind))
    assert [code for code, _ in told(loaded)] == codes
    assert loaded.dataset.occluders[0].occluder.vertices_mm[0][2] == pytest.approx(z_mm)
    for problem in loaded.problems:
        assert 'def "Man"' in problem.hint and problem.file.endswith("dataset.usda")
