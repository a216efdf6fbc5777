"""A drawing that cannot be written where it shall be is an error of the place: no traceback, and nothing of a file."""

import pytest
from places import ROOT, TINY

DRAWINGS = [
    ("show", TINY, "--plot", ".svg"),
    ("show", str(ROOT / "stages/lenses/cooke_triplet_50mm.usda"), "--plot", ".svg"),
    ("target", TINY, "--svg", ".svg"),
    ("target", TINY, "--pdf", ".pdf"),
]


@pytest.mark.parametrize("place", ["no/such/drawing", "file/drawing", "folder"])
@pytest.mark.parametrize(("verb", "stage", "option", "suffix"), DRAWINGS)
def test_a_drawing_into_a_place_that_does_not_exist_is_an_error_with_a_hint(
    run, tmp_path, verb, stage, option, suffix, place
):
    (tmp_path / "file").touch()
    (tmp_path / f"folder{suffix}").mkdir()
    code, _, log = run(verb, stage, option, f"{place}{suffix}")
    assert code == 5
    assert f"error: cannot write {place}{suffix}: " in log and "hint: choose another place" in log
    assert "Traceback" not in log and not list(tmp_path.rglob(f"drawing{suffix}"))
