"""Every attribute of the schemas, changed alone: exactly the tasks that depend on it get another key.

The table says what depends on what, in words of the user's manual; the schema says which attributes there are. Nothing
is traced: where a task would run again, its outputs count as changed; `focus` alone really runs, for early cutoff.
"""

import os
import subprocess
import sys
from dataclasses import dataclass, field
from typing import Any

import pytest
from pxr import Gf, Sdf, Usd

from pipeline.engine.digest import key_of
from pipeline.engine.graph import TaskGraph
from pipeline.engine.run import run
from pipeline.engine.spec import Specs
from pipeline.engine.store import Store
from pipeline.scene.load import load
from pipeline.share import share
from pipeline.tasks.graph import graph_of

RAYS = {"rays_tile", "rays"}
IMAGES = {"image", "white"}
CAMERA = {"focus", "first_order", "micro_images", "truth"} | RAYS | IMAGES
A, B, LENS, STOP, GLASS = "A/Camera", "B/Camera", "A/Lens", "A/Lens/Stop", "A/Lens/S1"


@dataclass(frozen=True, kw_only=True)
class Case:
    """A change of one attribute of one prim, and the kinds of tasks that depend on it.

    Attributes
    ----------
    given : dict
        (prim, attribute) -> value that holds before and after: what the attribute needs to mean something.
    along : dict
        The same, changed together with it, because the checks ask for it.
    refused : bool
        It is declared and not built yet: `check` must say so.
    """

    at: str
    value: Any
    kinds: set[str] = field(default_factory=set)
    given: dict[tuple[str, str], Any] = field(default_factory=dict)
    along: dict[tuple[str, str], Any] = field(default_factory=dict)
    refused: bool = False


POLYGON = {(STOP, "plen:apertureShape"): "polygonal", (STOP, "plen:blades"): 6}
FOCUSED = {(B, "plen:camera:focusDistance"): 420.0, (B, "plen:camera:sensorDistance"): None}
CATALOGUE = {(LENS, "plen:indexSource"): "catalogue"}
SWAPPED = ["S3", "S2", "S1", "S4", "S5", "Stop", "S7", "S8", "S9", "S10", "S11"]
NEAREST = {(A, "plen:truth:search"): "nearest"}

