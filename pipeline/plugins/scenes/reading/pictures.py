"""Pictures of textures and lights: files, identified by content, each inspected once."""

import base64
import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Ar, Sdf, Usd, UsdLux, UsdShade

from pipeline.errors import PipelineError
from pipeline.limits import how_to_raise, limits
from pipeline.machine.process import hushed
from pipeline.scene.dataset import PictureEntry
from pipeline.scene.targets import is_in_preview
from pipeline.scene.usd.readers import notes_of, read_once
from pipeline.scene.usd.roots import OUTSIDE_HINT, file_of, is_inside
from pipeline.scene.usd.values import NotSupported, UnreadableValue

SPACES = ("auto", "raw", "sRGB")
"""Colour spaces of a UsdUVTexture."""


@dataclass(frozen=True, slots=True)
class InspectedPicture:
    """A picture that can be decoded: its bytes, and bounds of the numbers of its pixels [1]."""

    content: bytes
    suffix: str
    least: float
    most: float
    least_opacity: float  # of the fourth component; 1 without any


def file_attribute(texture: UsdShade.Shader) -> Usd.Attribute:
    """The attribute that names the picture of a UsdUVTexture."""
    file = texture.GetInput("file")
    producers = file.GetValueProducingAttributes() if file else []
    if not producers:
        raise NotSupported("the texture names no file", texture.GetPrim())
    return producers[0]


def name_of(attribute: Usd.Attribute, space: str = "auto") -> str:
    """Name of the picture that an attribute points at: digest of its content, and colour space."""
    if space not in SPACES:
        hint = f"one of {', '.join(SPACES)}"
        raise NotSupported(f'there is no colour space "{space}" of textures', attribute, hint=hint)
    return f"{hashlib.sha256(picture_of(attribute).content).hexdigest()[:16]}-{space}"


def first_of(attribute: Usd.Attribute) -> Any:
    """Value of an attribute in the first frame."""
    stage = attribute.GetPrim().GetStage()
    has_frames = stage.HasAuthoredTimeCodeRange()
    return attribute.Get(stage.GetStartTimeCode() if has_frames else Usd.TimeCode.EarliestTime())


def read_pictures(stage: Usd.Stage) -> dict[Sdf.Path, PictureEntry]:
    """All pictures that the stage's textures and domes name, by the paths of the attributes that name them."""
    entries = dict[Sdf.Path, PictureEntry]()
    for attribute, space in (named for prim in stage.TraverseAll() for named in named_by(prim)):
        encoded = base64.b64encode(picture_of(attribute).content).decode("ascii")
        suffix, name = picture_of(attribute).suffix, name_of(attribute, space)
        entries[attribute.GetPath()] = PictureEntry(name=name, suffix=suffix, encoded=encoded, space=space)
    return entries


def named_by(prim: Usd.Prim) -> list[tuple[Usd.Attribute, str]]:
    """Attributes of a prim, or behind one of a texture, that name pictures, used or not, with the colour space."""
    is_shader, is_light = prim.IsA(UsdShade.Shader), prim.HasAPI(UsdLux.LightAPI)
    if not (is_shader or is_light) or is_in_preview(prim):
        return []  # in no image
    if is_shader and UsdShade.Shader(prim).GetShaderId() == "UsdUVTexture":
        inputs = (UsdShade.Shader(prim).GetInput(name) for name in ("file", "sourceColorSpace"))
        files, spaces = (each.GetValueProducingAttributes() if each else [] for each in inputs)
        space = str(first_of(spaces[0]) or "auto") if spaces else "auto"
        return [(files[0], space)] if files and is_picture(files[0]) else []
    file = prim.GetAttribute("inputs:texture:file") if is_light else None
    return [(file, "auto")] if file and is_picture(file) else []


def is_picture(attribute: Usd.Attribute) -> bool:
    """Whether an attribute names a file."""
    value = first_of(attribute) if attribute else None
    return isinstance(value, Sdf.AssetPath) and bool(value.path)


def picture_of(attribute: Usd.Attribute) -> InspectedPicture:
    """The picture that an attribute names; UnreadableValue if it is missing, outside, too large, or cannot be read."""
    value = first_of(attribute)
    if not isinstance(value, Sdf.AssetPath) or not value.path:
        raise NotSupported(f'"{attribute.GetName()}" names no file', attribute)
    try:
        return _inspected(attribute.GetStage(), value.path, value.resolvedPath)
    except PipelineError as error:
        code = error.code or "bad-picture"
        raise UnreadableValue(f"@{value.path}@ {error.message}", attribute, error.hint, code) from None


@read_once
def _inspected(stage: Usd.Stage, asset: str, path: str) -> InspectedPicture:
    """A picture; PipelineError, without the name of the file, if it cannot be used."""
    if not path:
        slashes = "asset paths use forward slashes" if "\\" in asset else None
        message = "names the tiles of a picture, which are not drawn" if "<UDIM>" in asset else "cannot be found"
        raise PipelineError(message, hint=slashes, code="asset-missing")
    file, member = Ar.SplitPackageRelativePathInner(path)  # a package may lie in another one
    suffix = Path(member or file).suffix.lower()
    from pipeline.plugins.scenes.picture_files import (  # stages without pictures need no library for them
        SUFFIXES,
        ends_of,
    )

    if suffix not in SUFFIXES:
        hint = f"known are files that end in {', '.join(SUFFIXES)}"
        raise PipelineError("is no picture of a kind that is read", hint=hint, code=NotSupported.code)
    file = file_of(path)
    if not is_inside(file, notes_of(stage).folders):
        message = "lies outside the folders that a stage may read"
        raise PipelineError(message, hint=OUTSIDE_HINT, code="asset-outside")
    try:
        if not Path(file).is_file():
            raise PipelineError("is not a plain file", code="file-kind")
        packed = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path)) if member else None
        if member and not packed:
            raise PipelineError("cannot be read from its package", code="unreadable")
        size = packed.GetSize() if packed else Path(file).stat().st_size
        most = limits().picture_bytes
        if size > most:
            hint = how_to_raise("picture_bytes", size)
            raise PipelineError(f"has {size:,} bytes; a picture may have {most:,}", hint=hint, code="file-size")
        content = bytes(packed.GetBuffer()) if packed else Path(file).read_bytes()
    except OSError as error:
        raise PipelineError(f"cannot be read: {error.strerror}", code="unreadable") from None
    with hushed():
        return InspectedPicture(content, suffix, *ends_of(content, suffix))
