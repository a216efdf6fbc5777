"""Whatever a stage says: `check` answers soon, and what it accepts becomes finite files or one clear error."""

import faulthandler
import random
import sys
from collections import Counter

import pytest
from hostile.attempt import build, check
from hostile.pictures import PICTURES, lay_pictures
from hostile.scenes import SCENES
from hostile.values import WITHOUT_VALUES, attempts, type_of
from pxr import Sdf, Sdr, Usd, UsdGeom

from pipeline import formats
from pipeline.folders import shipped_folder
from pipeline.scene.load import load

LAMPS = ("CylinderLight", "DiskLight", "DistantLight", "DomeLight", "DomeLight_1", "RectLight", "SphereLight")
SHADERS = ("UsdPreviewSurface", "UsdUVTexture", "UsdTransform2d", "UsdPrimvarReader_float2")
FEWEST = 3
"""Hostile values of a property: of flags both, and a text."""
HANGS_S = 600


@pytest.mark.heavy
def test_every_scene_is_right_before_a_hostile_value_is_put_into_it(tmp_path):
    path = tmp_path / "dataset.usda"
    lay_pictures(tmp_path)
    for name, scene in SCENES.items():
        path.write_text(scene.stage().GetRootLayer().ExportToString(), encoding="utf-8")
        assert load(path).errors == [], name


def test_every_attribute_and_relationship_is_tried_with_hostile_values():
    """All of our schemas, all of USD's cameras, meshes, instancers, lamps and shaders, all that moves a prim or is said
    of a whole stage; and every export and picture.
    """
    layer = Sdf.Layer.FindOrOpen(str(shipped_folder("schemas") / "plenScene/resources/plenScene/schema.usda"))
    wanted = {prop.name for prim in layer.rootPrims for prop in prim.properties}
    registry = Usd.SchemaRegistry()
    for name in ("Camera", "Mesh", "PointInstancer", "Material", "Shader", *LAMPS):
        definition = registry.FindConcretePrimDefinition(name)
        wanted |= {one for one in definition.GetPropertyNames() if type_of(definition, one) not in WITHOUT_VALUES}
    for name in SHADERS:
        wanted |= {f"inputs:{one}" for one in Sdr.Registry().GetShaderNodeByIdentifier(name).GetShaderInputNames()}
    wanted |= {f"xformOp:{UsdGeom.XformOp.GetOpTypeToken(kind)}" for kind in UsdGeom.XformOp.Type.allValues[1:]}
    wanted |= {"metersPerUnit", "upAxis", "timeCodesPerSecond", "startTimeCode", "endTimeCode", "defaultPrim"}
    counts = Counter(attempt.name for attempt in attempts())
    assert {name: counts[name] for name in wanted if counts[name] < FEWEST} == {}
    assert {attempt.name for attempt in attempts() if attempt.type_name == "rel"} >= {"plen:mesh", "plen:targets"}
    assert {text for one in attempts() if one.name == "plen:exports" for text in one.value} >= set(formats.names())
    named = {(one.at, one.value.path) for one in attempts() if one.type_name == "asset"}
    assert named >= {(at, f"./{name}") for at in ("Lamp", "Paint/Picture") for name in PICTURES}


@pytest.mark.parametrize("shard", [None, *(pytest.param(n, marks=pytest.mark.heavy) for n in range(0, 30, 10))])
def test_no_hostile_value_does_harm(shard, tmp_path):
    """One of 300 values in `make test`; a tenth of them, in three parts, in `make proofs`."""
    dice, some, accepted, wrong = random.Random(11), list(attempts()), [], []
    dice.shuffle(some)
    try:
        for attempt in some[::300] if shard is None else some[shard::30]:
            faulthandler.dump_traceback_later(HANGS_S, exit=True, file=sys.__stderr__)
            if loaded := check(attempt, tmp_path, wrong):
                accepted.append((attempt, loaded))
        for attempt, loaded in dice.sample(accepted, 1 if shard is None else len(accepted) // 2):
            faulthandler.dump_traceback_later(HANGS_S, exit=True, file=sys.__stderr__)
            build(attempt, loaded, tmp_path, wrong)
    finally:
        faulthandler.cancel_dump_traceback_later()
    assert not wrong, "\n".join(wrong)
    assert accepted