CASES: dict[str, list[Case]] = {
    "plen:cameras": [Case(at="", value=["A/Camera"])],
    "plen:targets": [Case(at="", value=["One"], kinds={"image", "truth"})],
    "plen:frames": [Case(at="", value=[2])],
    "plen:seed": [Case(at="", value=9, kinds={"truth"} | RAYS | IMAGES)],
    "plen:background": [Case(at="", value=0.5, kinds={"image"})],
    "plen:name": [Case(at=LENS, value="mine", kinds={"first_order"})],
    "plen:surfaceOrder": [Case(at=LENS, value=SWAPPED, kinds=CAMERA)],
    "plen:nominalFocalLength": [Case(at=LENS, value=101.0)],
    "plen:indexSource": [Case(at=LENS, value="catalogue", kinds=CAMERA)],
    # Printed indices stay what they are: only what says the wavelength has to be written again.
    "plen:wavelength": [
        Case(
            at=LENS,
            value=587.6,
            kinds={"first_order", "rays", "truth"} | IMAGES,
            along={(A, "plen:camera:wavelength"): 587.6},
        )
    ],
    "plen:radius": [Case(at=GLASS, value=60.0, kinds=CAMERA)],
    "plen:conic": [Case(at=GLASS, value=-0.1, kinds=CAMERA)],
    "plen:evenCoefficients": [Case(at=GLASS, value=[1e-9], kinds=CAMERA)],
    "plen:oddCoefficients": [Case(at=GLASS, value=[1e-9], kinds=CAMERA)],
    "plen:thickness": [Case(at=GLASS, value=8.9, kinds=CAMERA)],
    "plen:semiDiameter": [Case(at=STOP, value=4.0, kinds=CAMERA)],
    "plen:apertureShape": [Case(at=STOP, value="polygonal", kinds=CAMERA, along={(STOP, "plen:blades"): 6})],
    "plen:innerSemiDiameter": [
        Case(at=STOP, value=1.0, kinds=CAMERA, along={(STOP, "plen:apertureShape"): "annular"}),
    ],
    "plen:halfWidths": [
        Case(at=STOP, value=(3.0, 3.0), kinds=CAMERA, along={(STOP, "plen:apertureShape"): "rectangular"}),
    ],
    "plen:blades": [Case(at=STOP, value=7, kinds=CAMERA, given=POLYGON)],
    "plen:apertureRotation": [Case(at=STOP, value=10.0, kinds=CAMERA, given=POLYGON)],
    "plen:isStop": [Case(at=STOP, value=False, kinds=CAMERA, along={("A/Lens/S5", "plen:isStop"): True})],
    "plen:index": [Case(at=GLASS, value=1.6701, kinds=CAMERA)],
    "plen:glass": [Case(at=GLASS, value="SCHOTT N-BK7")],
    "plen:abbe": [Case(at=GLASS, value=47.11)],
    "plen:layout": [Case(at="B/Microlenses", value="square", refused=True)],
    "plen:pitch": [Case(at="B/Microlenses", value=0.2, kinds=CAMERA)],
    "plen:width": [Case(at="B/Microlenses", value=20.0, kinds=CAMERA)],
    "plen:height": [Case(at="B/Microlenses", value=20.0, kinds=CAMERA)],
    "plen:rotation": [Case(at="B/Microlenses", value=1.0, kinds=CAMERA)],
    "plen:offset": [
        Case(at="B/Microlenses", value=(0.01, 0.0), kinds=CAMERA),
        Case(at="A/Sensor", value=(0.01, 0.0), kinds=CAMERA),
    ],
    "plen:tilt": [
        Case(at="B/Microlenses", value=(1.0, 0.0), refused=True),
        Case(at="A/Sensor", value=(1.0, 0.0), refused=True),
    ],
    "plen:focalLengths": [Case(at="B/Microlenses", value=[1.9, 2.0, 2.4], kinds=CAMERA)],
    "plen:model": [Case(at="B/Microlenses", value="lens", refused=True)],
    "plen:aperture": [Case(at="B/Microlenses", value="disc", refused=True)],
    "plen:resolution": [Case(at="A/Sensor", value=Gf.Vec2i(30, 24), kinds=CAMERA)],
    "plen:pixelPitch": [Case(at="A/Sensor", value=0.09, kinds=CAMERA)],
    "plen:white": [Case(at="One", value=0.9, kinds={"image", "truth"})],
    "plen:black": [Case(at="One", value=0.1, kinds={"image", "truth"})],
    "plen:columns": [Case(at="One", value=5, kinds={"image", "truth"})],
    "plen:rows": [Case(at="One", value=4, kinds={"image", "truth"})],
    "plen:squareSize": [Case(at="One", value=1.3, kinds={"image", "truth"})],
    "plen:camera:lens": [Case(at=A, value=["B/Lens"], kinds=CAMERA)],
    "plen:camera:sensor": [Case(at=A, value=["B/Sensor"], kinds=CAMERA)],
    "plen:camera:microlenses": [Case(at=B, value=[], kinds=CAMERA, along={(B, "plen:camera:microlensDistance"): None})],
    "plen:camera:sensorDistance": [Case(at=A, value=131.9, kinds=CAMERA)],
    "plen:camera:focusDistance": [Case(at=B, value=421.0, kinds=CAMERA, given=FOCUSED)],
    "plen:camera:focusType": [Case(at=B, value=2, kinds=CAMERA, given=FOCUSED)],
    "plen:camera:stopMatch": [Case(at=B, value="microlenses", kinds=CAMERA)],
    "plen:camera:microlensDistance": [Case(at=B, value=1.71, kinds=CAMERA)],
    "plen:camera:wavelength": [Case(at=A, value=600.0, kinds=CAMERA, given=CATALOGUE)],
    "plen:camera:weight": [Case(at=A, value="radiance", refused=True)],
    "plen:camera:circleOfConfusion": [Case(at=A, value=2.0, kinds=CAMERA)],
    "plen:camera:near": [Case(at=A, value=400.0, kinds=CAMERA)],
    "plen:camera:far": [Case(at=A, value=500.0, kinds=CAMERA)],
    "plen:truth:method": [Case(at=A, value="moments", kinds={"truth"})],
    "plen:truth:search": [Case(at=A, value="nearest", kinds={"truth"})],
    "plen:truth:filter": [Case(at=A, value="none", kinds={"truth"})],
    "plen:truth:lambdaD": [Case(at=A, value=0.2, kinds={"truth"})],
    "plen:truth:lambdaAlpha": [Case(at=A, value=20.0, kinds={"truth"})],
    "plen:truth:nearestThreshold": [Case(at=A, value=0.1, kinds={"truth"}, given=NEAREST)],
    "plen:truth:supersampling": [Case(at=A, value=2, kinds={"truth"} | RAYS)],
    "plen:truth:samples": [Case(at=A, value=128, kinds={"truth"} | RAYS)],
    "plen:truth:footprint": [Case(at=A, value="pixel", refused=True)],
    "plen:truth:minHitFraction": [Case(at=A, value=0.1, kinds={"truth"})],
    "plen:truth:accuracy": [Case(at=A, value=0.001, refused=True)],
    "plen:image:samples": [Case(at=A, value=128, kinds=IMAGES)],
    "plen:image:fNumbers": [Case(at=A, value=[8.0], refused=True)],
}

