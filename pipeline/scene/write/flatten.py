"""Flattening of a stage into one text, so that an output folder explains itself."""

from collections.abc import Iterable, Mapping

from pxr import Sdf, Usd, UsdGeom

from pipeline.scene.dataset import CameraEntry, Dataset, TargetEntry
from pipeline.scene.write.for_viewers import show_in_viewers, without_parts
from pipeline.scene.write.lens_distortion import LENS_DISTORTION_NAMES


def flattened(stage: Usd.Stage) -> Sdf.Layer:
    """The composed stage in one layer.

    References are composed. Tables of other renderers are left out: they do not travel with a build, and flattening
    would write their paths on this machine. So are parts of cameras, which a build has made for viewers. Instances
    must have been written out (`instances`), because flattening would leave their prototypes beside the root.
    """
    layer = stage.Flatten(addSourceFileComment=False)  # warns of metadata that it does not know, and leaves them out
    _leave_out_tables(layer)
    for prim in stage.TraverseAll():
        if prim.IsA(UsdGeom.Camera) and (spec := layer.GetPrimAtPath(prim.GetPath())):
            without_parts(spec)
    return layer


def _leave_out_tables(layer: Sdf.Layer) -> None:
    """Remove attributes of schemas of other renderers that name files."""
    paths = list[Sdf.Path]()
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    for path in paths:
        if path.IsPropertyPath() and path.name.startswith(LENS_DISTORTION_NAMES):
            attribute = layer.GetAttributeAtPath(path)
            if attribute and attribute.typeName in (Sdf.ValueTypeNames.Asset, Sdf.ValueTypeNames.AssetArray):
                attribute.owner.RemoveProperty(attribute)


def name_pictures(layer: Sdf.Layer, files: Mapping[Sdf.Path, str]) -> None:
    """Let attributes of a flattened stage name pictures beside it, in place of files of this machine.

    Parameters
    ----------
    files : mapping
        Paths from the folder of the flattened stage, by paths of attributes.
    """
    for path, file in files.items():
        if attribute := layer.GetAttributeAtPath(path):
            attribute.default = Sdf.AssetPath(f"./{file}")


def text_for_viewers(
    layer: Sdf.Layer, cameras: Iterable[CameraEntry], targets: Iterable[TargetEntry], dataset: Dataset | None = None
) -> str:
    """Text of a flattened stage with the additions that viewers need, see `for_viewers`."""
    show_in_viewers(layer, cameras, targets, dataset)
    return layer.ExportToString().rstrip("\n") + "\n"
