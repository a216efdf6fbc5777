"""Exports by a wrong convention, for tests that its reader notices."""

from dataclasses import replace

import pytest

from pipeline.exports.conventions import CONVENTIONS
from pipeline.exports.export import export

NUMBERS = ("origin", "axes", "board", "unit")
"""Fields that change numbers alone: the reader reads them and finds other values. Poses and rotations of another kind
are of another shape, too, on which writer or reader may stumble."""


def require_notice(check, built, name, flip, tmp_path, monkeypatch):
    """Fail unless a check, `check(folder)`, objects to the export of a build by a convention with one other field."""
    ((field, other),) = flip.items()
    monkeypatch.setitem(CONVENTIONS, name, replace(CONVENTIONS[name], **{field: other}))
    try:
        (folder,) = export(built, [name], tmp_path)
        check(folder)
    except AssertionError:
        return
    except Exception as error:
        assert field not in NUMBERS and not isinstance(error, ImportError), repr(error)
        return
    pytest.fail("the reader noticed nothing")