STAGE = """#usda 1.0
(
    defaultPrim = "Scene"
    endTimeCode = 2
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)

def PlenDataset "Scene"
{
    rel plen:cameras = [</Scene/A/Camera>, </Scene/B/Camera>]
    rel plen:targets = [</Scene/One>, </Scene/Two>]

    def "A" (
        prepend references = @rigs/conventional_100mm.usda@
    )
    {
        over "Sensor"
        {
            uniform double plen:pixelPitch = 0.1
            uniform int2 plen:resolution = (32, 24)
        }
    }

    def "B" (
        prepend references = @rigs/plenoptic_michels_2019.usda@
    )
    {
        over "Sensor"
        {
            uniform double plen:pixelPitch = 0.03
            uniform int2 plen:resolution = (48, 40)
        }
    }

    def PlenCheckerboard "One"
    {
        uniform int plen:columns = 3
        uniform int plen:rows = 2
        uniform double plen:squareSize = 1.4
        double3 xformOp:translate = (0, 0, -434.4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def PlenCheckerboard "Two"
    {
        uniform int plen:columns = 3
        uniform int plen:rows = 2
        uniform double plen:squareSize = 1
        double3 xformOp:translate = (9, 0, -500)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A stage with two cameras and two targets, and a store where `focus` tasks run."""
    return _Bench(tmp_path_factory.mktemp("attributes"))


class _Bench:
    def __init__(self, folder) -> None:
        self.folder, self.store, self.count = folder, Store(folder / "store"), 0
        self.known: dict[str, dict[str, str]] = {}

    def keys(self, edits: dict[tuple[str, str], Any]) -> dict[str, str]:
        """Key of every task after the edits, its inputs being what the keys of its sources stand for."""
        name = repr(sorted(edits.items(), key=repr))
        if name not in self.known:
            loaded = self.load(edits)
            assert loaded.errors == [], [str(problem) for problem in loaded.errors]
            self.known[name] = self._keys(graph_of(loaded.dataset)[0])
        return self.known[name]

    def load(self, edits: dict[tuple[str, str], Any]):
        self.count += 1
        path = self.folder / f"{self.count}.usda"
        path.write_text(STAGE, encoding="utf-8")
        stage = Usd.Stage.Open(str(path))
        for (at, name), value in edits.items():
            prim = stage.GetPrimAtPath(f"/Scene/{at}".rstrip("/"))
            assert prim, at
            if isinstance(value, list) and prim.GetRelationship(name):
                prim.GetRelationship(name).SetTargets([Sdf.Path(f"/Scene/{target}") for target in value])
                continue
            attribute = prim.GetAttribute(name)
            assert attribute, f"{at} has no {name}"
            attribute.Block() if value is None else attribute.Set(value)
        stage.Save()
        return load(path)

    def _keys(self, graph: TaskGraph) -> dict[str, str]:
        focused = graph.up_to([name for name in graph if graph[name].short_kind == "focus"])
        outcome = run(focused, self.store)
        assert {result.state for result in outcome.results.values()} <= {"executed", "cached"}, outcome.results
        records = dict(outcome.records)
        specs, keys = Specs(), {}
        for name in graph:
            keys[name] = specs.of(graph[name], records).key
            if name not in records:
                digest = key_of("bytes", keys[name])
                records[name] = {"outputs": {"x": {"sha256": digest, "size": 1}}}
        return keys


