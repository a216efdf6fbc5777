"""Pictures that textures and domes name: files, by content."""

import base64
import hashlib
from pathlib import Path

from pxr import Ar, Sdf, Usd, UsdShade

from pipeline.scene.dataset import PictureEntry
from pipeline.scene.read.targets import is_in_preview
from pipeline.scene.usd.values import NotSupported, UnreadableValue

SPACES = ("auto", "raw", "sRGB")
"""Colour spaces of a UsdUVTexture."""
_SUFFIXES = (".png", ".jpg", ".jpeg", ".exr")
"""Kinds of picture files that are read."""


def picture_name(shader: UsdShade.Shader, space: str) -> str:
    """Name of the picture of a UsdUVTexture in a colour space."""
    given = shader.GetInput("file")
    found = given.GetValueProducingAttributes() if given else []
    if not found:
        raise UnreadableValue("the texture names no file", shader.GetPrim())
    return name_of(found[0], space)


def name_of(attribute: Usd.Attribute, space: str = "auto") -> str:
    """Name of the picture that an attribute points at: digest of its content, and colour space."""
    if space not in SPACES:
        hint = f"one of {', '.join(SPACES)}"
        raise NotSupported(f'there is no colour space "{space}" of textures', attribute, hint=hint)
    return f"{hashlib.sha256(_bytes(attribute)).hexdigest()[:16]}-{space}"


def read_pictures(stage: Usd.Stage) -> tuple[PictureEntry, ...]:
    """All pictures that the stage's textures and domes name, each once."""
    found = dict[str, PictureEntry]()
    for prim in stage.Traverse():
        for attribute, space in _named_by(prim):
            entry = _entry(attribute, space)
            found[entry.name] = entry
    return tuple(found.values())


def picture_files(stage: Usd.Stage) -> dict[Sdf.Path, str]:
    """Copies in the output folder of the pictures that attributes name, by the paths of these attributes."""
    found = dict[Sdf.Path, str]()
    for prim in stage.Traverse():
        for attribute, space in _named_by(prim):
            entry = _entry(attribute, space)
            found[attribute.GetPath()] = entry.file
    return found


def _entry(attribute: Usd.Attribute, space: str) -> PictureEntry:
    encoded = base64.b64encode(_bytes(attribute)).decode("ascii")
    return PictureEntry(
        name=name_of(attribute, space), suffix=_path(attribute).suffix.lower(), encoded=encoded, space=space
    )


def _named_by(prim: Usd.Prim) -> list[tuple[Usd.Attribute, str]]:
    if prim.IsA(UsdShade.Shader) and UsdShade.Shader(prim).GetShaderId() == "UsdUVTexture":
        if is_in_preview(prim):
            return []  # in no image
        shader = UsdShade.Shader(prim)
        given, space = shader.GetInput("file"), shader.GetInput("sourceColorSpace")
        found = given.GetValueProducingAttributes() if given else []
        return [(found[0], str(space.Get() or "auto") if space else "auto")] if found else []
    attribute = prim.GetAttribute("inputs:texture:file")
    return [(attribute, "auto")] if is_picture(attribute) else []


def is_picture(attribute: Usd.Attribute) -> bool:
    """Whether an attribute names a file."""
    value = attribute.Get() if attribute else None
    return isinstance(value, Sdf.AssetPath) and bool(value.path)


def _path(attribute: Usd.Attribute) -> Path:
    value = attribute.Get()
    if not isinstance(value, Sdf.AssetPath) or not value.resolvedPath:
        raise UnreadableValue(f'"{attribute.GetName()}" names no file that is there', attribute)
    path = Path(value.resolvedPath)
    if Ar.IsPackageRelativePath(value.resolvedPath) or "<UDIM>" in value.path or path.suffix.lower() not in _SUFFIXES:
        what = f"@{value.path}@ is no picture that can be read"
        raise NotSupported(what, attribute, hint=f"known are files that end in {', '.join(_SUFFIXES)}")
    return path


def _bytes(attribute: Usd.Attribute) -> bytes:
    try:
        return _path(attribute).read_bytes()
    except OSError as error:
        raise UnreadableValue(f"cannot read the picture: {error.strerror}", attribute) from None
