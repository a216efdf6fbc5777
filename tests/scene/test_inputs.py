"""What a stage names or states that cannot be used: `check` says so with a place, and opens nothing that it may not."""

import signal
from contextlib import contextmanager
from pathlib import Path

import pytest
from hostile.attempt import write
from hostile.scenes import SCENES
from hostile.values import Attempt
from pxr import Gf, Sdf, UsdSkel, Vt
from stage_text import stage_in

import pipeline
from pipeline import cli
from pipeline.app.verify import verify
from pipeline.scene.load import load
from pipeline.scene.usd.problems import Problem

NAMED = {
    "fifo.png": "file-kind",
    "folder.png": "file-kind",
    "device.png": "asset-outside",
    "outside.png": "asset-outside",
    "nowhere.png": "asset-missing",
    "other.tif": "not-yet-supported",
    **dict.fromkeys(("text.png", "vast.png", "empty.exr", "flipped.exr", "wrong.exr"), "bad-picture"),
    **dict.fromkeys(("nan.exr", "inf.exr"), "bad-picture"),
}
"""Files, which `hostile.pictures` makes, and what is wrong with them."""
FILE_OF = {"painted": ("Paint/Picture", "inputs:file"), "sky": ("Lamp", "inputs:texture:file")}


WAITS_S = 60
"""Who opens a FIFO waits for ever [s]; what is compiled is compiled before this counts."""


