"""The command `pipeline fit`, and the layer that it writes for renderers with other schemas."""

import json
import subprocess
import sys
from functools import partial

import cv2
import numpy as np
import pytest
from builds import DATA
from pxr import Usd, UsdGeom

from pipeline.frames import apply
from pipeline.scene.load import load
from pipeline.scene.usd.values import LENS_DISTORTION

STAGE = DATA / "tiny_conventional/dataset.usda"
SINGLE = 1e-6
"""Single precision of attributes [relative], somewhat rounded up."""


@pytest.fixture
def command(tmp_path, monkeypatch, in_this_process):
    """Run the command in an empty folder: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    return partial(in_this_process, "fit")


@pytest.fixture(scope="module")
def layer(tmp_path_factory):
    from pipeline.plugins.fits.fit_camera import fit

    path = tmp_path_factory.mktemp("layer") / "seen.usda"
    found = fit(STAGE, None, ["brown", "fisheye", "kannala-brandt", "ftheta", "tilted"])
    found.layer(path)
    return path, found


def attributes(prim: Usd.Prim, word: str) -> dict:
    prefix = f"omni:lensdistortion:{word}:"
    return {a.GetName().removeprefix(prefix): a.Get() for a in prim.GetAttributes() if a.GetName().startswith(prefix)}


def test_the_schemas_stand_beside_ours_and_hold_the_fits(layer):
    path, found = layer
    stage = Usd.Stage.Open(str(path))
    camera = stage.GetPrimAtPath("/TinyConventional/Rig/Camera")
    names = [str(name) for name in camera.GetMetadata("apiSchemas").GetAppliedItems()]
    assert set(names) & LENS_DISTORTION == {
        f"OmniLensDistortion{name}API" for name in ("OpenCvPinhole", "OpenCvFisheye", "KannalaBrandtK3", "Ftheta")
    }
    fits = {fit.model.name: fit.values for fit in found.camera.fits}
    for model, word in (
        ("brown", "opencvPinhole"),
        ("fisheye", "opencvFisheye"),
        ("kannala-brandt", "kannalaBrandtK3"),
    ):
        held = attributes(camera, word)
        for name in set(held) & set(fits[model]) - {"cx", "cy"}:
            assert held[name] == pytest.approx(fits[model][name], rel=SINGLE), (model, name)
    pinhole, ftheta = attributes(camera, "opencvPinhole"), attributes(camera, "ftheta")
    assert tuple(pinhole["imageSize"]) == (32, 24) and (ftheta["nominalWidth"], ftheta["nominalHeight"]) == (32, 24)
    assert (pinhole["k4"], pinhole["s4"], ftheta["k0"]) == (0, 0, 0)
    # The axis meets the middle of the image, which has the number 16 where pixels count from their corner.
    assert (pinhole["cx"], pinhole["cy"]) == pytest.approx((16, 12)) == tuple(ftheta["opticalCenter"])
    assert ftheta["maxFov"] == pytest.approx(2 * 1.05 * found.camera.pupil.angle_deg.max(), rel=SINGLE)


def test_through_the_child_camera_points_fall_where_the_truth_has_them(layer):
    """From the composed stage alone: world, transform of the camera, OpenCV's projection, half a pixel."""
    path, found = layer
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetPrimAtPath("/TinyConventional/Rig/Camera/Pinhole")
    assert prim.GetAttribute("omni:lensdistortion:model").Get() in ("opencvPinhole", "opencvFisheye", "kannalaBrandtK3")
    parent = stage.GetPrimAtPath("/TinyConventional/Rig/Camera")
    word = attributes(parent, "opencvPinhole")
    z_mm = found.camera.field.planes_mm[0]
    seen = found.camera.field.points(z_mm) * [1, -1, -1]  # of the vision frame, in that of a USD camera
    to_world = np.array(UsdGeom.Xformable(parent).ComputeLocalToWorldTransform(1)).T
    from_world = np.linalg.inv(np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(1)).T)
    points = apply(from_world, apply(to_world, seen)) * [1, -1, -1]
    matrix = np.array([[word["fx"], 0, word["cx"] - 0.5], [0, word["fy"], word["cy"] - 0.5], [0, 0, 1]])
    coefficients = np.array([word[name] for name in ("k1", "k2", "p1", "p2", "k3")])
    pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, coefficients)[0][:, 0]
    most = max(fit.max_px for fit in found.camera.fits)
    assert np.hypot(*(pixels - found.camera.field.x_px).T).max() < most + 32 * SINGLE
    aperture = UsdGeom.Camera(prim).GetHorizontalApertureAttr().Get() / UsdGeom.Camera(prim).GetFocalLengthAttr().Get()
    assert aperture * found.camera.field.start[0] == pytest.approx(32, rel=SINGLE)