def reruns(before: dict[str, str], after: dict[str, str]) -> set[str]:
    """Names of the tasks whose results are not there yet."""
    return {name for name, key in after.items() if key not in before.values()}


def test_the_table_holds_every_attribute_of_the_schemas_and_no_other():
    """A new attribute needs a row here: which tasks depend on it?"""
    layer = Sdf.Layer.FindOrOpen(str(share("schemas") / "plenScene/resources/plenScene/schema.usda"))
    declared = {prop.name for prim in layer.rootPrims for prop in prim.properties if prop.name.startswith("plen:")}
    assert declared == set(CASES)


@pytest.mark.parametrize(
    ("name", "case"), [pytest.param(n, c, id=f"{n} of {c.at or 'Scene'}") for n, cases in CASES.items() for c in cases]
)
def test_exactly_the_readers_of_an_attribute_get_another_key(bench, name, case):
    edits = {**case.given, **case.along, (case.at, name): case.value}
    if case.refused:
        codes = {problem.code for problem in bench.load(edits).errors}
        assert codes & {"not-yet-supported", "bad-token"}, codes
        return
    changed = reruns(bench.keys(case.given), bench.keys(edits))
    kinds = {task.split("/")[0] for task in changed}
    expected = case.kinds
    if case.at.startswith("A"):
        expected = expected - {"micro_images"}
    if name == "plen:camera:microlenses":
        expected = expected - {"micro_images"}
    assert kinds == expected, sorted(changed)
    if case.at[:2] in ("A/", "B/"):
        camera = f"{case.at[0]}.Camera"
        assert {task.split("/")[1] for task in changed} <= {camera}, "the other camera must not care"
    frames = {task.split("/")[2] for task in changed if task.split("/")[0] in ("image", "truth")}
    assert frames in (set(), {"0001", "0002"})


@pytest.mark.parametrize(("old", "new"), [("One", "Uno"), ("A", "Left")])
def test_renaming_a_target_or_a_camera_reruns_only_what_writes_its_name(bench, old, new):
    path = bench.folder / f"renamed_{new}.usda"
    text = STAGE.replace(f'"{old}"', f'"{new}"').replace(f"/Scene/{old}", f"/Scene/{new}")
    path.write_text(text, encoding="utf-8")
    changed = reruns(bench.keys({}), bench._keys(graph_of(load(path).dataset)[0]))
    assert {name.split("/")[0] for name in changed} == {"truth"}
    if old == "A":
        assert {name.split("/")[1] for name in changed} == {"Left.Camera"}


def test_keys_are_the_same_in_another_process_with_another_hash_seed(bench, tmp_path):
    path = tmp_path / "s.usda"
    path.write_text(STAGE, encoding="utf-8")
    code = (
        "import sys; from pipeline.scene.load import load; from pipeline.tasks.graph import graph_of\n"
        "from pipeline.engine.digest import key_of\n"
        "graph = graph_of(load(sys.argv[1]).dataset)[0]\n"
        "print(key_of('test', [[name, graph[name].params, graph[name].reads] for name in graph]))"
    )
    seen = {
        subprocess.run(
            [sys.executable, "-c", code, str(path)],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("0", "1", "4242")
    }
    assert len(seen) == 1
