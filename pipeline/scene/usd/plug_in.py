"""Lamps, materials and assets of other programs: the questions that the core asks about them.

The plug-in `scenes` answers them. Without it the core refuses what only the plug-in could read.
"""

from collections.abc import Iterable, Iterator, Sequence, Set
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdSkel

from pipeline.entry_points import offered, plugged_in
from pipeline.scene.usd.poses import is_in_images
from pipeline.scene.usd.problems import Problem, of_reader
from pipeline.scene.usd.values import UnreadableValue, read

if TYPE_CHECKING:
    from pipeline.scene.usd.meshes import Drawn, Polygons


class ThirdPartyLayers:
    """Layers of a stage that only their authors could mend; none for the core alone, which is strict about all."""

    layers: frozenset[Sdf.Layer] = frozenset()

    def wrote(self, thing: Usd.Prim | Usd.Property) -> bool:
        """Whether the strongest opinion on a prim or property is in one of these layers."""
        return False

    def settled(self, problems: Iterable[Problem]) -> Iterator[Problem]:
        """The problems; those in these layers are left out, or are warnings of what is done instead."""
        return iter(problems)


class SceneReader:
    """Reader of the core alone: cameras, targets and plain meshes are read, everything else is refused.

    The module of the plug-in has functions with the names and arguments of these methods. Entries are records of
    `scene.dataset`.
    """

    def third_party_layers(self, stage: Usd.Stage) -> ThirdPartyLayers:
        return ThirdPartyLayers()

    def write_out(self, stage: Usd.Stage, frames: Sequence[int]) -> list[Problem]:
        """Turn instances of point instancers into prims and bake skinned points, in the session layer; problems."""
        kinds = (UsdGeom.PointInstancer, "a point instancer"), (UsdSkel.Root, "the root of a skeleton")
        prims = filter(is_in_images, stage.Traverse())
        return [of_reader(prim, _missing(prim, subject)) for prim in prims for kind, subject in kinds if prim.IsA(kind)]

    def solid(self, prim: Usd.Prim, time: float | None) -> "Drawn":
        """The triangles of a prim of a type in `meshes.SOLIDS`."""
        raise _missing(prim, f"a {prim.GetTypeName()}")

    def subdivided(self, prim: Usd.Prim, time: float | None, polygons: "Polygons", scheme: str) -> "Drawn":
        """The triangles of a subdivision surface."""
        raise _missing(prim, f"a subdivision surface: its subdivisionScheme is {scheme}")

    def is_lit(self, stage: Usd.Stage) -> bool:
        return False

    def lamp_prims(self, stage: Usd.Stage) -> list[Usd.Prim]:
        return []

    def read_lamp_entry(self, prim: Usd.Prim, frames: Sequence[float]) -> Any:
        raise _missing(prim, "a lamp")

    def world_from_lamp(self, prim: Usd.Prim, times: Sequence[float], unit_mm: float) -> np.ndarray:
        raise _missing(prim, "a lamp")

    def read_finish(self, prim: Usd.Prim, frame: int | None = None) -> Any:
        """Materials, normals and primvars of a shape of a lit stage, as a record of the plug-in."""
        raise _missing(prim, "a shape that lamps light")

    def named_by(self, prim: Usd.Prim) -> list[tuple[Usd.Attribute, str]]:
        """Attributes of a prim that name pictures, and colour spaces."""
        return []

    def read_pictures(self, stage: Usd.Stage) -> dict[Sdf.Path, Any]:
        return {}

    def check_pictures(self, prims: Iterable[Usd.Prim], layers: ThirdPartyLayers) -> Iterator[Problem]:
        return iter(())

    def check_dataset(self, root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
        """Problems of lamps, materials and labels; `wrong` holds the prims with wrong values."""
        for prim in root.GetStage().Traverse():
            if prim.HasAPI(UsdLux.LightAPI) and is_in_images(prim):
                yield of_reader(prim, _missing(prim, f"a lamp, {prim.GetTypeName()}"))
            if prim.HasAPI("PlenCameraAPI") and read(prim, "plen:image:labels"):
                yield of_reader(prim, _missing(prim.GetAttribute("plen:image:labels"), "a wish for labels of pixels"))

    def check_shone(self, stage: Usd.Stage, dataset: Any) -> Iterator[Problem]:
        """Warnings of lamps that light nothing, and of targets without light."""
        return iter(())

    def check_units(self, stage: Usd.Stage, layers: ThirdPartyLayers) -> Iterator[Problem]:
        return iter(())


@cache
def scene_reader() -> SceneReader:
    """The reader of the plug-in; that of the core alone if it is not installed."""
    reader: SceneReader = plugged_in("scene", "reader") if "reader" in offered("scene") else SceneReader()
    return reader


def _missing(thing: Usd.Prim | Usd.Property, subject: str) -> UnreadableValue:
    message = f"<{thing.GetPath()}> is {subject}, and the plug-in that reads it is not installed"
    hint = "install plenoptic-pipeline again, with its folder plugins/scenes, or take it out"
    return UnreadableValue(message, thing, hint, "plug-in-missing")
