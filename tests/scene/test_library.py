"""The shipped stages and the examples are flawless, written as USD writes, and say what their sources say."""

import numpy as np
import pytest
from laws import rigs
from places import ROOT
from pxr import Sdf, Usd, UsdGeom
from shorter import few

from pipeline.scene.load import load, open_dataset
from pipeline.scene.targets import read_target

LIBRARY = sorted((ROOT / "stages").rglob("*.usda"))
EXAMPLES = sorted((ROOT / "examples").glob("*/dataset.usda"))
TINY = sorted((ROOT / "tests/data").glob("tiny_*/dataset.usda"))
ALL = [*LIBRARY, *EXAMPLES, *TINY]


def name_of(path):
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("step", few([3], 1))
def test_the_checker_finds_nothing(step):
    assert len(LIBRARY) == 61 and len(EXAMPLES) == 13
    problems = {name_of(path): load(path, look=True).problems for path in ALL[::step]}

    assert {name: listed for name, listed in problems.items() if listed} == {}


def test_the_text_is_what_usd_would_write():
    texts = {path: Sdf.Layer.FindOrOpen(path.as_posix()).ExportToString().rstrip("\n") + "\n" for path in ALL}

    assert [name_of(path) for path, text in texts.items() if path.read_text() != text] == []


def test_every_layer_states_units_axis_rate_root_what_it_is_and_to_what_unknown_types_fall_back():
    for path in ALL:
        stage = Usd.Stage.Open(path.as_posix())
        layer, metadata = stage.GetRootLayer(), stage.GetPseudoRoot().GetMetadata
        assert (metadata("metersPerUnit"), metadata("upAxis"), layer.timeCodesPerSecond) == (0.001, "Y", 24), path
        assert [prim.name for prim in layer.rootPrims] == [layer.defaultPrim] and len(layer.documentation) > 40, path
        ours = {str(prim.GetTypeName()) for prim in stage.TraverseAll() if prim.GetTypeName().startswith("Plen")}
        assert ours <= set(stage.GetMetadata("fallbackPrimTypes") or {}), path


def test_the_tronnier_lens_is_the_printed_one():
    """From W. J. Smith, Modern Lens Design, p. 312, scaled to 100 mm; the rig closes its stop from 17.1 mm."""
    (entry,) = open_dataset(EXAMPLES[0]).cameras
    printed = rigs.tronnier(4.5).surfaces
    assert [shape_of(surface) for surface in entry.camera.prescription.surfaces] == [*map(shape_of, printed)]


def shape_of(surface):
    return surface.radius_mm, surface.thickness_mm, surface.index, surface.semi_diameter_mm, surface.is_stop


def test_the_plenoptic_rig_is_the_one_of_the_paper():
    """Michels, Petersen and Koch 2019, section 4."""
    (entry,) = open_dataset(EXAMPLES[1]).cameras
    camera, array = entry.camera, entry.camera.microlenses

    assert array.focal_lengths_mm == (1.9, 2.1, 2.3)
    assert (array.pitch_mm, array.width_mm, array.height_mm, array.distance_mm) == (0.2173, 21.73, 21.73, 1.7)
    assert camera.sensor_distance_mm - array.distance_mm == pytest.approx(123.3, abs=1e-12)
    assert camera.prescription.stop.semi_diameter_mm == 5.0
    assert (entry.truth.lambda_d, entry.truth.lambda_alpha_deg) == (0.15, 10.0)


def test_the_full_sensor_is_a_variant_of_the_plenoptic_rig():
    stage = Usd.Stage.Open((ROOT / "stages/rigs/plenoptic_michels_2019.usda").as_posix())
    stage.SetEditTarget(stage.GetSessionLayer())
    stage.GetPrimAtPath("/Rig").GetVariantSet("sensor").SetVariantSelection("full")

    assert tuple(stage.GetPrimAtPath("/Rig/Sensor").GetAttribute("plen:resolution").Get(1)) == (2173, 2173)


@pytest.mark.parametrize("path", [*EXAMPLES[:3], ROOT / "stages/targets/checkerboard_4x7.usda"], ids=name_of)
def test_the_preview_shows_the_board_that_is_built(path):
    """Its squares lie where `Checkerboard.radiance` says, in size and colour, and face the viewer."""
    stage = Usd.Stage.Open(path.as_posix())
    board = next(prim for prim in stage.TraverseAll() if prim.IsA("PlenCheckerboard"))
    mesh = UsdGeom.Mesh(board.GetChild("Preview"))
    points = np.array(mesh.GetPointsAttr().Get(1)) * board.GetChild("Preview").GetAttribute("xformOp:scale").Get(1)[0]
    faces = np.array(mesh.GetFaceVertexIndicesAttr().Get(1)).reshape(-1, 4)
    colours = np.array(mesh.GetDisplayColorAttr().Get(1))
    target = read_target(board).pattern

    centres = points[faces].mean(axis=1).astype(float)
    assert np.array_equal(target.radiance(centres[:, 0], centres[:, 1]), colours[:, 0])
    assert np.array_equal(points.max(axis=0)[:2], (target.drawing.half_x_mm, target.drawing.half_y_mm))
    edges = points[faces]
    assert (np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 1])[:, 2] > 0).all()


@pytest.mark.parametrize("path", [path for path in [*EXAMPLES, *TINY] if "13_design" not in path.parts], ids=name_of)
def test_the_pinhole_preview_has_the_shape_of_the_sensor(path):
    """In tenths of a millimetre, as USD counts film backs in a stage in millimetres. Designed rigs have no preview."""
    stage = Usd.Stage.Open(path.as_posix())
    for entry in open_dataset(path).cameras:
        camera, sensor = UsdGeom.Camera(stage.GetPrimAtPath(entry.prim_path)), entry.camera.sensor
        aperture = camera.GetHorizontalApertureAttr().Get(1), camera.GetVerticalApertureAttr().Get(1)
        assert aperture == pytest.approx([10 * edge_mm for edge_mm in sensor.size_mm], rel=1e-6)
