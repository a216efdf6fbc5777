"""The hint for a name that no task and no file has."""

import pytest

from pipeline.engine.planning.graph import names_like

NAMES = ["focus/Cam", "image/Cam/0001", "image/Cam/0002", "frames/0001/Cam/image.png"]


@pytest.mark.parametrize(
    ("target", "hint"),
    [
        ("image/0009", "there are image/Cam/0001, image/Cam/0002"),
        ("imgae/2", 'did you mean "image"?'),
        ("other/2", "`pipeline graph` shows the tasks; their names begin with focus, frames, image"),
    ],
)
def test_a_hint_names_what_is_near_or_what_there_is(target, hint):
    assert names_like(target, NAMES) == hint


def test_a_hint_of_many_names_is_short():
    assert len(names_like("image", [f"image/Cam{number}" for number in range(1000)])) < 200
