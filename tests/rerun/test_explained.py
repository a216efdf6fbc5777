"""Every edit of a stage is named by the plan: attribute, frame, line, old and new value.

Nothing is traced. What was edited is known from the test; the line is looked for in the text by its words alone.
"""

from pathlib import Path

import pytest
from rerun.attribute_stage import path_of, write
from rerun.attribute_table import CASES, LENS, STOP, A
from rerun.pretended import Pretended

from pipeline.engine.store.store import Store

QUICK = {("plen:squareSize", "One"), ("plen:apertureShape", STOP)}
ALL = [
    pytest.param(n, c, id=f"{n} of {c.at or 'Scene'}", marks=[pytest.mark.heavy] * ((n, c.at) not in QUICK))
    for n, cases in CASES.items()
    for c in cases
    if c.kinds
]
FOR_THE_CHECKS = {
    (LENS, "plen:wavelength"): (A, "plen:camera:wavelength"),
    (A, "plen:image:exposure"): (A, "plen:image:whiteLevel"),
    (STOP, "plen:apertureShape"): (STOP, "plen:blades"),
}
"""Attributes that no task reads, and those that change with them: the checks alone want the wavelength of printed
indices to be that of the camera, and tasks read how much light there is and how many blades, not what says so."""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Stages of the table that count as built, by what is given."""
    known = {}

    def of(given):
        if (name := repr(sorted(given.items(), key=repr))) not in known:
            folder = tmp_path_factory.mktemp("explained")
            path = folder / "dataset.usda"
            known[name] = Pretended(write(path, given), Store(folder / "store")), path
        return known[name]

    return of


@pytest.mark.parametrize(("name", "case"), ALL)
def test_every_attribute_of_the_table_is_named_with_its_line_by_all_tasks_that_it_reruns(built, name, case):
    before, path = built(case.given)
    changed = {**case.along, (case.at, name): case.value}
    tasks = before.planned(write(path, {**case.given, **changed}))
    assert tasks
    for task in tasks:
        assert [str(reason) for reason in task.reasons if not reason.edits] == [], task.name
        assert {edit.at for edit in task.edits} <= {f"{path_of(place)}.{one}" for place, one in changed}
    at, name = FOR_THE_CHECKS.get((case.at, name), (case.at, name))
    edit = next(edit for task in tasks for edit in task.edits if edit.at == f"{path_of(at)}.{name}")
    assert edit.old != edit.new
    assert name in _line(path, edit)


def _line(path, edit):
    assert Path(edit.file).name == path.name
    return path.read_text(encoding="utf-8").splitlines()[edit.line - 1]
