"""Every attribute of the schemas, changed alone: exactly the tasks that depend on it get another key, and their plan
names attribute, line, old and new value.

The table says what depends on what, in words of the user's manual; the schema says which attributes there are. Nothing
is traced: where a task would run again, its outputs count as changed; `camera` alone really runs, for early
cutoff. What was edited is known from the test; the line is looked for in the text by its words alone.
"""

from pathlib import Path
from typing import Any

import pytest
from places import DATA
from pxr import Sdf, Usd
from rerun.attribute_table import CASES, LENS, STOP, TRUTH, A
from rerun.pretended import Pretended, project_of

from pipeline.engine.digest import key_of
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.planning.plan import Specs
from pipeline.engine.records import Blob, Record
from pipeline.engine.running.driver import run
from pipeline.engine.store.store import Store
from pipeline.folders import shipped_folder
from pipeline.scene.load import load

STAGE = (DATA / "every_attribute.usda").read_text(encoding="utf-8")
"""A stage with values of the table: an occluder, a target of every kind, a conventional and a plenoptic camera, and one
with a channel that takes part where a case says so.
"""
QUICK = 32
"""One of so many attributes is changed in `make test`, all of them in `make proofs`."""
FOR_THE_CHECKS = {
    (LENS, "plen:wavelength"): (A, "plen:camera:wavelength"),
    (A, "plen:image:exposure"): (A, "plen:image:whiteLevel"),
    (STOP, "plen:apertureShape"): (STOP, "plen:blades"),
}
"""Attributes that no task reads, and those that change with them: the checks alone want the wavelength of printed
indices to be that of the camera, and tasks read how much light there is and how many blades, not what says so."""


def path_of(at: str) -> str:
    return f"/Scene/{at}".rstrip("/")


def write(path: Path, values: dict[tuple[str, str], Any], is_whole: bool = True) -> Path:
    """The stage with some values of (prim, attribute), as one file; None blocks one, and a dict has its
    samples. Whole, or with two targets.
    """
    path.write_text(STAGE, encoding="utf-8")
    stage = Usd.Stage.Open(str(path))
    stage.Reload()
    stage.GetPrimAtPath("/Scene/More").SetActive(is_whole)
    targets: dict[tuple[str, str], Any] = {} if is_whole else {("", "plen:targets"): ["One", "Two"]}
    for (at, name), value in (targets | values).items():
        prim = stage.GetPrimAtPath(path_of(at))
        assert prim, at
        if isinstance(value, list) and prim.GetRelationship(name):
            prim.GetRelationship(name).SetTargets([Sdf.Path(f"/Scene/{target}") for target in value])
            continue
        attribute = prim.GetAttribute(name)
        assert attribute, f"{at} has no {name}"
        if isinstance(value, dict):
            for time, sample in value.items():
                attribute.Set(sample, time)
        else:
            attribute.Block() if value is None else attribute.Set(value)
    stage.Save()
    return path


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A store where `camera` runs, and stages that count as built."""
    return _Bench(tmp_path_factory.mktemp("attributes"))


class _Bench:
    def __init__(self, folder: Path) -> None:
        self.folder, self.store = folder, Store(folder / "store")
        self.specs = Specs(self.store)
        self._built: dict[str, tuple[Pretended, dict[str, str]]] = {}

    def built(self, given, is_whole=True) -> tuple[Pretended, dict[str, str]]:
        """The stage with what is given, and the key of every task."""
        name = repr((is_whole, *sorted(given.items(), key=repr)))
        if name not in self._built:
            home = self.folder / str(len(self._built))
            home.mkdir()
            stage = Pretended(write(home / "dataset.usda", given, is_whole), Store(home / "store"))
            self._built[name] = stage, self.keys(stage.project.graph)
        return self._built[name]

    def keys(self, graph: TaskGraph) -> dict[str, str]:
        """Key of every task, its inputs being what the keys of its sources stand for."""
        focused = graph.up_to([name for name in graph if graph[name].short_kind == "camera"])
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
    layer = Sdf.Layer.FindOrOpen(str(shipped_folder("schemas") / "plenScene/resources/plenScene/schema.usda"))
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
def test_exactly_the_readers_of_an_attribute_get_another_key_and_a_plan_names_it(bench, name, case):
    """An edit of a camera or of a board is one of a stage with two targets, which takes half of the time."""
    is_whole = not case.at.startswith(("A/", "B/", "C/", "One", "Two"))
    before, keys = bench.built(case.given, is_whole)
    edits = {**case.along, (case.at, name): case.value}
    write(before.path, {**case.given, **edits}, is_whole)
    if case.refused:
        codes = {problem.code for problem in load(before.path).errors}
        assert codes & {"not-yet-supported", "bad-token", "colour-filters", "sensor-response"}, codes
        return
    project = project_of(before.path)
    changed = reruns(keys, bench.keys(project.graph))
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
    if case.kinds:
        assert_named(before.planned(project), name, case.at, edits, before.path)


def assert_named(tasks, name, at, edits, path):
    """All tasks that a plan runs name the edits and no others, and the one with its line."""
    assert tasks
    for task in tasks:
        assert [str(reason) for reason in task.reasons if not reason.edits] == [], task.name
        assert {edit.at for edit in task.edits} <= {f"{path_of(place)}.{one}" for place, one in edits}
    at, name = FOR_THE_CHECKS.get((at, name), (at, name))
    edit = next(edit for task in tasks for edit in task.edits if edit.at == f"{path_of(at)}.{name}")
    assert edit.old != edit.new
    assert Path(edit.file).name == path.name
    assert name in path.read_text(encoding="utf-8").splitlines()[edit.line - 1]


@pytest.mark.parametrize(("old", "new"), [("One", "Uno"), ("A", "Left")])
def test_renaming_a_target_or_a_camera_reruns_only_what_writes_its_name(bench, old, new):
    path = bench.folder / f"renamed_{new}.usda"
    text = STAGE.replace(f'"{old}"', f'"{new}"').replace(f"/Scene/{old}", f"/Scene/{new}")
    path.write_text(text, encoding="utf-8")
    changed = reruns(bench.built({})[1], bench.keys(project_of(path).graph))
    between = {"baselines"} if old == "A" else set()
    assert set(map(kind_of, changed)) == TRUTH | {"frame_poses"} | between
    if old == "A":
        assert {name.split("/")[1] for name in changed - between} == {"Left.Camera"}