def test_tables_are_accepted_of_the_schemas_of_a_camera_alone(tmp_path):
    """As Omniverse writes them, without "custom"; a missing table is told, and what nothing reads is not."""
    (tmp_path / "enter.exr").write_bytes(b"")
    table = "asset omni:lensdistortion:lut:rayEnterDirectionTexture = @./{}@"
    applied = '(prepend apiSchemas = ["OmniLensDistortionLutAPI"])'
    prims = {
        f'Camera "Good" {applied}': table.format("enter.exr"),
        f'Camera "Missing" {applied}': table.format("enterr.exr"),
        'Camera "Lone"': table.format("enter.exr"),
        'Xform "Other"': f"custom {table.format('enter.exr')}",
    }
    text = '#usda 1.0\n(\n    metersPerUnit = 0.001\n    upAxis = "Y"\n)\n'
    text += "".join(f"def {prim}\n{{\n    {attribute}\n}}\n" for prim, attribute in prims.items())
    (tmp_path / "stage.usda").write_text(text)
    told = {(error.code, error.at.partition(".")[0]) for error in load(tmp_path / "stage.usda").errors}
    assert told == {("asset-missing", "/Missing")}


def test_nothing_of_ours_changes(layer):
    path, _ = layer
    over = load(path, [DATA.parents[1]])
    assert over.errors == [] and over.dataset == load(STAGE).dataset


def test_a_misspelt_schema_is_still_told(layer, tmp_path):
    text = layer[0].read_text().replace("OmniLensDistortionFthetaAPI", "OmniLensDistortionFtetaAPI")
    (tmp_path / "wrong.usda").write_text(text)
    (error,) = [
        e for e in load(tmp_path / "wrong.usda", [DATA.parents[1], layer[0].parent]).errors if e.code == "unknown-api"
    ]
    assert "OmniLensDistortionFthetaAPI" in error.hint


def test_the_command_prints_the_largest_residual_of_the_field(command):
    code, said, _ = command(STAGE, "--model", "brown,pinhole", "--json")
    (brown, _) = json.loads(said)["models"]
    field = np.array([brown["field"]["near_px"], brown["field"]["far_px"]])
    code, said, told = command(STAGE, "-m", "brown", "--plot", "fit.svg", "-o", "seen.usda")
    line = next(line for line in said.splitlines() if line.startswith("brown "))
    assert code == 0 and float(line.split()[2]) == float(f"{np.linalg.norm(field, axis=-1).max():.3e}")
    assert told.split() == ["wrote", "fit.svg", "wrote", "seen.usda"]
    assert "entrance pupil" in said and "at other distances" in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([STAGE, "-m", "bronw"], 'did you mean "brown"?'),
        ([STAGE, "Rig.Camra"], 'did you mean "Rig.Camera"?'),
        ([STAGE, "-o", "seen.usd"], "must end in .usda"),
        ([STAGE, "--plot", "seen.png"], "is no .svg file"),
        ([STAGE, "-m", "tilted", "-o", "seen.usda"], "no schema of Omniverse has these models"),
        (["."], "it has no manifest.json"),
    ],
)
def test_what_is_wrong_is_named_and_nothing_is_written(command, tmp_path, arguments, said):
    code, _, told = command(*arguments)
    assert code == 2 and said in told and list(tmp_path.iterdir()) == []


def test_the_list_has_the_models_and_needs_no_solver():
    program = "import sys; sys.argv[1:] = ['fit', '--list']; from pipeline import cli\ntry: cli.main()\n"
    program += "except SystemExit: print('scipy' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert "brown" in shown and "thin-lens-plenoptic" in shown and shown.endswith("False\n")


def test_a_plenoptic_camera_without_a_thin_lens_still_has_a_pinhole(command, monkeypatch):
    from pipeline.fits.field import FitError
    from pipeline.plugins.fits import result

    def fails(camera):
        raise FitError("too few positions")

    monkeypatch.setattr(result, "thin_plenoptic", fails)
    code, said, told = command(DATA / "tiny_plenoptic/dataset.usda")
    assert code == 0 and "brown " in said and "no thin lens before pinholes: too few positions" in told
    code, _, told = command(DATA / "tiny_plenoptic/dataset.usda", "-m", "thin-lens-plenoptic")
    assert code == 2 and "error: too few positions" in told
