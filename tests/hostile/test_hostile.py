"""Whatever a stage says: `check` answers soon, and what it accepts becomes finite files or one clear error."""

import faulthandler
import random
import sys
from collections import Counter
from pathlib import Path

import pytest
from hostile.attempt import BUILD_S, Tally, build, build_s, check
from hostile.pictures import PICTURES, lay_pictures
from hostile.scenes import SCENES
from hostile.values import WITHOUT_VALUES, Attempt, attempts, pairs, type_of
from pxr import Gf, Sdf, Sdr, Usd, UsdGeom

from pipeline.export_formats import FORMATS
from pipeline.scene.lamps import KINDS
from pipeline.scene.load import load
from pipeline.share import share

SHADERS = ("UsdPreviewSurface", "UsdUVTexture", "UsdTransform2d", "UsdPrimvarReader_float2")
FEW = 300
"""`make test` tries one of so many values."""
SHARDS = [pytest.param(n, marks=pytest.mark.heavy) for n in range(0, 30, 3)]
"""`make proofs` tries a third of all values: shards of thirty."""
BUILT_OF_ACCEPTED = 2
"""In those one of so many accepted stages is built."""
FEWEST = 3
"""Hostile values of a property: of flags both, and a text."""
HANGS_S = 600
LONGEST_BUILD_S = 2 * BUILD_S
"""Longer builds, which ask for more rays and for nothing else, are left out of these."""


def test_every_scene_is_right_before_a_hostile_value_is_put_into_it(tmp_path):
    path = tmp_path / "dataset.usda"
    lay_pictures(tmp_path)
    for name, scene in SCENES.items():
        path.write_text(scene.stage().GetRootLayer().ExportToString(), encoding="utf-8")
        assert load(path).errors == [], name


def test_every_attribute_and_relationship_is_tried_with_hostile_values():
    """All of our schemas, all of USD's cameras, meshes, lamps and shaders, all that moves a prim or is said of a whole
    stage; and every export and picture.
    """
    layer = Sdf.Layer.FindOrOpen(str(share("schemas") / "plenScene/resources/plenScene/schema.usda"))
    wanted = {prop.name for prim in layer.rootPrims for prop in prim.properties}
    registry = Usd.SchemaRegistry()
    for name in ("Camera", "Mesh", "Material", "Shader", *KINDS):
        definition = registry.FindConcretePrimDefinition(name)
        wanted |= {one for one in definition.GetPropertyNames() if type_of(definition, one) not in WITHOUT_VALUES}
    for name in SHADERS:
        wanted |= {f"inputs:{one}" for one in Sdr.Registry().GetShaderNodeByIdentifier(name).GetShaderInputNames()}
    wanted |= {f"xformOp:{UsdGeom.XformOp.GetOpTypeToken(kind)}" for kind in UsdGeom.XformOp.Type.allValues[1:]}
    wanted |= {"metersPerUnit", "upAxis", "timeCodesPerSecond", "startTimeCode", "endTimeCode", "defaultPrim"}
    counts = Counter(attempt.name for attempt in attempts())
    assert {name: counts[name] for name in wanted if counts[name] < FEWEST} == {}
    assert {attempt.name for attempt in attempts() if attempt.type_name == "rel"} >= {"plen:mesh", "plen:targets"}
    assert {text for one in attempts() if one.name == "plen:exports" for text in one.value} >= set(FORMATS)
    named = {(one.at, one.value.path) for one in attempts() if one.type_name == "asset"}
    assert named >= {(at, f"./{name}") for at in ("Lamp", "Paint/Picture") for name in PICTURES}


def test_whatever_of_usd_is_read_is_tried(tmp_path, monkeypatch):
    """What `check` asks a prim for: an attribute that it begins to read must be of a type that is tried as a whole."""
    asked, get = set(), Usd.Prim.GetAttribute
    monkeypatch.setattr(Usd.Prim, "GetAttribute", lambda prim, name: asked.add(name) or get(prim, name))
    lay_pictures(tmp_path)
    for name in ("conventional", "plenoptic", "mesh", "painted", "sky", "Cylinder lamp"):
        (tmp_path / "dataset.usda").write_text(SCENES[name].stage().GetRootLayer().ExportToString(), encoding="utf-8")
        assert not load(tmp_path / "dataset.usda", look=True).errors
    assert {"points", "plen:points"} <= asked <= {attempt.name for attempt in attempts()}


