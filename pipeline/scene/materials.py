"""Materials of the meshes of a lit scene, with their normals and texture coordinates, and which meshes these are."""

import math
from collections.abc import Iterator, Set
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from pxr import Sdf, Sdr, Usd, UsdGeom, UsdShade

from pipeline.render.lighting.materials import texture_names
from pipeline.render.lighting.records import Finish, Input, Material, Numbers, Texture
from pipeline.scene.lamps import is_in_images, lamp_prims
from pipeline.scene.pictures import picture_name
from pipeline.scene.targets import is_preview
from pipeline.scene.usd.meshes import Fans, fans
from pipeline.scene.usd.problems import Problem, problem, shortened
from pipeline.scene.usd.values import (
    NotSupported,
    Range,
    UnreadableValue,
    numbers,
    plain,
    read,
    read_once,
    take,
    targets,
)

_COLOUR, _NUMBER = 3, 1
"""Components of inputs [1]."""
_FALLBACKS: dict[str, tuple[str, Numbers]] = {
    "diffuseColor": ("diffuse_color", (0.18, 0.18, 0.18)),
    "emissiveColor": ("emissive_color", (0.0, 0.0, 0.0)),
    "metallic": ("metallic", (0.0,)),
    "roughness": ("roughness", (0.5,)),
    "opacity": ("opacity", (1.0,)),
    "normal": ("normal", (0.0, 0.0, 1.0)),
}
"""Field of the record, and fallback of UsdPreviewSurface, for each input that may have a texture."""
_UNUSED = {"clearcoat": 0.0, "displacement": 0.0}
"""Inputs that are not supported, and the values with which they do nothing."""
_RANGES = {"ior": Range(low=0.0, high=1e3), "emissiveColor": Range(low=0.0, high=1e30)}
"""Ranges of inputs [1]: with other indices a surface reflects more than there is; of light, as of lamps."""
_ANY = Range(low=-1e9, high=1e9)
"""Range of all other inputs [1]: shares are cut to 0 to 1, as renderers do."""
_UNTRANSFORMED: Numbers = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
"""Rows of the affine map that changes nothing."""

_GREY = (0.18, 0.18, 0.18)
"""Colour of what has none [1]: UsdPreviewSurface's."""


class _Shaded(NamedTuple):
    """A material, and the primvar with its texture coordinates; empty: it has none."""

    material: Material
    primvar: str


def read_material(material: UsdShade.Material) -> _Shaded:
    """The record of a Material; UnreadableValue if a shader, a connection or a value cannot be used."""
    surface = _shader(material.ComputeSurfaceSource()[0], material.GetPrim(), "UsdPreviewSurface")
    for name, idle in _UNUSED.items():
        source = _source(surface, name)
        if isinstance(source, _Connected) or (source is not None and source != idle):
            attribute = surface.GetInput(name).GetAttr()
            raise NotSupported(f'"inputs:{name}" is not supported', attribute, hint=f"write {idle:g}, or leave it out")
    reader = _Inputs(surface)
    fields = {field: reader.read(name, value) for name, (field, value) in _FALLBACKS.items()}
    if _plain(surface, "useSpecularWorkflow", 0):
        fields["specular_color"] = reader.read("specularColor", (0.0, 0.0, 0.0))
    threshold, ior = (_number(surface, name, value) for name, value in (("opacityThreshold", 0.0), ("ior", 1.5)))
    opacity = fields["opacity"]
    if threshold <= 0 and (opacity.texture or opacity.value[0] < 1):
        what = "surfaces are opaque, or have holes where their opacity is below a threshold"
        hint = "write float inputs:opacityThreshold = 0.5"
        raise NotSupported(what, surface.GetInput("opacity").GetAttr(), hint=hint)
    record = Material(**fields, ior=ior, opacity_threshold=threshold)
    if len(reader.primvars) > 1:
        what = f"its textures read coordinates from {' and '.join(sorted(reader.primvars))}"
        raise NotSupported(what, material.GetPrim(), hint="use one set of texture coordinates")
    return _Shaded(record, next(iter(reader.primvars), ""))


