"""Pretended builds have no stage to trace: their cameras are pinholes, as their files say."""

import json

import pytest
from exports.maps import PinholeSight, SlantedScene

from pipeline.exports import gathering


@pytest.fixture(autouse=True)
def sights_of_pretended_builds(monkeypatch):
    traced = gathering.sight_of

    def sight(out, name):
        stage = json.loads((out / "manifest.json").read_text())["stage"]
        return PinholeSight() if stage.startswith("pretended") else traced(out, name)

    monkeypatch.setattr(gathering, "sight_of", sight)
    beheld = gathering.scene_of

    def scene(out):
        stage = json.loads((out / "manifest.json").read_text())["stage"]
        return SlantedScene() if stage.startswith("pretended") else beheld(out)

    monkeypatch.setattr(gathering, "scene_of", scene)
