"""All checks of a stage, in one pass. No task runs on a stage with an error.

USD silently composes a stage with a typing error in every attribute. So the checks are strict about names, types,
tokens and ranges, and then ask whether the parts can be built.
"""

from collections.abc import Callable, Iterable, Set
from pathlib import Path

from pxr import Sdf, Usd

from pipeline.scene.camera import check_camera, check_planes
from pipeline.scene.channels import check_channel, check_illuminant
from pipeline.scene.check.asset_roots import check_assets, check_used
from pipeline.scene.check.budgets import check_budgets
from pipeline.scene.check.layers import check_layers, check_merged
from pipeline.scene.check.poses import check_poses
from pipeline.scene.check.prims import all_prims, check_dangling, check_prim
from pipeline.scene.check.properties import check_properties
from pipeline.scene.exports import check_exports
from pipeline.scene.glass import check_glass
from pipeline.scene.lens import check_group_place, check_groups, check_lens, check_nominal
from pipeline.scene.microlenses import check_microlenses
from pipeline.scene.plen_dataset import check_dataset, check_only_dataset, find_dataset
from pipeline.scene.sensor import check_response, has_response
from pipeline.scene.targets import check_target
from pipeline.scene.usd.problems import Problem

_WHOLES: tuple[tuple[str, Callable[[Usd.Prim], Iterable[Problem]]], ...] = (
    ("PlenLens", check_lens),
    ("PlenLens", check_glass),
    ("PlenLens", check_groups),
    ("PlenLensGroup", check_group_place),
    ("PlenChannel", check_channel),
    ("PlenDataset", check_illuminant),
    ("PlenDataset", check_exports),
)


def check(stage: Usd.Stage, roots: list[Path]) -> list[Problem]:
    """All problems of a composed stage: layers first, then prims in order, then the dataset.

    Parameters
    ----------
    roots : list of Path
        Folders that the stage may read from, from `usd.roots.allowed_roots`.
    """
    if outside := check_used(stage, roots):
        return outside
    found = [*check_layers(stage), *check_assets(stage, roots), *check_dangling(stage)]
    prims = all_prims(stage)
    wrong: set[Sdf.Path] = set()
    for prim in prims:
        own = [*check_prim(prim), *check_properties(prim)]
        found += own
        if any(one.is_error for one in own):
            wrong.add(prim.GetPath())
    if over := [one for prim in _parts(prims) for one in check_budgets(prim)]:
        return list(dict.fromkeys([*found, *over]))  # the further checks make points, poses and lattices
    for prim in _parts(prims):
        found += _check_whole(prim, wrong)
    found += check_only_dataset(stage)
    if root := find_dataset(stage):
        found += check_dataset(root, wrong)
    if not any(one.is_error for one in found):
        # The further checks compute with values that have passed the checks so far.
        for prim in _parts(prims):
            found += check_nominal(prim) if prim.IsA("PlenLens") else []
            found += check_planes(prim) if _is_camera(prim) else []
        found += check_poses(root) if root else []
    return list(dict.fromkeys(found))


def _parts(prims: list[Usd.Prim]) -> list[Usd.Prim]:
    return [prim for prim in prims if prim.IsActive() and not prim.IsAbstract()]


def _is_camera(prim: Usd.Prim) -> bool:
    return bool(prim.IsA("Camera") and prim.HasAPI("PlenCameraAPI"))


def _check_whole(prim: Usd.Prim, wrong: Set[Sdf.Path]) -> list[Problem]:
    """Problems between the parts of one prim; `wrong` holds the prims with wrong values."""
    if merged := list(check_merged(prim)):
        return merged  # all other problems would follow from it
    found = [one for type_name, whole in _WHOLES if prim.IsA(type_name) for one in whole(prim)]
    found += check_microlenses(prim, wrong) if prim.IsA("PlenMicrolensArray") else []
    found += check_target(prim, wrong) if prim.IsA("PlenTarget") else []
    if prim.GetPath() not in wrong and prim.IsA("PlenSensor") and has_response(prim):
        found += check_response(prim)
    return found + (list(check_camera(prim)) if _is_camera(prim) else [])
