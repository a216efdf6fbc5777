"""The preview of a target for viewers: a mesh in true size, with colours by face and, in a build, the picture of its
pattern on a UsdPreviewSurface.
"""

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt

from pipeline.targets.preview import PreviewFaces

_LARGEST = 1e30
"""Largest coordinate that is written: USD keeps these values in single precision."""
_PLACES = "st"
"""Name of the primvar that places points on a picture: the one that viewers look for."""


def write_board(prim: Sdf.PrimSpec, name: str, faces: PreviewFaces, unit_mm: float, picture: str | None) -> None:
    """Write the preview below the prim of a target, replacing an older mesh; any other prim of that name stays.

    Parameters
    ----------
    picture : str or None
        PNG of its linear reflectance, relative to the layer.
    """
    if not np.abs(faces.points_mm / unit_mm).max() < _LARGEST:
        return
    if name in prim.nameChildren:
        if prim.nameChildren[name].typeName != "Mesh":
            return
        del prim.nameChildren[name]
    alone = Usd.Stage.CreateInMemory()
    mesh = _mesh(alone, Sdf.Path.absoluteRootPath.AppendChild(name), faces, unit_mm)
    if picture is not None:
        _paint(alone, mesh, faces, picture)
    Sdf.CreatePrimInLayer(prim.layer, prim.path.AppendChild(name))
    Sdf.CopySpec(alone.GetRootLayer(), mesh.GetPath(), prim.layer, prim.path.AppendChild(name))


def _mesh(stage: Usd.Stage, path: Sdf.Path, faces: PreviewFaces, unit_mm: float) -> UsdGeom.Mesh:
    mesh, points = UsdGeom.Mesh.Define(stage, path), (faces.points_mm / unit_mm).astype(np.float32)
    mesh.CreateExtentAttr(_vectors(np.stack([points.min(axis=0), points.max(axis=0)])))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray([4] * len(faces.faces)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray(faces.faces.ravel().tolist()))
    mesh.CreatePointsAttr(_vectors(points))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    grey = np.repeat(np.clip(faces.radiance, 0, 1)[:, None], 3, axis=1)
    mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.uniform).Set(_vectors(grey))
    return mesh


def _paint(stage: Usd.Stage, mesh: UsdGeom.Mesh, faces: PreviewFaces, picture: str) -> None:
    """Bind the mesh to a matt surface with its picture."""
    kind, vertex = Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
    places = Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(faces.sheet, np.float32))
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(_PLACES, kind, vertex).Set(places)
    board = _matt(stage, mesh.GetPath().AppendChild("Sheet"), picture)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(board)


def _matt(stage: Usd.Stage, path: Sdf.Path, picture: str) -> UsdShade.Material:
    """A matt UsdPreviewSurface with a picture."""
    board = UsdShade.Material.Define(stage, path)
    reader = UsdShade.Shader.Define(stage, path.AppendChild("Places"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(_PLACES)
    texture = UsdShade.Shader.Define(stage, path.AppendChild("Picture"))
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(picture))
    places = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(places)
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("raw")  # reflectances are linear
    for axis in "ST":
        texture.CreateInput(f"wrap{axis}", Sdf.ValueTypeNames.Token).Set("clamp")
    surface = UsdShade.Shader.Define(stage, path.AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    colour = texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(colour)
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    board.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return board


def _vectors(rows: np.ndarray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(rows + 0.0, np.float32))
