"""`pipeline graph`: frames are one node, unless somebody wants all of them."""

import json
import xml.etree.ElementTree as ET

import pytest

POSES = {"project": {"poses": [[[float(number)]] for number in range(300)]}}


@pytest.fixture
def many(stage):
    return stage(**POSES)


def test_frames_are_one_node(pipeline, many):
    code, output, _ = pipeline("graph", many)
    lines = output.splitlines()
    assert code == 0 and lines[0] == "flowchart LR"
    assert sum("[" in line for line in lines) == 4
    assert any('"image/cam/*<br/>300 maybe"' in line for line in lines)
    assert sum("-->" in line for line in lines) == 3


def test_all_tasks_and_other_formats(pipeline, many):
    groups = json.loads(pipeline("graph", many, "--all", "--format", "json")[1])["groups"]
    assert len(groups) == 303 and all(group["tasks"] == 1 for group in groups)
    dot = pipeline("graph", many, "--format", "dot")[1]
    assert dot.startswith("digraph tasks {") and '"rays/cam" -> "image/cam/*";' in dot
    lens = groups[0]
    assert (lens["name"], lens["reads"], lens["states"]) == ("lens", [], {"run": 1})


def test_the_picture_is_an_svg_with_a_box_per_node(pipeline, many, tmp_path):
    pipeline("build", many, "-j1", "--until", "image/cam/0007")
    assert pipeline("graph", many, "--picture", "graph.svg")[0] == 0
    root = ET.fromstring((tmp_path / "graph.svg").read_text())
    texts = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    assert "image/cam/*" in texts and "1 cached, 299 run" in texts
    assert len(list(root.iter("{http://www.w3.org/2000/svg}rect"))) == 5
    assert pipeline("graph", many, "--picture", "graph.png")[0] == 2
