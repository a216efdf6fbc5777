"""The door of the plug-in: it answers what the core asks, which finds it by its name alone."""

import inspect

from pipeline.plugins.scenes import reader
from pipeline.scene.usd.plug_in import SceneReader


def test_the_plug_in_answers_every_question_of_the_core_with_as_many_arguments():
    asked = {name: of for name, of in vars(SceneReader).items() if not name.startswith("_")}
    assert asked.keys() == set(reader.__all__)
    for name, of in asked.items():
        self_and_more = inspect.signature(of).parameters
        assert len(inspect.signature(getattr(reader, name)).parameters) == len(self_and_more) - 1, name
