"""Whatever a stage says: `check` answers soon, and what it accepts becomes finite files or one clear error."""

import faulthandler
import random
import sys
from pathlib import Path

import pytest
from hostile.attempt import Tally, build, check
from hostile.scenes import SCENES
from hostile.values import Attempt, attempts
from pxr import Sdf

from pipeline.scene.load import load
from pipeline.share import share

SHARDS = 10
BUILT_OF_ACCEPTED = 4
"""In `make proofs` one of so many accepted stages is built."""
HANGS_S = 600


def test_every_scene_is_right_before_a_hostile_value_is_put_into_it(tmp_path):
    path = tmp_path / "dataset.usda"
    for name, scene in SCENES.items():
        path.write_text(scene.stage().GetRootLayer().ExportToString(), encoding="utf-8")
        assert load(path).errors == [], name


def test_every_attribute_and_relationship_of_the_schemas_is_tried():
    layer = Sdf.Layer.FindOrOpen(str(share("schemas") / "plenScene/resources/plenScene/schema.usda"))
    declared = {prop.name for prim in layer.rootPrims for prop in prim.properties}
    assert declared - {attempt.name for attempt in attempts()} == {"plen:mesh", "plen:points", "plen:normals"}


def test_a_tenth_of_all_hostile_values_does_no_harm(tmp_path, capsys):
    some = random.Random(11).sample(attempts(), len(attempts()) // SHARDS)
    tally = _tally(some, tmp_path, builds=2)
    with capsys.disabled():
        print(f"\n{tally}")
    assert not tally.wrong, tally.wrong


@pytest.mark.heavy
@pytest.mark.parametrize("shard", range(SHARDS))
def test_no_hostile_value_does_harm(shard, tmp_path, capsys):
    some = attempts()[shard::SHARDS]
    tally = _tally(some, tmp_path, builds=None)
    with capsys.disabled():
        print(f"\n{tally}")
    assert not tally.wrong, tally.wrong


def _tally(some: list[Attempt], folder: Path, builds: int | None) -> Tally:
    """Check all of them, and build some of what is accepted: so many, or the share of `make proofs`."""
    tally, dice, accepted = Tally(), random.Random(4), []
    try:
        for attempt in some:
            faulthandler.dump_traceback_later(HANGS_S, exit=True, file=sys.__stderr__)
            if check(attempt, folder, tally):
                accepted.append(attempt)
        count = len(accepted) // BUILT_OF_ACCEPTED if builds is None else builds
        for attempt in dice.sample(accepted, count):
            faulthandler.dump_traceback_later(HANGS_S, exit=True, file=sys.__stderr__)
            (folder / "dataset.usda").write_bytes(attempt.text().encode("utf-8", "surrogatepass"))
            build(attempt, load(folder / "dataset.usda"), folder, tally)
    finally:
        faulthandler.cancel_dump_traceback_later()
    return tally
