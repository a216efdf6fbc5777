"""A stage with values of the table: an occluder, a target of every kind, a conventional and a plenoptic camera, and one
with a channel that takes part where a case says so.
"""

from pathlib import Path
from typing import Any

from pxr import Sdf, Usd

STAGE = (Path(__file__).parents[1] / "data/every_attribute.usda").read_text(encoding="utf-8")


def path_of(at: str) -> str:
    return f"/Scene/{at}".rstrip("/")


def write(path: Path, values: dict[tuple[str, str], Any], is_whole: bool = True) -> Path:
    """The stage with some values of (prim, attribute), as one file; None blocks one, and a dict has its
    samples. Whole, or with two targets.
    """
    path.write_text(STAGE, encoding="utf-8")
    stage = Usd.Stage.Open(str(path))
    stage.Reload()
    stage.GetPrimAtPath("/Scene/More").SetActive(is_whole)
    targets: dict[tuple[str, str], Any] = {} if is_whole else {("", "plen:targets"): ["One", "Two"]}
    for (at, name), value in (targets | values).items():
        prim = stage.GetPrimAtPath(path_of(at))
        assert prim, at
        if isinstance(value, list) and prim.GetRelationship(name):
            prim.GetRelationship(name).SetTargets([Sdf.Path(f"/Scene/{target}") for target in value])
            continue
        attribute = prim.GetAttribute(name)
        assert attribute, f"{at} has no {name}"
        if isinstance(value, dict):
            for time, sample in value.items():
                attribute.Set(sample, time)
        else:
            attribute.Block() if value is None else attribute.Set(value)
    stage.Save()
    return path