class _Inputs:
    """Reader of the inputs of one surface; `primvars` collects the names of texture coordinates."""

    def __init__(self, surface: UsdShade.Shader) -> None:
        self._surface = surface
        self.primvars = set[str]()

    def read(self, name: str, fallback: Numbers) -> Input:
        """A value or a texture, with as many components as the fallback."""
        source = _source(self._surface, name)
        if source is None:
            return Input(value=fallback)
        if isinstance(source, _Connected):
            return Input(value=fallback, texture=self._texture(source, len(fallback)))
        return Input(value=tuple((numbers(source) + 0.0).tolist()))

    def _texture(self, source: "_Connected", components: int) -> Texture:
        shader = _shader(source.shader, source.shader.GetPrim(), "UsdUVTexture")
        if source.output not in ({"rgb"} if components == _COLOUR else {"r", "g", "b", "a"}):
            what = f'an input of {components} numbers is connected to "outputs:{source.output}"'
            hint = "connect colours to outputs:rgb, and single numbers to outputs:r, g, b or a"
            raise NotSupported(what, shader.GetPrim(), hint=hint)
        st = _source(shader, "st")
        if not isinstance(st, _Connected):
            raise UnreadableValue('the texture has no coordinates: "inputs:st" is not connected', shader.GetPrim())
        transform, reader = _UNTRANSFORMED, st.shader
        if reader.GetShaderId() == "UsdTransform2d":
            transform, inner = _transform(reader), _source(reader, "in")
            if not isinstance(inner, _Connected):
                raise UnreadableValue('"inputs:in" is not connected', reader.GetPrim())
            reader = inner.shader
        self.primvars.add(str(_plain(_shader(reader, reader.GetPrim(), "UsdPrimvarReader_float2"), "varname", "st")))
        wraps = tuple(_plain(shader, name, "useMetadata") for name in ("wrapS", "wrapT"))
        return Texture(
            name=picture_name(shader, _plain(shader, "sourceColorSpace", "auto")),
            channel=source.output,
            scale=_plain(shader, "scale", (1.0, 1.0, 1.0, 1.0)),
            bias=_plain(shader, "bias", (0.0, 0.0, 0.0, 0.0)),
            # Files that say nothing repeat, as in viewers.
            wrap=tuple("repeat" if wrap == "useMetadata" else str(wrap) for wrap in wraps),  # type: ignore[arg-type]
            st_from_primvar=transform,
        )


def _transform(shader: UsdShade.Shader) -> Numbers:
    """The affine map of a UsdTransform2d: scale, then rotation, then translation."""
    turn = math.radians(_number(shader, "rotation", 0.0))
    (sx, sy), (tx, ty) = _plain(shader, "scale", (1.0, 1.0)), _plain(shader, "translation", (0.0, 0.0))
    c, s = math.cos(turn), math.sin(turn)
    return c * sx, -s * sy, tx, s * sx, c * sy, ty


class _Connected(NamedTuple):
    """The output that an input is connected to."""

    shader: UsdShade.Shader
    output: str


def _source(shader: UsdShade.Shader, name: str) -> Any:
    """Origin of an input: a value, a connection to a shader, or None for its fallback."""
    given = shader.GetInput(name)
    if not given:
        return None
    attributes = given.GetValueProducingAttributes()
    if not attributes:
        return None
    attribute = attributes[0]
    if UsdShade.Output.IsOutput(attribute):
        return _Connected(UsdShade.Shader(attribute.GetPrim()), UsdShade.Output(attribute).GetBaseName())
    if attribute.ValueMightBeTimeVarying():
        what = f'"{attribute.GetName()}" is animated, and materials are not'
        raise NotSupported(what, attribute, hint="write one value")
    value = attribute.Get()
    if value is not None and (wanted := _wanted(shader.GetShaderId(), name, value)):
        raise UnreadableValue(f'"inputs:{name}" is {shortened(str(value))}, not {wanted}', attribute)
    return value


def _wanted(shader_id: str, name: str, value: Any) -> str | None:
    """Content of an input by the definition of its shader, if a value of USD is not that; else None."""
    count, tokens = _declared(shader_id).get(name, (0, ()))
    if tokens:
        return None if value in tokens else f"one of {', '.join(tokens)}"
    if not count:
        return None if isinstance(value, str) else "a text"
    values, span = numbers(value), _RANGES.get(name, _ANY)
    return None if len(values) == count and span.holds(values).all() else f"{count} in {span}"


