"""Example 04: lamps, coat and wall are in its images alone."""

from pathlib import Path

from places import ROOT
from stage_text import stage_in

from pipeline.products.graph import graph_of
from pipeline.scene.load import open_dataset

LIT = (ROOT / "examples/04_stereo_colour/dataset.usda").read_text(encoding="utf-8")
OF_TRUTH = {"truth", "certificate"}


def tasks_of(folder: Path, text: str) -> dict[str, tuple[str, object]]:
    folder.mkdir()
    stage = stage_in(folder, text)
    graph = graph_of(open_dataset(stage))[0]
    return {name: (graph[name].short_kind, graph[name].params) for name in graph}


def test_a_lamp_changes_images_and_no_task_of_the_truth(tmp_path):
    """A brighter softbox and a rougher board; the wall, which lamps make visible, stays what it was."""
    edited = LIT.replace("inputs:intensity = 55", "inputs:intensity = 20").replace("roughness = 0.2", "roughness = 0.4")
    assert edited != LIT
    before, after = tasks_of(tmp_path / "lit", LIT), tasks_of(tmp_path / "dimmer", edited)
    changed = {before[name][0] for name in before if before[name] != after[name]}
    assert before.keys() == after.keys()
    assert changed == {"image"}
    assert {kind for kind, _ in before.values()} >= OF_TRUTH
