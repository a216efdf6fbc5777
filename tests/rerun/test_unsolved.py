"""Rows that may be missing: every build says so, once a frame, with names and where all of them are."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from builds import made
from places import DATA

from pipeline.engine.events import Warned
from pipeline.products.truth import make as truth


def test_each_build_warns_of_what_stays_unsolved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also the second one, which finds the table in the store; the first names stand there, all in the table."""
    solve_points = truth.solve_points

    def leaving_four(*args: object, **options: object) -> object:
        rows = solve_points(*args, **options)
        return dataclasses.replace(rows, unsolved=np.array([[3, 0], [5, 0], [6, 1], [9, 2]]))

    monkeypatch.setattr(truth, "solve_points", leaving_four)
    for _ in range(2):
        events = []
        stage, store = DATA / "tiny_plenoptic" / "dataset.usda", tmp_path / "store"
        result = made(stage, tmp_path / "out", store, on_event=events.append, until=("truth",))
        warnings = [event.text for event in events if isinstance(event, Warned) and "rows may be missing" in event.text]
        assert len(warnings) == len({*warnings}) == 2
        assert all("4 unsolved (Board point 3 behind (" in text and ", …): see the header" in text for text in warnings)
    assert result.executed == 0
