"""Edits as a person makes them, in several files at once: what a plan says of them, word by word."""

import re
from pathlib import Path

import pytest
from places import DATA
from rerun.pretended import Pretended, project_of
from stage_text import edited

from pipeline.app.why import with_edits
from pipeline.engine.planning.explain import describe_task
from pipeline.engine.planning.plan import plan
from pipeline.engine.store.store import Store
from pipeline.folders import shipped_folder

TWO = """    def PlenCheckerboard "Two"
    {
        uniform int plen:columns = 3
        uniform int plen:rows = 2
        uniform double plen:squareSize = 1.1
        double3 xformOp:translate = (3, 0, -450)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


class Desk:
    """A dataset and its rig in one folder, which count as built; edited as text."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.stage, self.rig = folder, folder / "dataset.usda", folder / "rig.usda"
        text = (DATA / "tiny_conventional/dataset.usda").read_text(encoding="utf-8")
        text = text.replace("@../../../stages/rigs/conventional_100mm.usda@", "@rig.usda@")
        self.stage.write_text(text, encoding="utf-8")
        rig = (shipped_folder("stages") / "rigs/conventional_100mm.usda").read_text(encoding="utf-8")
        self.rig.write_text(rig.replace("@../", "@"), encoding="utf-8")
        self.before = Pretended(self.stage, Store(folder / "store"))

    def edit(self, file: Path, *changes: tuple[str, str]) -> None:
        file.write_text(edited(file.read_text(encoding="utf-8"), *changes), encoding="utf-8")

    def line(self, file: Path, words: str) -> int:
        lines = file.read_text(encoding="utf-8").splitlines()
        (number,) = (number for number, line in enumerate(lines, 1) if words in line)
        return number

    def edits(self, name: str) -> list[str]:
        (task,) = (task for task in self.before.planned(project_of(self.stage)) if task.name == name)
        return [line.strip() for line in list(describe_task(task))[1:]]


