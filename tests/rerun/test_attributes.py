"""Every attribute of the schemas, changed alone: exactly the tasks that depend on it get another key.

The table says what depends on what, in words of the user's manual; the schema says which attributes there are. Nothing
is traced: where a task would run again, its outputs count as changed; `focus` and `planes` alone really run, for early
cutoff.
"""

from typing import Any

import pytest
from pxr import Sdf, Usd
from rerun.attribute_stage import STAGE, path_of, write
from rerun.attribute_table import CASES, TRUTH

from pipeline.engine.digest import key_of
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.planning.plan import Specs
from pipeline.engine.records import Blob, Record
from pipeline.engine.running.driver import run
from pipeline.engine.store.store import Store
from pipeline.folders import share
from pipeline.graph.dataset_graph import graph_of
from pipeline.scene.load import load

QUICK = 16
"""One of so many attributes is changed in `make test`, all of them in `make proofs`."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A stage with two cameras and two targets, and a store where `focus` and `planes` run."""
    return _Bench(tmp_path_factory.mktemp("attributes"))


class _Bench:
    def __init__(self, folder) -> None:
        self.folder, self.store, self.count = folder, Store(folder / "store"), 0
        self.specs = Specs(self.store)
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
        return load(write(self.folder / f"{self.count}.usda", edits))

    def _keys(self, graph: TaskGraph) -> dict[str, str]:
        focused = graph.up_to([name for name in graph if graph[name].short_kind in ("focus", "planes")])
        outcome = run(focused, self.store)
        assert {result.state for result in outcome.results.values()} <= {"executed", "cached"}, outcome.results
        records = dict(outcome.records)
        keys = {}
        for name in graph:
            spec = self.specs.of(graph[name], records)
            keys[name] = spec.key
            if name not in records:
                outputs = {"x": Blob(sha256=key_of("bytes", spec.key), size=1)}
                records[name] = Record(key=spec.key, outputs=outputs, components=spec.components)
        return keys


def reruns(before: dict[str, str], after: dict[str, str]) -> set[str]:
    return {name for name, key in after.items() if key not in before.values()}


def test_the_table_holds_every_attribute_of_the_schemas_and_no_other():
    """A new attribute needs a row, for each schema that declares it: which tasks depend on it?"""
    layer = Sdf.Layer.FindOrOpen(str(share("schemas") / "plenScene/resources/plenScene/schema.usda"))
    declared = {(prim.name, prop.name) for prim in layer.rootPrims for prop in prim.properties}
    assert {name for _, name in declared} == {name for name in CASES if name.startswith("plen:")}
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().ImportFromString(STAGE)
    prims = {case.at: stage.GetPrimAtPath(path_of(case.at)) for cases in CASES.values() for case in cases}
    held = [(prims[case.at], name) for name, cases in CASES.items() for case in cases]
    left_out = {
        (schema, name)
        for schema, name in declared
        if not any(name == other and (prim.IsA(schema) or prim.HasAPI(schema)) for prim, other in held)
    }
    assert left_out == set()


def kind_of(task: str) -> str:
    """Kind of a task; that of a tile is the kind that joins it, but for rays, whose tiles read less."""
    kind = task.split("/")[0]
    return kind if kind == "rays_tile" else kind.removesuffix("_tile")


ALL = [(name, case) for name, cases in CASES.items() for case in cases]
PARAMETERS = [
    pytest.param(name, case, id=f"{name} of {case.at or 'Scene'}", marks=[pytest.mark.heavy] * (number % QUICK > 0))
    for number, (name, case) in enumerate(ALL)
]


@pytest.mark.parametrize(("name", "case"), PARAMETERS)
def test_exactly_the_readers_of_an_attribute_get_another_key(bench, name, case):
    edits = {**case.given, **case.along, (case.at, name): case.value}
    if case.refused:
        codes = {problem.code for problem in bench.load(edits).errors}
        assert codes & {"not-yet-supported", "bad-token", "colour-filters", "sensor-response"}, codes
        return
    changed = reruns(bench.keys(case.given), bench.keys(edits))
    kinds = {kind_of(task) for task in changed}
    # The conventional camera has no task of that kind.
    expected = case.kinds - {"micro_images"} if case.at.startswith("A/") else case.kinds
    assert kinds == expected, sorted(changed)
    if case.at[:2] in ("A/", "B/"):
        camera = f"{case.at[0]}.Camera"
        others = {task for task in changed if task.split("/")[1:2] != [camera]}
        assert others <= {"baselines"}, "the other camera must not care"
    frames = {task.split("/")[2] for task in changed if kind_of(task) in ("image", "truth")}
    assert frames in (set(), {"0001", "0002"})


@pytest.mark.parametrize(("old", "new"), [("One", "Uno"), ("A", "Left")])
def test_renaming_a_target_or_a_camera_reruns_only_what_writes_its_name(bench, old, new):
    path = bench.folder / f"renamed_{new}.usda"
    text = STAGE.replace(f'"{old}"', f'"{new}"').replace(f"/Scene/{old}", f"/Scene/{new}")
    path.write_text(text, encoding="utf-8")
    changed = reruns(bench.keys({}), bench._keys(graph_of(load(path).dataset)[0]))
    between = {"baselines"} if old == "A" else set()
    assert set(map(kind_of, changed)) == TRUTH | {"frame_poses"} | between
    if old == "A":
        assert {name.split("/")[1] for name in changed - between} == {"Left.Camera"}
