"""Pretended builds have no stage to trace: their cameras are pinholes, as their files say."""

import json

import pytest
from exports.maps import PinholeSight, SlantedScene

from pipeline.exports import export


@pytest.fixture(autouse=True)
def sights_of_pretended_builds(monkeypatch):
    traced = export.sight_of

    def sight(out, name):
        stage = json.loads((out / "manifest.json").read_text())["stage"]
        return PinholeSight() if stage.startswith("pretended") else traced(out, name)

    monkeypatch.setattr(export, "sight_of", sight)
    beheld = export.scene_of

    def scene(out):
        stage = json.loads((out / "manifest.json").read_text())["stage"]
        return SlantedScene() if stage.startswith("pretended") else beheld(out)

    monkeypatch.setattr(export, "scene_of", scene)