def test_a_build_may_take_as_long_as_the_rays_that_are_asked_for(tmp_path):
    """The bound follows the stage, and `check` warns of hours."""
    stage = SCENES["conventional"].stage()
    camera = stage.GetPrimAtPath("/Scene/Camera")
    path, bounds, warned = tmp_path / "dataset.usda", [], []
    for samples in (4, 1 << 24):
        camera.GetAttribute("plen:image:samples").Set(samples)
        path.write_text(stage.GetRootLayer().ExportToString(), encoding="utf-8")
        loaded = load(path, look=True)
        bounds.append(build_s(loaded))
        warned += [problem for problem in loaded.problems if problem.code == "long-build"]
    white_and_frames = 1 + len(loaded.dataset.frames)
    assert bounds[0] == pytest.approx(BUILD_S, abs=0.1) and not warned
    assert bounds[1] - bounds[0] == pytest.approx(12 * 8 * white_and_frames * (1 << 24) / 2e6, rel=1e-5)
    stage.GetPrimAtPath("/Scene/Sensor").GetAttribute("plen:resolution").Set(Gf.Vec2i(120, 80))
    path.write_text(stage.GetRootLayer().ExportToString(), encoding="utf-8")
    [warning] = [problem for problem in load(path, look=True).problems if problem.code == "long-build"]
    assert "plen:image:samples" in warning.at and warning.line and not warning.is_error
    camera.GetAttribute("plen:image:samples").Set(4)
    stage.GetPrimAtPath("/Scene/Sensor").GetAttribute("plen:resolution").Set(Gf.Vec2i(6000, 4000))
    for noise, warnings in ((0.1, 0), (0.01, 1)):
        camera.GetAttribute("plen:image:noise").Set(noise)
        path.write_text(stage.GetRootLayer().ExportToString(), encoding="utf-8")
        found = [problem for problem in load(path, look=True).problems if problem.code == "long-build"]
        assert [problem.at.rpartition(".")[2] for problem in found] == ["plen:image:noise"] * warnings


def test_some_hostile_values_do_no_harm(tmp_path, capsys):
    some = random.Random(11).sample(attempts(), len(attempts()) // FEW) + pairs(attempts(), 10)
    tally = _tally(some, tmp_path, builds=1)
    with capsys.disabled():
        print(f"\n{tally}")
    assert not tally.wrong, tally.wrong


@pytest.mark.parametrize("shard", SHARDS)
def test_no_hostile_value_does_harm(shard, tmp_path, capsys):
    some = attempts()
    random.Random(11).shuffle(some)
    some = some[shard :: len(SHARDS)]
    tally = _tally(some, tmp_path, builds=None)
    with capsys.disabled():
        print(f"\n{tally}")
    assert not tally.wrong, tally.wrong


@pytest.mark.heavy
def test_no_pair_of_hostile_values_does_harm(tmp_path, capsys):
    """Of values that `check` accepts one by one: others are refused in pairs as they are alone."""
    some = random.Random(3).sample(attempts(), 1500)
    tally = _tally(pairs([one for one in some if check(one, tmp_path, Tally())], 500), tmp_path, builds=60)
    with capsys.disabled():
        print(f"\n{tally}")
    assert not tally.wrong, tally.wrong


def _tally(some: list[Attempt], folder: Path, builds: int | None) -> Tally:
    """Check all of them, and build some of what is accepted: so many, or one of BUILT_OF_ACCEPTED."""
    tally, dice, accepted = Tally(), random.Random(4), []
    try:
        for attempt in some:
            faulthandler.dump_traceback_later(HANGS_S, exit=True, file=sys.__stderr__)
            if loaded := check(attempt, folder, tally):
                accepted.append((attempt, loaded))
        count = len(accepted) // BUILT_OF_ACCEPTED if builds is None else builds
        for attempt, loaded in dice.sample(accepted, count):
            if build_s(loaded) > LONGEST_BUILD_S:
                continue
            hangs_s = HANGS_S * build_s(loaded) / BUILD_S
            faulthandler.dump_traceback_later(hangs_s, exit=True, file=sys.__stderr__)
            build(attempt, loaded, folder, tally)
    finally:
        faulthandler.cancel_dump_traceback_later()
    return tally
