"""Edits between two states of a stage, each with its place in the files and a way to undo it.

An edit changes a property, a prim, metadata, or a composition arc. All values that change with a reference are one
edit, that of the reference.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd, UsdUtils

from pipeline.edits import Edit
from pipeline.scene.check.budgets import check_budgets
from pipeline.scene.check.dataset import find_dataset
from pipeline.scene.dataset import Dataset
from pipeline.scene.edits.changes import Change, changes, layer_of, metadata_of, undone, values_of
from pipeline.scene.edits.composed import Arc, Composed, composed_from_plain, site_of
from pipeline.scene.edits.places import GONE, EditPlaces, Place, place_of_gone
from pipeline.scene.read.prims import read_dataset
from pipeline.scene.usd.opening import open_stage
from pipeline.scene.usd.usda_lines import text_map


@dataclass(frozen=True, slots=True, kw_only=True)
class EditUnit:
    """Edits that are undone together.

    Attributes
    ----------
    edits : tuple of Edit
        One edit, or one per time sample.
    changes : tuple of Change
        The changes in the composed layers.
    old_times, new_times : tuple of float
        Times of all samples of a property, before and now.
    """

    edits: tuple[Edit, ...]
    changes: tuple[Change, ...]
    old_times: tuple[float, ...] = ()
    new_times: tuple[float, ...] = ()

    @property
    def prim(self) -> Sdf.Path:
        """The edited prim."""
        return self.changes[0].path.GetPrimPath()

    def at_frame(self, frame: int | None) -> tuple[Edit, ...]:
        """The edits on which a frame depends: for time samples the one at the frame, or the nearest before and after
        it.
        """
        if frame is None or not (self.old_times or self.new_times):
            return self.edits
        near = {time for times in (self.old_times, self.new_times) for time in _around(times, frame)}
        return tuple(edit for edit in self.edits if edit.time is None or edit.time in near) or self.edits


def together(units: list[EditUnit]) -> EditUnit:
    """One unit of many edits, which cannot be told apart: the first edit and the number of others."""
    first = units[0].edits[0]
    remark = f"or one of {len(units) - 1:,} further edits" if len(units) > 1 else first.remark
    return EditUnit(
        edits=(replace(first, remark=remark),), changes=tuple(one for unit in units for one in unit.changes)
    )


def edits_of_stage(path: Path, before: dict[str, Any], now: dict[str, Any]) -> "EditsOfStage | None":
    """The edits between two states of a stage, given as plain data; None if the states cannot be compared."""
    was, is_now = composed_from_plain(before), composed_from_plain(now)
    return EditsOfStage(was, is_now, open_stage(path)[0]) if was and is_now else None


class EditsOfStage:
    """The edits between the kept state of a stage and its present state.

    Parameters
    ----------
    before, now : Composed
    stage : Usd.Stage
        The present stage, opened from its files.
    """

    def __init__(self, before: Composed, now: Composed, stage: Usd.Stage) -> None:
        self._before, self._now, self._places = before, now, EditPlaces(before, now, stage)
        self._old, self._new = layer_of(before.text), layer_of(now.text)

    def units(self) -> list[EditUnit]:
        """All edits: those of references and layers first, the others in the order of their paths."""
        left, units = list(changes(self._old, self._new)), []
        for arc in self._changed_arcs():
            following = [change for change in left if self._follows(arc, change)]
            left = [change for change in left if change not in following]
            if following:
                units.append(EditUnit(edits=(self._arc_edit(arc),), changes=tuple(following)))
        return units + [self._unit(change) for change in left]

    def dataset_without(self, units: Iterable[EditUnit]) -> Dataset | None:
        """The dataset with some edits undone; None if the resulting stage cannot be read."""
        taken_back = [change for unit in units for change in unit.changes]
        return _dataset_of(undone(self._new, self._old, taken_back))

    # Composition arcs

    def _changed_arcs(self) -> list[Arc]:
        """Changed arcs, outer ones first, without those that changed because of an outer one."""
        old, new = self._before.arcs, self._now.arcs
        found: list[Arc] = []
        for arc in sorted(old.keys() | new.keys(), key=lambda arc: (arc.prim.count("/"), arc)):
            follows = any(_is_below(arc.prim, outer.prim) and arc.file != outer.file for outer in found)
            if old.get(arc) != new.get(arc) and not follows:
                found.append(arc)
        return found

    def _follows(self, arc: Arc, change: Change) -> bool:
        """Whether a change is due to an arc: its opinion has another site than before, and is not in the layer of
        the arc.
        """
        path = str(change.path)
        if not _is_below(path, arc.prim):
            return False
        if change.field:
            spec = self._places.says(change.path, change.field)
            return path != "/" and (spec is None or site_of(spec) != (arc.file, path))
        was, now = self._before.sites.get(path), self._now.sites.get(path)
        return was != now and (arc.file, path) not in (was, now)

    def _arc_edit(self, arc: Arc) -> Edit:
        old, new = (found.get(arc) for found in (self._before.arcs, self._now.arcs))
        place = place_of_gone((arc.file, arc.path), None if new else GONE)
        mentioned = text_map(arc.file).assets if Path(arc.file).is_file() else {}
        lines = [mentioned[asset] for name in new or () if (asset := name.strip("@")) in mentioned]
        if len(lines) == 1:
            place = place._replace(line=lines[0])
        values = {"old": old and ", ".join(old), "new": new and ", ".join(new)}
        return _edit(arc.prim, place, field=arc.field, **values)

    # Statements about a prim or property itself

    def _unit(self, change: Change) -> EditUnit:
        path, field = change
        if path.IsPropertyPath():
            return self._property_unit(change)
        old, new = (layer.GetPrimAtPath(path) for layer in (self._old, self._new))
        if field is None:
            edit = _edit(path, self._places.of_opinion(path), old=_shown_prim(old), new=_shown_prim(new))
        else:
            values = {"old": metadata_of(old, field), "new": metadata_of(new, field)}
            edit = _edit(path, self._places.of_metadata(path, field), field=field, **values)
        return EditUnit(edits=(edit,), changes=(change,))

    def _property_unit(self, change: Change) -> EditUnit:
        old, new = (values_of(layer.GetPropertyAtPath(change.path)) for layer in (self._old, self._new))
        differ = sorted((key for key in old.keys() | new.keys() if old.get(key) != new.get(key)), key=_order)
        values = [key for key in differ if key[0] is None] or differ  # only its type differs: then that is the edit
        edits = [self._value_edit(change.path, key, old.get(key), new.get(key)) for key in values]
        times = [tuple(sorted(time for _, time in found if time is not None)) for found in (old, new)]
        return EditUnit(edits=tuple(edits), changes=(change,), old_times=times[0], new_times=times[1])

    def _value_edit(self, path: Sdf.Path, key: tuple[str | None, float | None], old: Any, new: Any) -> Edit:
        place = self._places.of_opinion(path, key[1])
        if new is None and place.remark is None:
            place = place._replace(remark=GONE)
        return _edit(path, place, field=key[0], time=key[1], old=old, new=new)


def _edit(at: Sdf.Path | str, place: Place, **values: Any) -> Edit:
    return Edit(at=str(at), file=place.file, line=place.line, remark=place.remark, **values)


def _dataset_of(layer: Sdf.Layer) -> Dataset | None:
    delegate = UsdUtils.CoalescingDiagnosticDelegate()  # hides messages of USD about an incomplete edit
    try:
        stage = Usd.Stage.Open(layer)
        root = find_dataset(stage)
        if root is None or any(True for prim in stage.Traverse() for _ in check_budgets(prim)):
            return None
        return read_dataset(root)
    except Exception:  # a part of related edits: any failure is an answer, not a bug
        return None
    finally:
        delegate.TakeUncoalescedDiagnostics()


def _around(times: tuple[float, ...], frame: int) -> list[float]:
    """The nearest of sorted times before and after a frame, including the frame itself."""
    after = bisect_left(times, frame)
    before = bisect_right(times, frame) - 1
    return [times[index] for index in {before, after} if 0 <= index < len(times)]


def _is_below(path: str, prim: str) -> bool:
    return prim == "/" or path == prim or path.startswith((f"{prim}/", f"{prim}."))


def _shown_prim(spec: Sdf.PrimSpec | None) -> str | None:
    """A whole prim as a value of an edit."""
    return (spec.typeName or "a prim without a type") if spec else None


def _order(key: tuple[str | None, float | None]) -> tuple[str, float]:
    field, time = key
    return field or "", float("-inf") if time is None else time