@contextmanager
def waiting_for_no_file():
    def late(*_):
        pytest.fail("waits for a file")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(WAITS_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def with_picture(folder: Path, scene: str, file: str) -> Path:
    at, name = FILE_OF["sky" if scene == "sky" else "painted"]
    return write(Attempt(scene, at, name, "asset", Sdf.AssetPath(f"./{file}")), folder)


def the_error(folder: Path, path: Path, allow: tuple[str, ...] = ()) -> Problem:
    (error,) = load(path, allow, look=True).errors
    assert error.file and error.line and error.at
    return error


@pytest.mark.parametrize("scene", ["painted", "painted without lamps", "sky"])
def test_a_picture_that_cannot_be_used_is_told_once_and_with_a_place(scene, tmp_path):
    assert load(with_picture(tmp_path, scene, "grey.exr"), look=True).errors == []
    with waiting_for_no_file():
        for file, code in NAMED.items():
            error = the_error(tmp_path, with_picture(tmp_path, scene, file))
            assert (error.code, f"@./{file}@" in error.message) == (code, True), str(error)
        assert the_error(tmp_path, with_picture(tmp_path, scene, "device.png"), ("/",)).code == "file-kind"


def test_a_sky_shines_no_negative_light_and_a_picture_is_no_larger_than_the_limits(tmp_path, monkeypatch):
    assert load(with_picture(tmp_path, "painted", "negative.exr")).errors == []
    assert "-1 to 0.5" in the_error(tmp_path, with_picture(tmp_path, "sky", "negative.exr")).message
    for limit, code in (("picture_bytes=20", "file-size"), ("picture_pixels=15", "bad-picture")):
        monkeypatch.setenv("PIPELINE_LIMITS", limit)
        error = the_error(tmp_path, with_picture(tmp_path, "painted", "picture.png"))
        assert error.code == code and limit.split("=")[0] in error.hint


def test_a_delivered_stage_has_its_pictures_with_lamps_and_without(tmp_path, common_store, monkeypatch):
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    for scene, file in (("painted without lamps", "picture.png"), ("sky", "grey.exr")):
        out = tmp_path / scene
        result = pipeline.build(with_picture(tmp_path, scene, file), out, jobs=1)
        assert result.exit_code == 0 and load(out / "dataset.usda").errors == []
        assert verify(out).agrees


@pytest.mark.parametrize(
    ("at", "name", "kind", "value", "word"),
    [
        ("Picture", "wrapT", "token", "1 K", "clamp"),
        ("Surface", "roughness", "token[]", Vt.TokenArray(["x"]), "1 in"),
        ("Surface", "diffuseColor", "float2", Gf.Vec2f(1, 1), "3 in"),
        ("Surface", "ior", "float", -1.0, "[0, 1000]"),
        ("Turn", "scale", "float2", Gf.Vec2f(float("inf"), 1), "2 in"),
        ("Reader", "varname", "float", 1.0, "a text"),
    ],
)
def test_an_input_of_a_material_is_what_its_shader_declares(at, name, kind, value, word, tmp_path):
    stage = SCENES["painted"].stage()
    spec = stage.GetRootLayer().GetPrimAtPath(f"/Scene/Paint/{at}")
    for prop in [one for one in spec.properties if one.name == f"inputs:{name}"]:
        del spec.properties[prop.name]
    Sdf.AttributeSpec(spec, f"inputs:{name}", Sdf.ValueTypeNames.Find(kind)).default = value
    path = with_picture(tmp_path, "painted", "picture.png")
    path.write_text(stage.GetRootLayer().ExportToString())
    error = the_error(tmp_path, path)
    assert error.at == f"/Scene/Paint/{at}.inputs:{name}" and word in error.message


def test_a_mesh_that_a_skeleton_should_move_and_cannot_is_a_warning(tmp_path):
    stage = SCENES["lit"].stage()
    layer, path = stage.GetRootLayer(), tmp_path / "dataset.usda"
    hero = stage.DefinePrim("/Scene/Hero", "SkelRoot")
    Sdf.CopySpec(layer, "/Scene/Screen", layer, "/Scene/Hero/Skin")
    skin = UsdSkel.BindingAPI.Apply(stage.GetPrimAtPath(hero.GetPath().AppendChild("Skin")))
    skin.CreateJointIndicesPrimvar(False, 1).Set([0, 0, 0])
    path.write_text(layer.ExportToString())
    loaded = load(path)
    (warning,) = [one for one in loaded.problems if one.at == "/Scene/Hero/Skin"]
    assert not loaded.errors and warning.code == "not-drawn" and "modelled" in warning.message


def test_an_export_that_relates_cameras_is_refused_for_one(tmp_path):
    asked = Attempt("exports", "", "plen:exports", "token[]", Vt.TokenArray(["opencv-multiview"]))
    error = the_error(tmp_path, write(asked, tmp_path))
    assert error.code == "export-cameras" and "the dataset has 1" in error.message


@pytest.mark.parametrize(
    ("names", "codes"),
    [(("Red", "Green", "B"), []), (("Red", "Infrared"), ["colour-filters"]), (("Red", "R"), ["name-collision"])],
)
def test_channels_are_called_by_their_colours_in_any_case(names, codes, tmp_path):
    stage = SCENES["raw images"].stage()
    for name in names:
        channel = stage.DefinePrim(f"/Scene/Sensor/{name}", "PlenChannel")
        channel.GetAttribute("plen:wavelengths").Set([500.0, 600.0])
        channel.GetAttribute("plen:response").Set([1.0, 1.0])
    sensor = stage.GetPrimAtPath("/Scene/Sensor")
    sensor.GetAttribute("plen:response:filters").Set([*names, "Red", "Red"][:4])
    sensor.GetAttribute("plen:response:quantumEfficiency").Set([0.5] * len(names))
    stage.GetPrimAtPath("/Scene/Lens").GetAttribute("plen:indexSource").Set("catalogue")
    stage.GetPrimAtPath("/Scene/Lens/Front").GetAttribute("plen:glass").Set("schott:N-BK7")
    assert [one.code for one in load(stage_in(tmp_path, stage.GetRootLayer().ExportToString())).errors] == codes


def test_the_name_of_a_stage_reaches_no_terminal_as_it_is(tmp_path, monkeypatch, capfd):
    """Nor what USD itself has to say of its values."""
    for odd in (None, Attempt("painted", "Paint/Reader", "info:implementationSource", "token", "a\x1b[31m")):
        path = write(odd or Attempt("conventional", "Board", "plen:rows", "int", 4), tmp_path)
        monkeypatch.setattr("sys.argv", ["pipeline", "check", str(path.rename(tmp_path / "e\x1b[31m.usda"))])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == (2 if odd else 0)
        assert "\x1b" not in "".join(capfd.readouterr())


def test_a_lamp_that_leaves_out_what_its_collections_say_is_told_to_light_everything(tmp_path):
    for link in ("light", "shadow"):
        name = f"collection:{link}Link:includeRoot"
        loaded = load(write(Attempt("lit", "Lamp", name, "bool", False), tmp_path))
        assert [(one.code, one.at) for one in loaded.problems] == [("not-drawn", f"/Scene/Lamp.{name}")]