@cache
def _declared(shader_id: str) -> dict[str, tuple[int, tuple[str, ...]]]:
    """Inputs of a shader: how many numbers each holds, 0 for texts, and the tokens that it may be."""
    shader = Sdr.Registry().GetShaderNodeByIdentifier(shader_id)
    inputs = {name: shader.GetShaderInput(name) for name in shader.GetShaderInputNames()}
    return {
        name: (len(numbers(declared.GetDefaultValueAsSdfType())), tuple(token for token, _ in declared.GetOptions()))
        for name, declared in inputs.items()
    }


def _plain(shader: UsdShade.Shader, name: str, fallback: Any) -> Any:
    """A value that cannot have a texture."""
    source = _source(shader, name)
    if isinstance(source, _Connected):
        attribute = shader.GetInput(name).GetAttr()
        raise NotSupported(f'"inputs:{name}" is connected', attribute, hint="write a value")
    return fallback if source is None else plain(source)


def _number(shader: UsdShade.Shader, name: str, fallback: float) -> float:
    return float(_plain(shader, name, fallback))


def _shader(shader: UsdShade.Shader, place: Usd.Prim, wanted: str) -> UsdShade.Shader:
    """The shader, if it is the wanted one."""
    if not shader:
        raise NotSupported(f"<{place.GetPath()}> has no surface for all renderers", place, hint=_connect(wanted))
    if shader.GetShaderId() != wanted:
        what = f'the shader "{shader.GetShaderId() or shader.GetPrim().GetName()}" is not supported here'
        raise NotSupported(what, shader.GetPrim(), hint=_connect(wanted))
    take(place.GetPath(), shader.GetPath())
    return shader


def _connect(wanted: str) -> str:
    return f"connect a {wanted}; known are UsdPreviewSurface, UsdUVTexture, UsdTransform2d and UsdPrimvarReader_float2"


def seen_meshes(root: Usd.Prim) -> list[Usd.Prim]:
    """Meshes besides targets that images of a dataset show: those that it names, and with lamps all others, too."""
    named = targets(root, "plen:occluders", "Mesh")
    stage = root.GetStage()
    if not lamp_prims(stage):
        return named
    taken = {mesh for prim in stage.Traverse() for mesh in targets(prim, "plen:mesh", "Mesh")}
    others = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh) and prim not in named and prim not in taken]
    return named + [prim for prim in others if is_in_images(prim) and not is_preview(prim)]


@read_once
def read_finish(prim: Usd.Prim) -> Finish:
    """The materials of a Mesh, with its normals and texture coordinates; UnreadableValue if any cannot be used."""
    mesh = UsdGeom.Mesh(prim)
    shape = fans(mesh)
    shaded = [_material_of(prim)]
    of_face = dict[int, int]()
    for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
        take(subset.GetPath())
        of_face |= dict.fromkeys(plain(subset.GetIndicesAttr().Get() or ()), len(shaded))
        shaded.append(_material_of(subset.GetPrim()))
    materials = tuple(each.material for each in shaded)
    return Finish(
        materials=materials,
        material_of=tuple(of_face.get(face, 0) for face in shape.faces) if of_face else (),
        normals=_normals(mesh, shape),
        st=_st(mesh, shape, shaded) if texture_names(materials) else (),
    )


def _material_of(prim: Usd.Prim) -> _Shaded:
    """The material that is bound to a mesh or a subset, else the display colour of the mesh."""
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.full)
    if material:
        return read_material(material)
    mesh = prim if prim.IsA(UsdGeom.Mesh) else prim.GetParent()
    colour = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("displayColor")
    values = plain(colour.Get() or ()) if colour else ()
    if len(values) > 1:
        what = f'"primvars:displayColor" has {len(values)} colours'
        raise NotSupported(what, colour.GetAttr(), hint="write one colour, or bind a material with a texture")
    return _Shaded(Material(diffuse_color=Input(value=values[0] if values else _GREY), ior=1.0), "")


