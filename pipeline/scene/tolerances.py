"""Cameras as built: tolerances of numbers of a stage, errors drawn by them, and a layer over the stage for each camera.

An error is a function of the seed of the dataset, the member, the path of its property and the entry there, and of
nothing else: another tolerance, or a further member, changes none that was drawn before.
"""

from collections.abc import Iterator, Set
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from statistics import NormalDist
from typing import Any

from pxr import Sdf, Usd

from pipeline.scene.usd.opening import open_stage
from pipeline.scene.usd.overrides import Samples, entries, layer_of, moved_by, name_of, samples_of, unit_of
from pipeline.scene.usd.problems import Problem, problem, warning
from pipeline.scene.usd.values import need, read, rule_of, target_paths
from pipeline.scene.write.text import lay_over, text_of

_OF = "plen:tolerance:of"
_NORMAL = NormalDist()
_FIELDS = ("distribution", "spread", "limit")
_QUATERNIONS = ("quatd", "quatf", "quath")
_BITS = 52
"""Bits of a random number: its middle is then a double that is neither 0 nor 1."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """A distribution of errors of a number about 0, in its unit; `limit` of a truncated one counts in its spread, and
    numbers of one property have a common error if `is_common`.
    """

    distribution: str
    spread: float
    limit: float
    is_common: bool = False

    def error(self, probability: float) -> float:
        """The error below which a random one lies with a probability between 0 and 1: the inverse distribution."""
        if self.distribution == "uniform":
            return self.spread * (2 * probability - 1)
        if self.distribution == "truncated":
            beyond = _NORMAL.cdf(-self.limit)
            probability = beyond + probability * (1 - 2 * beyond)
        return self.spread * _NORMAL.inv_cdf(probability)

    @property
    def reach(self) -> float | None:
        """The largest error; None: there is none."""
        return {"uniform": self.spread, "truncated": self.limit * self.spread}.get(self.distribution)


@dataclass(frozen=True, slots=True)
class DrawnNumber:
    """A number of one member, and how far it is off what the stage states; `unit` is empty where none is stated."""

    name: str
    unit: str
    error: float


def random_share(seed: int, member: int, path: str, entry: int) -> float:
    """The random number, uniform between 0 and 1, of an entry of a property in a member."""
    digest = blake2b(f"{seed} {member} {entry} {path}".encode(), digest_size=8).digest()
    return ((int.from_bytes(digest, "big") >> (64 - _BITS)) + 0.5) / 2**_BITS


def layer_of_member(stage: Path, member: int, out: Path) -> tuple[str, list[DrawnNumber]]:
    """The text of the layer of a member that will lie at `out` over a stage that passed the checks, and the errors
    drawn.
    """
    composed, _ = open_stage(stage)
    seed = need(composed.GetDefaultPrim(), "plen:seed")
    values = dict[Sdf.Path, Samples]()
    numbers = []
    for path, tolerance in tolerances_of(composed).items():
        attribute = composed.GetAttributeAtPath(path)
        samples = samples_of(attribute)
        first = next(iter(samples.values()))
        for i in range(len(entries(first))):
            entry = 0 if tolerance.is_common else i
            error = tolerance.error(random_share(seed, member, str(path), entry))
            numbers.append(DrawnNumber(name_of(path, first, i), unit_of(attribute), error))
            samples = {time: moved_by(value, i, error) if error else value for time, value in samples.items()}
        if tolerance.spread:
            values[path] = samples
    layer = layer_of(composed, values)
    about = f"Member {member} of an ensemble of cameras as built, written by pipeline ensemble."
    lay_over(stage, layer, out, [about])  # changes the layer in place
    return text_of(layer), numbers


def tolerances_of(stage: Usd.Stage) -> dict[Sdf.Path, Tolerance]:
    """The tolerance of each property that has one, on a stage that passed the checks."""
    by_path = dict[Sdf.Path, Tolerance]()
    for prim in _tolerances(stage):
        stated = (need(prim, f"plen:tolerance:{name}") for name in (*_FIELDS, "together"))
        by_path |= dict.fromkeys(target_paths(prim.GetRelationship(_OF)), Tolerance(*stated))
    return by_path


def check_tolerance(prim: Usd.Prim) -> Iterator[Problem]:
    """Problems of a PlenTolerance: properties that can have none, have another one, or may leave their range."""
    stage = prim.GetStage()
    relationship = prim.GetRelationship(_OF)
    stated = [read(prim, f"plen:tolerance:{name}") for name in _FIELDS]
    reach = None if None in stated else Tolerance(*stated).reach
    before = [other for other in _tolerances(stage) if other.GetPath() < prim.GetPath()]
    for path in target_paths(relationship):
        if not stage.GetObjectAtPath(path):
            continue  # the check of relationships reports it
        attribute = stage.GetAttributeAtPath(path)
        samples = samples_of(attribute)
        if reason := _why_fixed(attribute, samples):
            message = f"<{path}> can have no tolerance: {reason}"
            hint = "name a property that holds finite numbers with a point; a plane may have a radius of 1e6"
            if attribute and str(attribute.GetTypeName()) in _QUATERNIONS:
                hint = "add an operation such as xformOp:rotateXYZ:asBuilt of (0, 0, 0), and name that"
            yield problem(relationship, "no-tolerance", message, hint=hint)
            continue
        for other in before:
            if path in target_paths(other.GetRelationship(_OF)):
                message = f"<{path}> has a tolerance already, of <{other.GetPath()}>"
                yield problem(relationship, "two-tolerances", message, hint="write one of the spread of both")
        rule = rule_of(attribute.GetPrim(), attribute.GetName())
        if rule is None or reach is None:
            continue
        ends = (_all_moved(value, sign * reach) for value in samples.values() for sign in (-1, 1))
        if not all(map(rule.holds, ends)):
            message = f"with an error of {reach:g} <{path}> leaves its range, {rule.span}"
            yield problem(relationship, "out-of-range", message, hint="make the spread smaller")


def check_effect(stage: Usd.Stage, used: Set[str]) -> Iterator[Problem]:
    """A warning for each number with a tolerance that no record uses; `used` holds the paths that records use."""
    for prim in _tolerances(stage):
        relationship = prim.GetRelationship(_OF)
        for path in target_paths(relationship):
            if not used & {str(path), str(path.GetPrimPath())}:
                message = f"no camera or target of the dataset is made of <{path}>: its tolerance has no effect"
                hint = "the attributes of a Camera itself serve viewers; light follows those of PlenCameraAPI"
                yield warning(relationship, "unused-tolerance", message, hint=hint)


def _why_fixed(attribute: Usd.Attribute, samples: Samples) -> str | None:
    """Reason why a property can have no tolerance; None: it can."""
    if not attribute:
        return "it is no property"
    if attribute.GetPrim().IsInstanceProxy():
        return "USD ignores what is written below an instance"
    if not samples:
        return "it is not written"
    value = next((value for value in samples.values() if not len(entries(value))), None)
    return None if value is None else f"it is {value}"


def _tolerances(stage: Usd.Stage) -> list[Usd.Prim]:
    """All tolerances of a stage, in the order of their paths."""
    prims = (prim for prim in stage.Traverse(Usd.TraverseInstanceProxies()) if prim.IsA("PlenTolerance"))
    return sorted(prims, key=Usd.Prim.GetPath)


def _all_moved(value: Any, by: float) -> Any:
    """A value of USD with all of its numbers moved."""
    for i in range(len(entries(value))):
        value = moved_by(value, i, by)
    return value
