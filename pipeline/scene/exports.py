"""Exports that a dataset asks for, and whether its cameras and targets are such as the formats can describe."""

from collections import Counter
from collections.abc import Iterator

from pxr import Usd

from pipeline.formats import EXACT, ExportError, Format, Targets, format_of, loadable
from pipeline.scene.channels import images_of
from pipeline.scene.dataset import AskedExports
from pipeline.scene.usd.problems import Problem, problem
from pipeline.scene.usd.values import need, read, target_paths, targets

NOISE = {
    "noise_px": "plen:exports:noise",
    "outliers": "plen:exports:outliers",
    "outlier_px": "plen:exports:outlierReach",
    "missed": "plen:exports:missed",
    "seed": "plen:exports:noiseSeed",
}
"""Attributes of the noise, by field of `exports.noise.Noise`."""
_ASKED = "plen:exports"
_GRIDS = ("PlenCheckerboard", "PlenCharuco", "PlenCircleGrid")
"""Types of targets whose points may form a grid."""


def read_exports(root: Usd.Prim) -> AskedExports:
    """The exports of a PlenDataset."""
    return AskedExports(
        formats=tuple(need(root, "plen:exports")),
        position=need(root, "plen:exports:position"),
        noise={field: need(root, name) for field, name in NOISE.items()},
    )


def check_exports(root: Usd.Prim) -> Iterator[Problem]:
    """Problems of the formats that a dataset names."""
    asked = read(root, _ASKED) or ()
    place = root.GetAttribute(_ASKED)
    for name in [name for name, count in Counter(asked).items() if count > 1]:
        yield problem(place, "repeated-export", f'"{_ASKED}" lists "{name}" more than once', hint="remove one")
    cameras = targets(root, "plen:cameras", "Camera")
    for name in dict.fromkeys(asked):
        try:
            wanted = format_of(name)
        except ExportError as error:
            yield problem(place, error.code, error.what, hint=error.hint)
            continue
        taken = [camera for camera in cameras if wanted.takes(_is_plenoptic(camera))]
        if cameras and not taken:
            kind = "conventional" if _is_plenoptic(cameras[0]) else "plenoptic"
            others = [other for other, format_ in loadable().items() if format_.takes(_is_plenoptic(cameras[0]))]
            message = f'"{name}" describes {kind} cameras alone, and the dataset has none'
            yield problem(place, "export-cameras", message, hint=f"formats for its cameras: {', '.join(others)}")
        elif sum(map(images_of, taken)) < wanted.least_cameras:
            message = f'"{name}" relates cameras to each other, and the dataset has one'
            yield problem(place, "export-cameras", message, hint="take it out, or add a camera")
        yield from _check_targets(root, name, wanted)
        yield from _check_position(root, name, taken)


def _check_targets(root: Usd.Prim, name: str, wanted: Format) -> Iterator[Problem]:
    prims, place = targets(root, "plen:targets", "PlenTarget"), root.GetAttribute(_ASKED)
    if wanted.targets is Targets.ANY:
        return
    if len(prims) > 1:
        message = f'"{name}" describes one target, and the dataset has {len(prims)}'
        yield problem(place, "export-targets", message, hint=f"`pipeline export {name} OUT --only TARGET` takes one")
    elif wanted.targets is Targets.BOARD and prims and not _has_grid(prims[0]):
        message = f'"{name}" describes boards whose points form a grid, and {prims[0].GetName()} has none'
        hint = "checkerboards, ChArUco boards and symmetric circle grids have one, of two columns and rows at least"
        yield problem(place, "export-targets", message, hint=hint)


def _has_grid(prim: Usd.Prim) -> bool:
    counts = [read(prim, name) or 0 for name in ("plen:columns", "plen:rows")]
    return prim.GetTypeName() in _GRIDS and min(counts) > 1 and not read(prim, "plen:asymmetric")


def _check_position(root: Usd.Prim, name: str, cameras: list[Usd.Prim]) -> Iterator[Problem]:
    position = read(root, f"{_ASKED}:position")
    if position in (None, EXACT):
        return
    lacking = [camera for camera in cameras if position not in (read(camera, "plen:truth:columns") or ())]
    if lacking:
        message = f'"{name}" is to take the positions "{position}", which <{lacking[0].GetPath()}> does not compute'
        hint = f'write plen:truth:columns = ["{position}"] on the camera'
        yield problem(root.GetAttribute(f"{_ASKED}:position"), "export-position", message, hint=hint)


def _is_plenoptic(camera: Usd.Prim) -> bool:
    return bool(target_paths(camera.GetRelationship("plen:camera:microlenses")))
