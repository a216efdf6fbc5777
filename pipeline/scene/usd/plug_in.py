"""Lamps, materials and assets of other programs: what the plug-in `scenes` reads of a stage, and what is said of them
where it is not installed.
"""

from collections.abc import Iterable, Iterator, Sequence, Set
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdSkel

from pipeline.entry_points import offered, plugged_in
from pipeline.scene.usd.poses import is_in_images
from pipeline.scene.usd.problems import Problem, problem
from pipeline.scene.usd.values import UnreadableValue, read

if TYPE_CHECKING:
    from pipeline.scene.usd.meshes import Drawn, Polygons


class ThirdPartyLayers(Protocol):
    """Layers of a stage that only their authors could mend, and what becomes of problems in them."""

    layers: frozenset[Sdf.Layer]

    def wrote(self, thing: Usd.Prim | Usd.Property, /) -> bool:
        """Whether the strongest opinion on a prim or property is in one of them."""
        ...

    def settled(self, problems: Iterable[Problem], /) -> Iterator[Problem]:
        """The problems; those in these layers are left out, or are warnings of what is done instead."""
        ...


class SceneReader(Protocol):
    """Reader of what a stage has besides cameras, targets and plain meshes. Entries are those of `scene.dataset`."""

    def third_party_layers(self, stage: Usd.Stage, /) -> ThirdPartyLayers: ...

    def write_out(self, stage: Usd.Stage, frames: Sequence[int], /) -> list[Problem]:
        """Make prims of instances of point instancers, and points of what skeletons move, in the session layer."""
        ...

    def solid(self, prim: Usd.Prim, time: float | None, /) -> "Drawn":
        """The triangles of a prim of a type in `meshes.SOLIDS`."""
        ...

    def subdivided(self, prim: Usd.Prim, time: float | None, polygons: "Polygons", scheme: str, /) -> "Drawn": ...

    def is_lit(self, stage: Usd.Stage, /) -> bool: ...

    def lamp_prims(self, stage: Usd.Stage, /) -> list[Usd.Prim]: ...

    def read_lamp_entry(self, prim: Usd.Prim, frames: Sequence[float], /) -> Any: ...

    def world_from_lamp(self, prim: Usd.Prim, times: Sequence[float], unit_mm: float, /) -> np.ndarray: ...

    def read_finish(self, prim: Usd.Prim, frame: int | None = None, /) -> Any:
        """The finish of a shape of a lit stage, as a record of the plug-in."""
        ...

    def named_by(self, prim: Usd.Prim, /) -> list[tuple[Usd.Attribute, str]]:
        """Attributes that name pictures, and colour spaces."""
        ...

    def read_pictures(self, stage: Usd.Stage, /) -> dict[Sdf.Path, Any]: ...

    def check_pictures(self, prims: Iterable[Usd.Prim], others: ThirdPartyLayers, /) -> Iterator[Problem]: ...

    def check_dataset(self, root: Usd.Prim, wrong: Set[Sdf.Path], /) -> Iterator[Problem]:
        """Problems of lamps, materials and labels; `wrong` holds the prims with wrong values."""
        ...

    def check_shone(self, stage: Usd.Stage, dataset: Any, /) -> Iterator[Problem]:
        """Warnings of lamps that light nothing, and targets without light."""
        ...

    def check_units(self, stage: Usd.Stage, others: ThirdPartyLayers, /) -> Iterator[Problem]: ...


@cache
def scene_reader() -> SceneReader:
    """The reader of the plug-in, or else one that refuses what only the plug-in could read."""
    return plugged_in("scene", "reader") if "reader" in offered("scene") else _Refusing()


def _missing(thing: Usd.Prim | Usd.Property, subject: str) -> UnreadableValue:
    message = f"<{thing.GetPath()}> is {subject}, and the plug-in that reads it is not installed"
    hint = "install plenoptic-pipeline again, with its folder plugins/scenes, or take it out"
    return UnreadableValue(message, thing, hint, "plug-in-missing")


def _refused(thing: Usd.Prim | Usd.Property, subject: str) -> Problem:
    error = _missing(thing, subject)
    return problem(thing, error.code, error.message, hint=error.hint)


class _Refusing:
    """The core alone: files of others are as strict as ours, and no picture is looked at."""

    layers: frozenset[Sdf.Layer] = frozenset()

    def third_party_layers(self, stage: Usd.Stage) -> ThirdPartyLayers:
        return self

    def wrote(self, thing: Usd.Prim | Usd.Property) -> bool:
        return False

    def settled(self, problems: Iterable[Problem]) -> Iterator[Problem]:
        return iter(problems)

    def write_out(self, stage: Usd.Stage, frames: Sequence[int]) -> list[Problem]:
        kinds = (UsdGeom.PointInstancer, "a point instancer"), (UsdSkel.Root, "the root of a skeleton")
        prims = filter(is_in_images, stage.Traverse())
        return [_refused(prim, subject) for prim in prims for kind, subject in kinds if prim.IsA(kind)]

    def solid(self, prim: Usd.Prim, time: float | None) -> "Drawn":
        raise _missing(prim, f"a {prim.GetTypeName()}")

    def subdivided(self, prim: Usd.Prim, time: float | None, polygons: "Polygons", scheme: str) -> "Drawn":
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
        raise _missing(prim, "a shape that lamps light")

    def named_by(self, prim: Usd.Prim) -> list[tuple[Usd.Attribute, str]]:
        return []

    def read_pictures(self, stage: Usd.Stage) -> dict[Sdf.Path, Any]:
        return {}

    def check_pictures(self, prims: Iterable[Usd.Prim], others: ThirdPartyLayers) -> Iterator[Problem]:
        return iter(())

    def check_dataset(self, root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
        for prim in root.GetStage().Traverse():
            if prim.HasAPI(UsdLux.LightAPI) and is_in_images(prim):
                yield _refused(prim, f"a lamp, {prim.GetTypeName()}")
            if prim.HasAPI("PlenCameraAPI") and read(prim, "plen:image:labels"):
                yield _refused(prim.GetAttribute("plen:image:labels"), "a wish for labels of pixels")

    def check_shone(self, stage: Usd.Stage, dataset: Any) -> Iterator[Problem]:
        return iter(())

    def check_units(self, stage: Usd.Stage, others: ThirdPartyLayers) -> Iterator[Problem]:
        return iter(())