@pytest.fixture
def desk(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Desk(tmp_path)


def test_each_of_several_edits_is_told_by_the_tasks_that_depend_on_it(desk):
    desk.edit(desk.rig, ("plen:semiDiameter = 4.5", "plen:semiDiameter = 4"))
    desk.edit(desk.stage, ("squareSize = 1.4", "squareSize = 1.5"), ("2: (0.3, -0.2, -432)", "2: (0.3, -0.2, -430)"))
    rig, stage = "/TinyConventional/Rig", "/TinyConventional/Board"
    stop = f"rig.usda:{desk.line(desk.rig, 'semiDiameter')}: <{rig}/Lens/Stop.plen:semiDiameter>: 4.5 -> 4"
    size = f"dataset.usda:{desk.line(desk.stage, 'squareSize')}: <{stage}.plen:squareSize>: 1.4 -> 1.5"
    move = f"dataset.usda:{desk.line(desk.stage, '2: (0.3')}: <{stage}.xformOp:translate> at frame 2:"
    move += " (0.3, -0.2, -432) -> (0.3, -0.2, -430)"
    wait = [f"{name}/Rig.Camera must run first" for name in ("camera", "white")]
    assert desk.edits("camera/Rig.Camera") == [stop]
    assert sorted(desk.edits("image/Rig.Camera/0001")) == sorted([stop, size, *wait])
    assert sorted(desk.edits("image/Rig.Camera/0002")) == sorted([stop, size, move, *wait])


def test_another_reference_is_one_edit_whatever_follows_from_it(desk):
    desk.edit(desk.rig, ("double_gauss_100mm_tronnier", "double_gauss_100mm_mandler"))
    old, new = (f"@lenses/double_gauss_100mm_{name}.usda@" for name in ("tronnier", "mandler"))
    line = desk.line(desk.rig, "mandler")
    assert desk.edits("camera/Rig.Camera") == [
        f"rig.usda:{line}: </TinyConventional/Rig/Lens> references: {old} -> {new}"
    ]


def test_a_new_target_and_one_that_goes_are_told_as_prims(desk):
    before = desk.stage.read_text(encoding="utf-8")
    targets = "rel plen:targets = </TinyConventional/Board>"
    desk.edit(desk.stage, (targets, targets.replace("<", "[<") + ", </TinyConventional/Two>]"))
    text = desk.stage.read_text(encoding="utf-8")
    desk.stage.write_text(text.rstrip().removesuffix("}") + TWO, encoding="utf-8")
    line = desk.line(desk.stage, 'PlenCheckerboard "Two"')
    new = f"dataset.usda:{line}: </TinyConventional/Two>: new, PlenCheckerboard"
    assert desk.edits("frame_poses/Rig.Camera") == [new]
    desk.before = Pretended(desk.stage, Store(desk.folder / "other"))
    desk.stage.write_text(before, encoding="utf-8")
    line = desk.line(desk.stage, 'PlenDataset "TinyConventional"')
    gone = f"dataset.usda:{line}: </TinyConventional/Two>: gone, was PlenCheckerboard"
    assert desk.edits("frame_poses/Rig.Camera") == [gone]


def test_what_is_gone_is_told_at_the_prim_that_held_it(desk):
    """The orientation goes, with its name in the order of operations."""
    desk.edit(desk.stage, (', "xformOp:orient"]', "]"))
    text = desk.stage.read_text(encoding="utf-8")
    desk.stage.write_text(re.sub(r"        quatd xformOp:orient.*?}\n", "", text, flags=re.DOTALL), encoding="utf-8")
    told = desk.edits("image/Rig.Camera/0002")
    line = desk.line(desk.stage, 'PlenCheckerboard "Board"')
    assert told[0].startswith(f"dataset.usda:{line}: </TinyConventional/Board.xformOp:orient> at frame 2: (0.97629")
    assert told[0].endswith("-> not set")
    assert told[1].startswith(f"dataset.usda:{desk.line(desk.stage, 'xformOpOrder')}: ")
    assert len(told) == 2, "nothing of frame 1"


def test_a_new_frame_is_told_by_the_metadata_of_the_layer(desk):
    desk.edit(
        desk.stage,
        ("endTimeCode = 2", "endTimeCode = 3"),
        ("2: (0.3, -0.2, -432),", "2: (0.3, -0.2, -432), 3: (0, 0, -440),"),
        ("0.21643961393810288, 0),", "0.21643961393810288, 0), 3: (1, 0, 0, 0),"),
    )
    line = desk.line(desk.stage, "endTimeCode")
    assert desk.edits("image/Rig.Camera/0003") == [f"dataset.usda:{line}: endTimeCode of the layer: 2 -> 3"]


def test_what_only_makes_sense_together_is_told_together(desk):
    """A board must have columns plus rows odd: neither edit can be taken back alone. The pose has its own."""
    desk.edit(desk.stage, ("columns = 3", "columns = 4"), ("rows = 2", "rows = 3"), ("(0, 0, -434.4)", "(0, 0, -434)"))
    attributes = ["plen:columns", "plen:rows", "xformOp:translate"]
    assert [re.findall(r"Board\.([\w:]+)", line)[0] for line in desk.edits("image/Rig.Camera/0001")] == attributes
    assert [re.findall(r"Board\.([\w:]+)", line)[0] for line in desk.edits("frame_poses/Rig.Camera")] == attributes[2:]


def test_a_setting_of_the_truth_is_told_by_its_own_attribute_beside_a_turned_board(desk):
    """The turned board shows in derived numbers alone; records of settings name attributes of the stage."""
    rays, orient = "uniform bool plen:truth:rays = 1", "1: (0.9990482215818578, 0, 0, 0.043619387365336)"
    desk.edit(
        desk.stage,
        (rays, f"{rays}\n            uniform double plen:truth:accuracy = 0.002"),
        (orient, "1: (1, 0, 0, 0)"),
    )
    tasks = {task.name: task for task in desk.before.planned(project_of(desk.stage))}
    reasons = {reason.field: reason for reason in tasks["truth/Rig.Camera/0001"].reasons if reason.edits}
    told = {edit.at for edit in reasons["params.table.settings.accuracy_px"].edits}
    assert told == {"/TinyConventional/Rig/Camera.plen:truth:accuracy"}
    poses = [reason.edits for field, reason in reasons.items() if "vision_from_target" in field]
    assert poses and {edit.at for edits in poses for edit in edits} == {"/TinyConventional/Board.xformOp:orient"}


def test_a_task_is_compared_with_the_stage_that_it_was_built_from(desk):
    """What was built in between says nothing of tasks that are older."""
    first = desk.before
    desk.edit(desk.stage, ("squareSize = 1.4", "squareSize = 1.45"))
    between = project_of(desk.stage).source
    desk.edit(desk.stage, ("squareSize = 1.45", "squareSize = 1.5"))
    now, name = project_of(desk.stage), "image/Rig.Camera/0001"
    tasks = plan(now.graph, first.store, first.keys)
    for sources, old in (({}, None), ({"": between}, 1.45), ({"": between, name: first.project.source}, 1.4)):
        (image,) = (task for task in with_edits(tasks, now, sources, desk.stage) if task.name == name)
        assert [edit.old for edit in image.edits] == ([] if old is None else [old])
        assert ("params.view.targets[0]" in str(list(describe_task(image)))) == (old is None)
