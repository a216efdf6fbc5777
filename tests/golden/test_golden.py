"""Change detectors on tiny stages, not proofs: what was built the last time somebody looked and agreed.

Stages are compared as text, correspondences in pixels; images, in test_images.py, by z-tests.
`pytest --update-golden` is the only writer; it prints old, new and their difference.
"""

import difflib
from pathlib import Path

import numpy as np
import pytest

from pipeline.files.tables import read_table, write_table

HERE = Path(__file__).parent
DATA = HERE.parent / "data"
TINY = ("tiny_conventional", "tiny_plenoptic")

TRUTH_PX = 1e-5
"""Positions are stored in double but come from float32 images: one unit in the last place moves them by 3e-6 px."""


@pytest.fixture(scope="module", params=["conventional", "plenoptic"])
def built(request):
    """Name and output folder of a tiny dataset."""
    return f"tiny_{request.param}", request.getfixturevalue(f"{request.param}_build")


def test_the_flattened_stage(built, golden):
    name, out = built
    file, new = HERE / f"{name}.usda", (out / "dataset.usda").read_text(encoding="utf-8")
    update, show = golden
    old = file.read_text(encoding="utf-8") if file.exists() else ""
    if update:
        show("\n".join(difflib.unified_diff(old.splitlines(), new.splitlines(), str(file), "new", lineterm="", n=1)))
        file.write_text(new, encoding="utf-8")
        return
    assert new == old


@pytest.mark.parametrize("frame", [1, 2])
def test_the_correspondences(built, golden, frame):
    name, out = built
    file = HERE / f"{name}.{frame:04d}.csv"
    table = read_table(out / f"frames/{frame:04d}/Rig.Camera/correspondences.csv")
    names = ("point_id", "microlens_k", "microlens_l", "x_px", "y_px", "visibility")
    new = {column: table.numbers(column) for column in names}
    update, show = golden
    old = read_table(file) if file.exists() else None
    if update:
        known = {} if old is None else {key: old.numbers(key) for key in new if key in old.columns}
        rows = {key: len(column) for key, column in known.items()}.get("x_px", 0)
        moved = np.nan
        if rows == len(new["x_px"]):
            moved = max(np.abs(known[axis] - new[axis]).max() for axis in ("x_px", "y_px"))
        show(f"{file.name}: {rows} rows -> {len(new['x_px'])} rows, largest move {moved} px")
        write_table(file, ["positions of a tiny dataset, px"], new)
        return
    assert old is not None, "no golden file: run pytest --update-golden"
    for column in ("point_id", "microlens_k", "microlens_l"):
        assert np.array_equal(old.numbers(column), new[column], equal_nan=True)
    assert np.array_equal(old.numbers("visibility"), new["visibility"])
    for axis in ("x_px", "y_px"):
        assert np.abs(old.numbers(axis) - new[axis]).max() < TRUTH_PX