def _normals(mesh: UsdGeom.Mesh, shape: Fans) -> tuple[Numbers, ...]:
    """Authored normals at the corners of all triangles; none: flat ones."""
    primvar = UsdGeom.PrimvarsAPI(mesh.GetPrim()).GetPrimvar("normals")
    if primvar and primvar.HasAuthoredValue():
        values, interpolation, attribute = primvar.ComputeFlattened(), primvar.GetInterpolation(), primvar.GetAttr()
    else:
        attribute = mesh.GetNormalsAttr()
        values, interpolation = attribute.Get(), mesh.GetNormalsInterpolation()
    return _at_corners(plain(values or ()), interpolation, shape, attribute, 3)


def _st(mesh: UsdGeom.Mesh, shape: Fans, shaded: list[_Shaded]) -> tuple[Numbers, ...]:
    """Texture coordinates at the corners of all triangles."""
    names = list(dict.fromkeys(each.primvar for each in shaded if texture_names([each.material])))
    if len(names) > 1:
        what = f"its materials read texture coordinates from {' and '.join(names)}"
        raise NotSupported(what, mesh.GetPrim(), hint="use one set of texture coordinates")
    primvar = UsdGeom.PrimvarsAPI(mesh.GetPrim()).FindPrimvarWithInheritance(names[0])
    values = plain(primvar.ComputeFlattened() or ()) if primvar and primvar.HasValue() else ()
    if not values:
        hint = f"write texCoord2f[] primvars:{names[0]} with an interpolation"
        what = f'the material reads texture coordinates "{names[0]}", which <{mesh.GetPath()}> does not have'
        raise UnreadableValue(what, mesh.GetPrim(), hint=hint)
    return _at_corners(values, primvar.GetInterpolation(), shape, primvar.GetAttr(), 2)


def _at_corners(
    values: tuple[Numbers, ...], interpolation: str, shape: Fans, attribute: Usd.Attribute, size: int
) -> tuple[Numbers, ...]:
    """Values of a primvar, of so many numbers each, at the three corners of each triangle, one after the other."""
    if not values:
        return ()
    try:
        table = np.array(values, float).reshape(len(values), size)
    except (TypeError, ValueError):
        what = f'"{attribute.GetName()}" holds something else than {size} numbers each'
        raise UnreadableValue(what, attribute) from None
    rows = shape.places(interpolation)
    if not np.isfinite(table).all() or (len(rows) and np.max(rows) >= len(table)):
        raise UnreadableValue(f'"{attribute.GetName()}" has {len(table)} values, too few for the faces', attribute)
    return tuple(map(tuple, (table[np.array(rows, int)].reshape(len(rows), -1) + 0.0).tolist()))


def check_finishes(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of meshes and targets that depend on whether lamps light them; `wrong` holds prims with wrong values."""
    is_lit = bool(lamp_prims(root.GetStage()))
    for prim in targets(root, "plen:targets", "PlenTarget"):
        coat = prim.GetAttribute("plen:coat:roughness")
        if not is_lit and coat and coat.HasAuthoredValue():
            message = "the coat of a target is not seen, because the dataset has no lamp"
            hint = "add a light of UsdLux, such as a RectLight"
            yield problem(coat, "unused-value", message, hint=hint, severity="warning")
        for name in ("plen:white", "plen:black") if is_lit else ():
            if (read(prim, name) or 0.0) > 1:
                message = f'"{name}" = {read(prim, name):g} of a target that lamps light is a reflectance, at most 1'
                hint = "make the lamps brighter instead"
                yield problem(prim.GetAttribute(name), "reflectance", message, hint=hint)
    for prim in seen_meshes(root) if is_lit else ():
        scheme = UsdGeom.Mesh(prim).GetSubdivisionSchemeAttr()
        if prim.GetPath() in wrong:
            continue
        if scheme.Get() != UsdGeom.Tokens.none:
            message = f'"subdivisionScheme" is {scheme.Get()}, and surfaces are not subdivided'
            yield problem(scheme, "not-yet-supported", message, hint='write uniform token subdivisionScheme = "none"')
            continue
        try:
            read_finish(prim)
        except UnreadableValue as error:
            yield problem(error.thing, error.code, error.what, hint=error.hint)
        except ValueError:
            continue  # faces that contradict each other are reported elsewhere
