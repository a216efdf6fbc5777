"""Instances: prims that share their children in USD. Here each gets its own."""

from collections.abc import Iterator

from pxr import Sdf, Usd

from pipeline.scene.usd.problems import Problem, shown_path
from pipeline.scene.usd.usda_lines import line_of


def write_out_instances(stage: Usd.Stage) -> None:
    """Turn every instance into an ordinary prim, by the session layer, so that no file changes."""
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        while instances := [prim for prim in stage.TraverseAll() if prim.IsInstance()]:
            for prim in instances:
                prim.SetInstanceable(False)


def check_instances(stage: Usd.Stage) -> list[Problem]:
    """Write the instances out, and report opinions on prims below them, which USD ignores.

    Afterwards these opinions count, so such a stage must not be read.
    """
    everything = list(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)))
    before = {prim.GetPath(): list(prim.GetPrimStack()) for prim in everything if prim.IsInstanceProxy()}
    tops = [prim.GetPath() for prim in everything if prim.IsInstance()]
    write_out_instances(stage)
    problems = []
    for top in reversed(tops):  # nested instances first
        if ignored := list(_ignored(stage.GetPrimAtPath(top), before)):
            problems.append(_problem(top, ignored))
        before |= {prim.GetPath(): prim.GetPrimStack() for prim in _range(stage.GetPrimAtPath(top))}
    return problems[::-1]


def _ignored(top: Usd.Prim, before: dict[Sdf.Path, list[Sdf.PrimSpec]]) -> Iterator[Sdf.PrimSpec]:
    """Opinions on prims below an instance that count only since it was written out; for each prim strongest first."""
    session = top.GetStage().GetSessionLayer()
    for prim in _range(top):
        known = before.get(prim.GetPath(), [])
        yield from (spec for spec in prim.GetPrimStack() if prim != top and spec.layer != session and spec not in known)


def _range(top: Usd.Prim) -> Iterator[Usd.Prim]:
    return iter(Usd.PrimRange(top, Usd.PrimAllPrimsPredicate))


def _problem(top: Sdf.Path, ignored: list[Sdf.PrimSpec]) -> Problem:
    first = ignored[0]
    names = list(dict.fromkeys(spec.name for spec in ignored if spec.layer == first.layer))
    file = first.layer.realPath
    return Problem(
        code="below-instance",
        message=f"USD ignores the opinions on {', '.join(names[:4])}, because <{top}> is an instance",
        file=shown_path(file) if file else None,
        line=line_of(file, str(first.path)) if file else None,
        at=str(top),
        hint=f"remove instanceable = true from <{top}>, or say it in the file that it refers to",
    )
