"""Pretended builds have no stage to trace: their cameras are pinholes, as their files say."""

import json

import pytest
from plugins.formats.maps import PinholeSight, SlantedScene
from plugins.formats.pretended import Scene, write_build

from pipeline.exports import export
from pipeline.results.output import open_output


@pytest.fixture(scope="session")
def out(tmp_path_factory):
    """Output folder of pinholes before a board, which no test changes."""
    return write_build(tmp_path_factory.mktemp("pretended") / "out", Scene())


@pytest.fixture(scope="session")
def output(out):
    return open_output(out)


@pytest.fixture(autouse=True)
def sights_of_pretended_builds(monkeypatch):
    def stand_in(name, pretended):
        real = getattr(export, name)

        def chosen(out, *camera):
            stage = json.loads((out / "manifest.json").read_text())["stage"]
            return pretended() if stage.startswith("pretended") else real(out, *camera)

        monkeypatch.setattr(export, name, chosen)

    stand_in("sight_of", PinholeSight)
    stand_in("scene_of", SlantedScene)
