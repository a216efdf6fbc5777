"""Reading of occluder prims."""

from pxr import Usd, UsdGeom

from pipeline.scene.dataset import OccluderEntry
from pipeline.scene.read.finishes import read_finish
from pipeline.scene.usd.meshes import fans
from pipeline.scene.usd.values import read, read_once, take
from pipeline.targets.occluder import Occluder
from pipeline.units import mm_per_unit


def read_occluder_entry(prim: Usd.Prim, lit: bool) -> OccluderEntry:
    """A mesh that a dataset names as an occluder, or any mesh if lamps light it."""
    finish = read_finish(prim) if lit else None
    return OccluderEntry(prim_path=str(prim.GetPath()), occluder=read_occluder(prim), finish=finish)


@read_once
def read_occluder(prim: Usd.Prim) -> Occluder:
    """A Mesh in its own frame, in millimetres; dark without PlenOccluderAPI.

    Raises
    ------
    TargetError, ValueError
        Its faces do not match its points or each other.
    """
    mesh, scale_mm = fans(UsdGeom.Mesh(prim)), mm_per_unit(UsdGeom.GetStageMetersPerUnit(prim.GetStage()))
    return Occluder(
        vertices_mm=tuple((x * scale_mm, y * scale_mm, z * scale_mm) for x, y, z in mesh.points),
        triangles=mesh.triangles,
        radiance=read(prim, "plen:radiance") or 0.0,
    )


def is_visible(prim: Usd.Prim, time: float) -> bool:
    """Whether USD shows a prim in a frame."""
    take(*(path.AppendProperty("visibility") for path in prim.GetPath().GetPrefixes()))
    return bool(UsdGeom.Imageable(prim).ComputeVisibility(time) != UsdGeom.Tokens.invisible)
