"""Readers of UsdPreviewSurface, with its textures and primvars, and of display colours.

A material that asks for more than is drawn brings a warning of what is drawn instead; a value that no renderer could
use is an error.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from pxr import Usd, UsdGeom, UsdShade

from pipeline.plugins.scenes.lighting.records import Input, Material, Numbers, Texture
from pipeline.plugins.scenes.reading.glass import read_glass
from pipeline.plugins.scenes.reading.lamps import is_mesh_light, mesh_light
from pipeline.plugins.scenes.reading.pictures import file_attribute, first_of, name_of, picture_of
from pipeline.plugins.scenes.reading.shader_inputs import expected_content
from pipeline.scene.usd.meshes import appearance_key, drawn
from pipeline.scene.usd.problems import Problem, not_drawn, shortened
from pipeline.scene.usd.readers import note_read, read_once
from pipeline.scene.usd.values import NotSupported, UnreadableValue, numbers, plain
from pipeline.targets.mesh import is_closed

_COLOUR = 3
"""Components of colours [1]."""
_FALLBACKS: dict[str, tuple[str, Numbers]] = {
    "diffuseColor": ("diffuse_color", (0.18, 0.18, 0.18)),
    "emissiveColor": ("emissive_color", (0.0, 0.0, 0.0)),
    "metallic": ("metallic", (0.0,)),
    "roughness": ("roughness", (0.5,)),
    "opacity": ("opacity", (1.0,)),
    "normal": ("normal", (0.0, 0.0, 1.0)),
    "clearcoat": ("clearcoat", (0.0,)),
    "clearcoatRoughness": ("clearcoat_roughness", (0.01,)),
}
"""Field of the record, and fallback of UsdPreviewSurface, for each input that may have a texture."""
_READERS = {
    "UsdPrimvarReader_float": 1,
    "UsdPrimvarReader_float2": 2,
    **dict.fromkeys((f"UsdPrimvarReader_{name}" for name in ("float3", "normal", "point", "vector")), _COLOUR),
}
"""Components of the primvar that each reader returns."""
_UNTRANSFORMED: Numbers = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
"""Rows of the identity of affine maps."""
_MOST_TRANSFORMS = 16
"""Most UsdTransform2d in a chain [1]: more are a cycle."""
_OF_COAT = 1.5
"""Index of all clear coats [1]."""
_SURFACES = ("", "glslfx")
"""Render contexts whose surface may be a UsdPreviewSurface: that of all renderers first."""


_Value = Any
"""A value of USD, as its binding to Python returns it."""


class Wanted(NamedTuple):
    """A primvar that a material reads, of as many components as its fallback."""

    name: str
    fallback: Numbers


class Shaded(NamedTuple):
    """A material, the primvars that it reads, and warnings of what is drawn otherwise."""

    material: Material
    primvars: tuple[Wanted, ...] = ()
    flaws: tuple[Problem, ...] = ()
    is_own_opacity: bool = False  # light passes by the display opacity of a shape


@partial(read_once, named=appearance_key)
def shades(mesh: Usd.Prim) -> tuple[list[Shaded], dict[int, int]]:
    """Materials of a shape, the first that of the whole shape, and the index of the material of faces in subsets."""
    shaded = [_shade(mesh, mesh)]
    of_face = dict[int, int]()
    for subset in UsdShade.MaterialBindingAPI(mesh).GetMaterialBindSubsets():
        note_read(subset.GetPrim())
        faces = subset.GetIndicesAttr()
        each = _shade(subset.GetPrim(), mesh)
        of_face = dict.fromkeys(plain(faces.Get(Usd.TimeCode.EarliestTime()) or ()), len(shaded)) | of_face
        if faces.ValueMightBeTimeVarying():
            message = "the faces of a subset are animated, and which material a face has is not: the first ones count"
            each = each._replace(flaws=(*each.flaws, not_drawn(faces, message)))
        shaded.append(each)
    shaded = [_as_light(each, mesh) for each in shaded] if is_mesh_light(mesh) else shaded
    return shaded, of_face


def _as_light(shaded: Shaded, mesh: Usd.Prim) -> Shaded:
    """A material of a mesh light: its emission tints the light if UsdLux says so, or does not count."""
    colour = mesh_light(mesh)
    sync_mode = mesh.GetAttribute("light:materialSyncMode").Get()
    material = shaded.material
    glow = material.emissive_color
    light = Input(value=colour)
    if sync_mode == "materialGlowTintsLight" and (glow.texture or any(glow.value)) and not glow.primvar:
        light = Input(value=_product(glow.value, colour), texture=glow.texture)
        if glow.texture:
            scale, bias = (_product(row, (*colour, 1.0)) for row in (glow.texture.scale, glow.texture.bias))
            light = replace(light, texture=replace(glow.texture, scale=scale, bias=bias))
    if sync_mode == "noMaterialResponse":
        material = Material(diffuse_color=Input(value=(0.0, 0.0, 0.0)), ior=1.0)
    return shaded._replace(material=replace(material, emissive_color=light))


def _product(a: Numbers, b: Numbers) -> Numbers:
    return tuple(x * y for x, y in zip(a, b, strict=True))


_ST_SIZE = 2
"""Components of texture coordinates [1], which solids have without a primvar."""


def remarks_on(mesh: Usd.Prim) -> Iterator[Problem]:
    """Warnings of what is drawn otherwise than the materials of a shape ask."""
    shaded, _ = shades(mesh)
    shape = drawn(mesh)
    is_glass = any(each.material.glass for each in shaded)
    if is_glass:
        message = "points that are seen through this glass have no ground truth: it hides them as if it were opaque"
        yield not_drawn(mesh, message, "keep it away from target points whose rows matter")
    if is_glass and len(shape.corners) and not is_closed(shape.points, shape.triangles):
        flaw = "is of glass and does not close a volume: it is drawn as panes, which bend no light"
        hint = "close the mesh, with all faces turned to the same side, for glass that refracts"
        yield not_drawn(mesh, f"<{mesh.GetPath()}> {flaw}", hint)
    for each in shaded:
        yield from (*each.flaws, *[_seen_through(mesh)] * each.is_own_opacity)
    for wanted in dict.fromkeys(wanted for each in shaded for wanted in each.primvars):
        if primvar_of(mesh, wanted) is None and (mesh.IsA(UsdGeom.Mesh) or len(wanted.fallback) != _ST_SIZE):
            message = f'a material reads "primvars:{wanted.name}", which <{mesh.GetPath()}> does not have'
            hint = f"write primvars:{wanted.name} with an interpolation"
            yield not_drawn(mesh, f"{message}: it is drawn with {_words(wanted.fallback)} everywhere", hint)


def primvar_of(mesh: Usd.Prim, wanted: Wanted) -> UsdGeom.Primvar | None:
    """The primvar of a shape that a material reads; None if it has none."""
    primvar = UsdGeom.PrimvarsAPI(mesh).FindPrimvarWithInheritance(wanted.name)
    time = Usd.TimeCode.EarliestTime()
    is_full = primvar and (not primvar.GetTypeName().isArray or primvar.ValueMightBeTimeVarying() or primvar.Get(time))
    return primvar if is_full and primvar.HasValue() else None


def values_of(primvar: UsdGeom.Primvar, time: Usd.TimeCode) -> tuple[Any, ...]:
    """Values of a primvar, one of a primvar that is no array; none if its indices name values that do not exist."""
    values = plain(primvar.ComputeFlattened(time))
    return (values or ()) if primvar.GetTypeName().isArray else (values,)


def _shade(prim: Usd.Prim, mesh: Usd.Prim) -> Shaded:
    """The material that is bound to a mesh or a subset, else the display colour of the mesh."""
    api = UsdShade.MaterialBindingAPI(prim)
    reason = None  # the first material that is not supported, and why
    for purpose in (UsdShade.Tokens.full, UsdShade.Tokens.preview):
        material, _ = api.ComputeBoundMaterial(purpose)
        if not material:
            continue
        try:
            return read_material(material)
        except NotSupported as error:
            reason = reason or (material, error.with_traceback(None))  # whose frames would hold the stage
    colours = _display_colours(mesh)
    if reason is None:
        return colours
    material, error_of_material = reason
    message = f"{error_of_material.message}: what it is bound to is drawn in its display colour, grey of 18 % without"
    return colours._replace(flaws=(*colours.flaws, not_drawn(material.GetPrim(), message, error_of_material.hint)))


def _display_colours(mesh: Usd.Prim) -> Shaded:
    """The display colour and opacity of a mesh, or of its parts, as a matt material."""
    inputs, primvars = list[Input](), list[Wanted]()
    for wanted in (Wanted("displayColor", _FALLBACKS["diffuseColor"][1]), Wanted("displayOpacity", (1.0,))):
        primvar = primvar_of(mesh, wanted)
        values = values_of(primvar, Usd.TimeCode.EarliestTime()) if primvar else ()
        if not primvar or (len(set(values)) == 1 and not primvar.ValueMightBeTimeVarying()):
            value = values[0] if values else wanted.fallback
            inputs.append(Input(value=value if isinstance(value, tuple) else (value,)))
        else:
            inputs.append(Input(value=wanted.fallback, primvar=wanted.name))
            primvars.append(wanted)
    colour, opacity = inputs
    is_clear = bool(opacity.primvar) or min(opacity.value) < 1
    return Shaded(Material(diffuse_color=colour, opacity=opacity, ior=1.0), tuple(primvars), is_own_opacity=is_clear)


def read_material(material: UsdShade.Material) -> Shaded:
    """The record of a Material; NotSupported without a UsdPreviewSurface, UnreadableValue for unusable values."""
    surface = _surface(material)
    network = _Network(surface)
    fields: dict[str, Any] = {field: network.read(name, value) for name, (field, value) in _FALLBACKS.items()}
    if network.value(surface, "useSpecularWorkflow", 0):
        fields["specular_color"] = network.read("specularColor", (0.0, 0.0, 0.0))
    ior = float(network.value(surface, "ior", 1.5))
    threshold = float(network.value(surface, "opacityThreshold", 0.0))
    is_presence = network.value(surface, "opacityMode", "transparent") == "presence"
    glass, doubts = read_glass(material, surface, ior)
    record = Material(**fields, ior=ior, opacity_threshold=threshold, is_presence=is_presence, glass=glass)
    displacement = network.source(surface, "displacement")
    is_coated = record.clearcoat.differs(0.0)
    # Inputs without effect, when, and what is drawn instead
    ignored = (
        ("ior", is_coated and not glass and ior != _OF_COAT, f"a clear coat is drawn with the index {_OF_COAT:g}"),
        ("normal", record.normal.primvar or record.normal.value != (0, 0, 1), "normals without pictures do not count"),
        ("displacement", bool(displacement), "surfaces are drawn without displacement"),
        ("metallic", glass and record.metallic.differs(0.0), "glass is drawn without its metallic"),
        ("clearcoat", glass and is_coated, "glass is drawn without its clearcoat"),
    )
    flaws = (not_drawn(surface.GetInput(name).GetAttr(), message) for name, applies, message in ignored if applies)
    network.flaws += [*doubts, *flaws]
    if not glass and (record.opacity.texture or record.opacity.primvar or record.opacity.value[0] < 1):
        network.flaws.append(_seen_through(surface.GetInput("opacity").GetAttr()))
    return Shaded(record, tuple(network.primvars.values()), tuple(network.flaws))


def _surface(material: UsdShade.Material) -> UsdShade.Shader:
    """The UsdPreviewSurface of a material."""
    note_read(prim := material.GetPrim())
    shaders = [material.ComputeSurfaceSource(context)[0] for context in _SURFACES]
    shader = next((shader for shader in shaders if shader and shader.GetShaderId() == "UsdPreviewSurface"), shaders[0])
    if not shader:
        contexts = sorted(each.GetFullName() for each in material.GetSurfaceOutputs() if each.HasConnectedSource())
        contexts_named = f", only {', '.join(contexts)}" if contexts else ""
        message = f"<{prim.GetPath()}> has no surface for all renderers{contexts_named}"
        raise NotSupported(message, prim, hint="connect its outputs:surface to a UsdPreviewSurface")
    return _supported(shader, "UsdPreviewSurface")


class _Connected(NamedTuple):
    """The output that an input is connected to."""

    shader: UsdShade.Shader
    output: str


class _Network:
    """Reader of the shaders behind one surface; collects primvars by name, and warnings."""

    def __init__(self, surface: UsdShade.Shader) -> None:
        self._surface = surface
        self.primvars = dict[str, Wanted]()
        self.flaws = list[Problem]()

    def read(self, name: str, fallback: Numbers) -> Input:
        """Value, texture or primvar of an input, of as many components as its fallback.

        What is not supported is drawn with the fallback of its texture, or else that of the input.
        """
        source = self.source(self._surface, name)
        if not isinstance(source, _Connected):
            return Input(value=fallback if source is None else tuple((numbers(source) + 0.0).tolist()))
        try:
            if _READERS.get(source.shader.GetShaderId()) == len(fallback):
                return Input(value=fallback, primvar=self._primvar(source.shader, fallback))
            return self._textured(source, fallback)
        except NotSupported as error:
            rgba = self.value(source.shader, "fallback", ()) if source.shader.GetShaderId() == "UsdUVTexture" else ()
            own = tuple(part for name, part in zip("rgba", rgba, strict=False) if name in source.output)
            fallback = own if len(own) == len(fallback) else fallback
            message = f'{error.message}: "inputs:{name}" of <{self._surface.GetPath()}> is drawn as {_words(fallback)}'
            if not error.thing.GetStage().GetSessionLayer().GetPropertyAtPath(error.thing.GetPath()):
                self.flaws.append(not_drawn(error.thing, message, error.hint))  # else `third_party` has said so
            return Input(value=fallback)

    def source(self, shader: UsdShade.Shader, name: str) -> _Connected | _Value | None:
        """Source of an input: a value, a connection to a shader, or None for its fallback.

        An input whose connection leads nowhere has its fallback, and one that is animated its value in the first frame:
        `flaws` gets a warning of either. Raises UnreadableValue: the value is none that the shader's definition allows.
        """
        shader_input = shader.GetInput(name)
        attribute = next(iter(shader_input.GetValueProducingAttributes() if shader_input else ()), None)
        if attribute is None:
            if shader_input and (lost := shader_input.GetAttr().GetConnections()):
                message = f'"inputs:{name}" is connected to <{lost[0]}>, which is not there: its fallback is drawn'
                self.flaws.append(not_drawn(shader_input.GetAttr(), message, "write that output, or a value"))
            return None
        if UsdShade.Output.IsOutput(attribute):
            return _Connected(UsdShade.Shader(attribute.GetPrim()), UsdShade.Output(attribute).GetBaseName())
        value = self._first(attribute)
        if value is not None and (expected := expected_content(shader.GetShaderId(), name, value)):
            raise UnreadableValue(f'"inputs:{name}" is {shortened(str(value))}, not {expected}', attribute)
        return value

    def value(self, shader: UsdShade.Shader, name: str, fallback: Any) -> Any:
        """A value that cannot have a texture."""
        source = self.source(shader, name)
        if isinstance(source, _Connected):
            message = f'"inputs:{name}" cannot have a texture: it is drawn as {fallback}'
            self.flaws.append(not_drawn(shader.GetInput(name).GetAttr(), message, "write a value"))
            return fallback
        return fallback if source is None else plain(source)

    def _first(self, attribute: Usd.Attribute) -> Any:
        """The value of an attribute in the first frame."""
        if attribute.ValueMightBeTimeVarying():
            flaw = "is animated, and materials are not: its value in the first frame is drawn"
            self.flaws.append(not_drawn(attribute, f'"{attribute.GetName()}" {flaw}'))
        return first_of(attribute)

    def _primvar(self, reader: UsdShade.Shader, fallback: Numbers) -> str:
        """Name of the primvar of a reader."""
        name = str(self.value(_supported(reader, reader.GetShaderId()), "varname", "st"))
        if not reader.GetInput("varname"):
            self.flaws.append(not_drawn(reader.GetPrim(), 'it names no primvar by "inputs:varname": st is read'))
        value = self.value(reader, "fallback", (0.0,) * len(fallback))
        fallback = tuple(float(number) for number in (value if isinstance(value, tuple) else (value,)))
        if len(self.primvars.setdefault(name, Wanted(name, fallback)).fallback) != len(fallback):
            message = f'"primvars:{name}" is read as {len(fallback)} numbers and as another count of them'
            raise NotSupported(message, reader.GetPrim(), hint="read it in one way")
        return name

    def _textured(self, source: _Connected, fallback: Numbers) -> Input:
        """A texture, or its value if it is the fourth component of a picture that is opaque everywhere."""
        texture = self._texture(source, len(fallback))
        is_even = texture.channel == "a" and "black" not in texture.wrap
        if is_even and picture_of(file_attribute(source.shader)).least_opacity == 1:
            return Input(value=(texture.scale[3] + texture.bias[3],))
        return Input(value=fallback, texture=texture)

    def _texture(self, source: _Connected, components: int) -> Texture:
        """The texture of a UsdUVTexture, whose output has as many components as the input."""
        shader = _supported(source.shader, "UsdUVTexture")
        if source.output not in ({"rgb"} if components == _COLOUR else {"r", "g", "b", "a"}):
            message = f'an input of {components} numbers is connected to "outputs:{source.output}"'
            hint = "connect colours to outputs:rgb, and single numbers to outputs:r, g, b or a"
            raise NotSupported(message, shader.GetPrim(), hint=hint)
        self._first(file_attribute(shader))  # warns
        transform, primvar = self._coordinates(shader)
        wraps = tuple(self.value(shader, name, "useMetadata") for name in ("wrapS", "wrapT"))
        return Texture(
            name=name_of(file_attribute(shader), self.value(shader, "sourceColorSpace", "auto")),
            channel=source.output,
            scale=self.value(shader, "scale", (1.0, 1.0, 1.0, 1.0)),
            bias=self.value(shader, "bias", (0.0, 0.0, 0.0, 0.0)),
            # Metadata of files is not read: black, which is the fallback of UsdUVTexture without any.
            wrap=tuple("black" if wrap == "useMetadata" else str(wrap) for wrap in wraps),  # type: ignore[arg-type]
            st_from_primvar=transform,
            primvar=primvar,
        )

    def _coordinates(self, texture: UsdShade.Shader) -> tuple[Numbers, str]:
        """The map of a texture's coordinates from a primvar, and its name; without any from "st", with a warning."""
        st_from_primvar = _UNTRANSFORMED
        shader, name = texture, "st"
        for _ in range(_MOST_TRANSFORMS):
            source = self.source(shader, name)
            if not isinstance(source, _Connected):
                message = f'"inputs:{name}" is not connected: the texture is drawn with primvars:st'
                self.flaws.append(not_drawn(shader.GetPrim(), message, "connect it to a UsdPrimvarReader_float2"))
                self.primvars.setdefault("st", Wanted("st", (0.0, 0.0)))
                return st_from_primvar, "st"
            shader, name = source.shader, "in"
            if shader.GetShaderId() != "UsdTransform2d":
                break
            st_from_primvar = _chained(st_from_primvar, self._transform(shader))
        reader = _supported(shader, "UsdPrimvarReader_float2")
        return st_from_primvar, self._primvar(reader, (0.0, 0.0))

    def _transform(self, shader: UsdShade.Shader) -> Numbers:
        """The affine map of a UsdTransform2d: scale, then rotation, then translation."""
        turn = math.radians(float(self.value(shader, "rotation", 0.0)))
        (sx, sy), (tx, ty) = self.value(shader, "scale", (1.0, 1.0)), self.value(shader, "translation", (0.0, 0.0))
        c, s = math.cos(turn), math.sin(turn)
        return c * sx, -s * sy, tx, s * sx, c * sy, ty


def _chained(outer: Numbers, inner: Numbers) -> Numbers:
    """The product of two affine maps, the inner one applied first."""
    a, b, c, d, e, f = outer
    g, h, i, j, k, m = inner
    return a * g + b * j, a * h + b * k, a * i + b * m + c, d * g + e * j, d * h + e * k, d * i + e * m + f


def _supported(shader: UsdShade.Shader, wanted: str) -> UsdShade.Shader:
    """The shader, if it is the wanted one."""
    if shader.GetShaderId() != wanted:
        message = f'the shader "{shader.GetShaderId() or shader.GetPrim().GetName()}" is not supported here'
        supported = "UsdPreviewSurface, UsdUVTexture, UsdTransform2d and UsdPrimvarReader"
        raise NotSupported(message, shader.GetPrim(), hint=f"connect a {wanted}; known are {supported}")
    note_read(shader.GetPrim())
    return shader


def _seen_through(thing: Usd.Prim | Usd.Property) -> Problem:
    """A warning of light that passes a surface."""
    message = "light passes this surface, and the ground truth does not: it hides points as if it were opaque"
    return not_drawn(thing, message, "visibility in tables of points counts whole shapes")


def _words(values: Numbers) -> str:
    return ", ".join(f"{value:g}" for value in values)
