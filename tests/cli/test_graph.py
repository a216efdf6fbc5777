"""`pipeline graph`: frames are one node, unless somebody wants all of them."""

import json

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


def test_all_tasks_as_json(pipeline, many):
    groups = json.loads(pipeline("graph", many, "--all", "--json")[1])["groups"]
    assert len(groups) == 303 and all(group["tasks"] == 1 for group in groups)
    lens = groups[0]
    assert (lens["name"], lens["reads"], lens["states"]) == ("lens", [], {"run": 1})


def test_a_node_counts_its_tasks_by_state(pipeline, many):
    pipeline("build", many, "-j1", "--until", "image/cam/0007")
    assert '"image/cam/*<br/>1 cached, 299 run"' in pipeline("graph", many)[1]
