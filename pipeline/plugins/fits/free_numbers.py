"""Numbers of a stage that a fit may correct, how far they may be off, and the dataset with corrected ones.

A stage is opened once. It is read again for each correction, with all that follows from it: of a camera that is focused
at a distance, a radius moves the focus, too.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.app.stages import sound
from pipeline.errors import UsageError
from pipeline.scene.dataset import Dataset
from pipeline.scene.load import require_dataset
from pipeline.scene.plen_dataset import find_dataset, read_dataset
from pipeline.scene.tolerances import Tolerance, tolerances_of
from pipeline.scene.usd.opening import open_stage, write_out_instances
from pipeline.scene.usd.overrides import entries, layer_of, moved_by, overridden, samples_of
from pipeline.scene.usd.problems import StageError, of_reader
from pipeline.scene.usd.readers import notes_of
from pipeline.scene.usd.roots import allowed_roots
from pipeline.scene.usd.values import UnreadableValue, rule_of, target_paths
from pipeline.scene.varied import varied_numbers
from pipeline.scene.write.poses import posed
from pipeline.scene.write.text import lay_over, text_of
from pipeline.spelling import did_you_mean

_ENTRY = re.compile(r"(.*)\[(\d+)\]")
_NORMAL = ("normal", "truncated")


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeNumber:
    """A number that a fit may correct, or several that are off together.

    `before`: its value on the stage; `step`: that of its derivatives; `entries`: attributes, and the entry of each.
    """

    name: str
    unit: str
    before: float
    step: float
    prior: Tolerance | None
    entries: tuple[tuple[Any, int], ...]

    @property
    def deviation(self) -> float:
        """Standard deviation of its errors before the fit; infinite where nothing pulls it back."""
        return self.prior.spread if self.prior and self.prior.distribution in _NORMAL else np.inf

    @property
    def reach(self) -> float:
        """Largest error that it may have."""
        reach = self.prior.reach if self.prior else None
        return np.inf if reach is None else reach


class FreeStage:
    """A dataset whose numbers may be corrected.

    `numbers`: those that are free; `fixed`: names of numbers that were asked for, and have a tolerance of no width.
    """

    def __init__(self, path: Path, names: Sequence[str], allow_roots: Iterable[str | Path] = ()) -> None:
        """StageError or UsageError: the dataset does not pass `check`, or there is no such number."""
        self.path, self.roots = path, allowed_roots(path, tuple(allow_roots))
        self.nominal = require_dataset(sound(path, allow_roots), path)
        self._stage, _ = open_stage(path)
        write_out_instances(self._stage)  # or nothing below one could have another number
        notes_of(self._stage).folders = self.roots
        self._root: Any = find_dataset(self._stage)
        self.numbers: tuple[FreeNumber, ...] = ()
        self.fixed: list[str] = []
        tolerances, numbers = tolerances_of(self._stage), dict[str, FreeNumber]()
        for name in names:
            for attribute, entry in self._attributes_named(name, tolerances):
                tolerance = tolerances.get(attribute.GetPath())
                for number in self._numbers_of(attribute, entry, tolerance):
                    if tolerance and not tolerance.spread:
                        self.fixed.append(number.name)
                    else:
                        numbers[number.name] = number
        self.numbers = tuple(numbers.values())

    def _attributes_named(self, name: str, tolerances: Mapping[Any, Tolerance]) -> list[tuple[Any, int | None]]:
        """Attributes that a name means, each with the entry that alone is meant, if one is: a property, all that a
        tolerance is of, or all with tolerances below a prim.
        """
        match = _ENTRY.fullmatch(name)
        path, entry = (match[1], int(match[2])) if match else (name, None)
        path = path if path.startswith("/") else f"{self._root.GetPath()}/{path}"
        prims = list(self._stage.Traverse())
        attributes = {str(attribute.GetPath()): attribute for prim in prims for attribute in prim.GetAttributes()}
        if path in attributes:
            return [(attributes[path], entry)]
        of_prims = [prim for prim in prims if f"{prim.GetPath()}/".startswith(f"{path}/")]
        relationships = [prim.GetRelationship("plen:tolerance:of") for prim in of_prims]
        tolerated = [key for relationship in relationships for key in target_paths(relationship)]
        tolerated = tolerated or [key for key in tolerances if str(key).startswith(f"{path}/")]
        if not tolerated:
            authored = [key for key, attribute in attributes.items() if attribute.HasAuthoredValue()]
            of_prim = [key for key in authored if key.startswith(f"{path}.plen:")]
            hint = f"name one of {', '.join(of_prim)}" if of_prim else did_you_mean(path, authored)
            hint = hint or 'the path of a property: "/Rig/Lens/Front.plen:radius"'
            raise UsageError(f"{self.path} has no property {name!r}, and no tolerances below it", hint=hint)
        return [(self._stage.GetAttributeAtPath(key), None) for key in tolerated]

    def _numbers_of(self, attribute: Any, entry: int | None, prior: Tolerance | None) -> list[FreeNumber]:
        """The numbers of an attribute, or of one entry: one for all entries, if these are off together."""
        try:
            varied = list(varied_numbers(self._stage, attribute.GetPath(), lambda _: None))
        except UnreadableValue as error:
            raise StageError([of_reader(error.thing, error)]) from None
        if entry is not None and entry >= len(varied):
            raise UsageError(f"{attribute.GetPath()} has {len(varied)} numbers, none is [{entry}]")
        values = entries(next(iter(samples_of(attribute).values())))
        alone = range(len(varied)) if entry is None else [entry]
        groups = [range(len(varied))] if prior and prior.is_common else [[i] for i in alone]
        return [
            FreeNumber(
                name=varied[group[0]].name if len(group) == 1 else str(attribute.GetPath()),
                unit=varied[group[0]].unit,
                before=float(values[group[0]]),
                step=varied[group[0]].step,
                prior=prior,
                entries=tuple((attribute, i) for i in group),
            )
            for group in groups
        ]

    def _corrected(self, correction: np.ndarray) -> dict[Any, Any]:
        """Values of attributes with numbers corrected; UnreadableValue: one leaves the range that its schema states."""
        values: dict[Any, Any] = {}
        for number, change in zip(self.numbers, correction.tolist(), strict=True):
            for attribute, entry in number.entries if change else ():
                path = attribute.GetPath()
                samples = values.get(path) or samples_of(attribute)
                values[path] = {time: moved_by(value, entry, change) for time, value in samples.items()}
                rule = rule_of(attribute.GetPrim(), attribute.GetName())
                if rule is not None and not all(map(rule.holds, values[path].values())):
                    raise UnreadableValue(f"<{number.name}> would leave its range, {rule.span}", attribute)
        return values

    def at(self, correction: np.ndarray) -> Dataset:
        """The dataset with corrected numbers, (m,) of them; PipelineError: there is no such camera."""
        stage = overridden(self._stage, self._corrected(correction))  # prims live as long as their stage
        return read_dataset(find_dataset(stage))

    def neighbours(self, correction: np.ndarray) -> list[tuple[Dataset, Dataset]]:
        """The datasets beside that one, with each number a step less, and a step more."""
        steps = np.diag([number.step for number in self.numbers])
        return [(self.at(correction - step), self.at(correction + step)) for step in steps]

    def layer(
        self, out: Path, correction: np.ndarray, poses: Mapping[str, Mapping[int, np.ndarray]], about: str
    ) -> str:
        """Text of a layer that will lie at `out` over the stage: corrected numbers, and poses of targets by prim
        path.
        """
        overrides = self._corrected(correction)
        for prim_path, samples in poses.items():
            overrides |= posed(self._stage, prim_path, samples)
        layer = layer_of(self._stage, overrides)
        lay_over(self.path, layer, out, [about])
        return text_of(layer)
