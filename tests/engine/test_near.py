"""Whoever names nothing is told what is near, or else what there is."""

import pytest

from pipeline.engine.planning.near import hint

TASKS = ["focus/Rig.Camera", *(f"{kind}/Rig.Camera/{frame:04d}" for kind in ("image", "truth") for frame in (1, 2))]
FILES = ["dataset.usda", *(f"frames/{frame:04d}/Rig.Camera/image.png" for frame in (1, 2))]


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ("image/0001", "there is image/Rig.Camera/0001"),
        ("frames/2/image.png", "there is frames/0002/Rig.Camera/image.png"),
        ("0002", "there are frames/0002, image/Rig.Camera/0002, truth/Rig.Camera/0002"),
        ("frame/1", "did you mean 'frames/0001'?"),
        ("imgae/2", "did you mean 'image/Rig.Camera/0002'?"),
        ("frames/9", "there are frames/0001, frames/0002"),
        ("frames/0001/outlines.csv", "there is frames/0001/Rig.Camera"),
        ("something/else", "`pipeline graph` shows the tasks; their names begin with focus, image, truth"),
    ],
)
def test_a_hint_names_what_lacks_a_part_or_is_misspelt_or_stands_beside(target, said):
    assert hint(target, TASKS, FILES) == said


def test_frames_are_not_misspelt():
    """Of many frames some would be one letter away: it is another frame, and would be built in vain."""
    frames = [f"truth/Cam/{frame:04d}" for frame in range(1, 200)]
    assert "did you mean" not in hint("truth/Cam/0999", frames, [])


def test_a_hint_of_many_names_is_short():
    assert len(hint("Cam", [f"truth/Cam{frame}/Cam" for frame in range(1000)], [])) < 200
