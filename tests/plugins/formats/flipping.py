"""Exports by a wrong convention, for tests that its reader notices."""

from collections.abc import Iterable, Iterator
from dataclasses import fields, replace
from typing import Any

import pytest

from pipeline.exports.export import export
from pipeline.formats import Convention, Pose, format_of, module_of

NUMBERS = ("origin", "axes", "board", "unit")
"""Fields that change numbers alone: the reader reads them and finds other values. Poses and rotations of another kind
are of another shape, too, on which writer or reader may stumble."""


OF_POSES = ("centre", "camera_axes")
"""Fields that are no claim of a format without poses."""


def flips(names: Iterable[str], unseen: Iterable[tuple[str, str]] = ()) -> Iterator[Any]:
    """Every other value of every field of the conventions of formats; "none" is no claim."""
    for name in names:
        record = format_of(name)
        for field in fields(Convention):
            stated = getattr(record, field.name)
            is_seen = (name, field.name) not in unseen and ("*", field.name) not in unseen
            if stated.name == "NONE" or not is_seen or (field.name in OF_POSES and record.pose is Pose.NONE):
                continue
            for other in field.type:
                if other is not stated and other.name != "NONE":
                    yield pytest.param(name, field.name, other, id=f"{name}-{field.name}-{other.name}")


def require_notice(check, built, name, flip, tmp_path, monkeypatch):
    """Fail unless a check, `check(folder)`, objects to the export of a build by a convention with one other field."""
    ((field, other),) = flip.items()
    monkeypatch.setattr(module_of(name), "FORMAT", replace(format_of(name), **{field: other}))
    try:
        (folder,) = export(built, [name], tmp_path)
        check(folder)
    except AssertionError:
        return
    except Exception as error:
        assert field not in NUMBERS and not isinstance(error, ImportError), repr(error)
        return
    pytest.fail("the reader noticed nothing")
