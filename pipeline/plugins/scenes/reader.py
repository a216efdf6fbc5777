"""Reader of lamps, materials and third-party assets: a `scene.usd.plug_in.SceneReader`."""

from collections.abc import Iterator, Sequence, Set

from pxr import Sdf, Usd

from pipeline.limits import limits
from pipeline.plugins.scenes.reading.instancers import write_instancers
from pipeline.plugins.scenes.reading.lamp_axes import world_from_lamp
from pipeline.plugins.scenes.reading.lamps import (
    check_lamps,
    check_shone,
    is_lit,
    lamp_prims,
    read_lamp_entry,
)
from pipeline.plugins.scenes.reading.materials import check_finishes, read_finish
from pipeline.plugins.scenes.reading.pictures import named_by, read_pictures
from pipeline.plugins.scenes.reading.skinning import bake
from pipeline.plugins.scenes.reading.solid_prims import solid
from pipeline.plugins.scenes.reading.third_party import ReferencedLayers, check_pictures
from pipeline.plugins.scenes.reading.units import check_units
from pipeline.scene.usd.meshes import Drawn, Polygons
from pipeline.scene.usd.plug_in import ThirdPartyLayers
from pipeline.scene.usd.problems import Problem

__all__ = [
    "check_dataset",
    "check_pictures",
    "check_shone",
    "check_units",
    "is_lit",
    "lamp_prims",
    "named_by",
    "read_finish",
    "read_lamp_entry",
    "read_pictures",
    "solid",
    "subdivided",
    "third_party_layers",
    "world_from_lamp",
    "write_out",
]


def third_party_layers(stage: Usd.Stage) -> ThirdPartyLayers:
    """Layers that the stage references, or has as payloads, and that define no plenScene prims."""
    return ReferencedLayers(stage)


def write_out(stage: Usd.Stage, frames: Sequence[int]) -> list[Problem]:
    """Write out all point instancers, and all skeletons at the frames; problems of what cannot be. Native instances
    must have been written out before.
    """
    if len(frames) > limits().frames:
        return []  # reported by the checks
    problems = write_instancers(stage, frames)
    return problems if any(each.is_error for each in problems) else problems + bake(stage, frames)


def subdivided(prim: Usd.Prim, time: float | None, polygons: Polygons, scheme: str) -> Drawn:
    """The triangles of a subdivision surface."""
    from pipeline.plugins.scenes.reading.subdivided import subdivided  # loads SciPy, which few datasets need

    return subdivided(prim, time, polygons, scheme)


def check_dataset(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of lamps and materials; `wrong` holds the prims with wrong values."""
    yield from check_lamps(root, wrong)
    yield from check_finishes(root, wrong)
