"""Materials: their inputs at points of a surface, and the paint that follows from these.

In one light each input is a number, affine in the components of a texel or of a primvar:

    input = constant + sum over k of coefficient_k * texel_k

The constant and the coefficients hold scale and bias of the texture, and the spectrum of the light.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from pipeline.camera.parts.spectrum import Slice
from pipeline.jit.decorators import inline, unit
from pipeline.plugins.scenes.lighting.records import Coat, Glass, Input, Material
from pipeline.plugins.scenes.lighting.reflection import LEAST_ALPHA, Paint, let_through
from pipeline.plugins.scenes.lighting.refraction import through_face, through_pane
from pipeline.records.shapes import Float64, Num

DIFFUSE, METALLIC, ROUGHNESS, EMISSION, OPACITY, SPECULAR, NORMAL_X, NORMAL_Y, NORMAL_Z, COAT, COAT_ROUGHNESS = range(
    11
)
"""Inputs of a material [1]."""
INPUTS = 11
"""Number of inputs."""
TEXTURE, WRAP_S, WRAP_T, CONSTANT = range(4)
"""Columns of an input: row of its texture, or `NO_TEXTURE`, or `PRIMVAR`, the primvar itself; wrap modes, numbers of
`WRAPS`; its constant."""
COEFFICIENTS, MAP = 4, 8
"""First columns of the coefficients of a texel or a primvar, and of the map from the primvar to s and t."""
FIRST = 14
"""Column of an input: the first one of its texture coordinates, or of its primvar, among the primvars of the shape."""
COLUMNS = 15
"""Number of columns of an input."""
NO_TEXTURE, PRIMVAR = -1, -2
"""Entries in place of the row of a texture [1]."""
_RGB, _RGBA = 3, 4
"""Most components of a primvar, and those of a texel [1]."""
WORKFLOW, FACING, THRESHOLD, LAYER, BUMPY, VEIL, COATED, INDEX, ABSORPTION = range(9)
"""Flags of a material: whether `specularColor` counts; reflectance of a facet of its dielectric face on; opacity below
which it is a hole, 0: none; whether it has a specular layer; whether its normal is not constant; what light passes, one
of `SOLID` and those below it; whether it has a clear coat; of glass its index, and the coefficient of its absorption
[1/mm]."""
FLAGS = 9
"""Number of flags."""
WRAPS = ("repeat", "mirror", "clamp", "black")
"""Wrap modes, by their number in kernels."""
REPEAT, MIRROR, CLAMP, BLACK = range(4)
"""Numbers of the wrap modes."""
SOLID, CLEAR, PRESENCE, BODY, PANE = range(5)
"""Kinds of transparency: none; of the paint alone, by its opacity, so that layers above it still reflect; of the whole
surface, by its opacity; refraction by the faces of a body of glass; both faces of a thin pane of glass."""
_BEYOND = -1
"""Index in place of that of a texel [1]: beyond the picture, where it is black."""
_FARTHEST = 1e15
"""Distance from the origin of a texture from which it is not drawn [texels]: beyond 2^53, 9e15, float64 does not tell
neighbouring texels apart, and indices overflow soon after."""
_DARKEST = 1e-12
"""Least transmittance of glass [1]: its logarithm is finite."""


class Materials(NamedTuple):
    """All materials in one light: inputs (m, INPUTS, COLUMNS) and flags (m, FLAGS)."""

    inputs: np.ndarray
    flags: np.ndarray
    pictures: np.ndarray  # (k, 3) int64, first texel, width and height of each texture
    texels: np.ndarray  # (n, 4) float32, linear, the first row of a picture is its top


class Spot(NamedTuple):
    """A point of a triangle by its barycentric weights, and the primvars at the corners of all triangles, (t, 3, n)."""

    primvars: np.ndarray
    triangle: int
    weights: tuple[float, float, float]


@inline
def primvar_at(spot, column):
    """One number of the primvars at a point."""
    values, t, w = spot.primvars, spot.triangle, spot.weights
    return w[0] * values[t, 0, column] + w[1] * values[t, 1, column] + w[2] * values[t, 2, column]


@inline
def _wrapped(index, count, mode):
    """Index of a texel in the wrap mode of a texture, or `_BEYOND`."""
    if 0 <= index < count:
        return index
    if mode == REPEAT:
        return index % count
    if mode == MIRROR:
        turn = index % (2 * count)
        return turn if turn < count else 2 * count - 1 - turn
    return min(max(index, 0), count - 1) if mode == CLAMP else _BEYOND


@inline
def _texel(materials, picture, x, y, component):
    """One component of a texel; column and row as `_wrapped` gives them."""
    if x == _BEYOND or y == _BEYOND:
        return 0.0
    first_texel, width = materials.pictures[picture, 0], materials.pictures[picture, 1]
    return materials.texels[first_texel + y * width + x, component]


@inline
def input_at(materials, m, number, spot):
    """An input of a material at a point; textures are interpolated bilinearly between the centres of texels."""
    row = materials.inputs[m, number]
    value, picture, first_column = row[CONSTANT], int(row[TEXTURE]), int(row[FIRST])
    if picture == PRIMVAR:
        for k in range(_RGB):
            if row[COEFFICIENTS + k] != 0.0:
                value += row[COEFFICIENTS + k] * primvar_at(spot, first_column + k)
        return value
    if picture == NO_TEXTURE:
        return value
    width, height = materials.pictures[picture, 1], materials.pictures[picture, 2]
    st = primvar_at(spot, first_column), primvar_at(spot, first_column + 1)
    s = row[MAP] * st[0] + row[MAP + 1] * st[1] + row[MAP + 2]
    t = row[MAP + 3] * st[0] + row[MAP + 4] * st[1] + row[MAP + 5]
    x, y = s * width - 0.5, (1.0 - t) * height - 0.5
    if not abs(x) + abs(y) < _FARTHEST:  # also NaN
        return value
    i, j = math.floor(x), math.floor(y)
    right_share, lower_share = x - i, y - j
    left, right = _wrapped(i, width, row[WRAP_S]), _wrapped(i + 1, width, row[WRAP_S])
    up, down = _wrapped(j, height, row[WRAP_T]), _wrapped(j + 1, height, row[WRAP_T])
    for k in range(_RGBA):
        if row[COEFFICIENTS + k] != 0.0:
            upper = (1.0 - right_share) * _texel(materials, picture, left, up, k)
            upper += right_share * _texel(materials, picture, right, up, k)
            lower = (1.0 - right_share) * _texel(materials, picture, left, down, k)
            lower += right_share * _texel(materials, picture, right, down, k)
            value += row[COEFFICIENTS + k] * ((1.0 - lower_share) * upper + lower_share * lower)
    return value


@inline
def _clamped(x):
    """The number in [0, 1] that is nearest."""
    return min(max(x, 0.0), 1.0)


@unit
def passing(layers, materials, m, spot, cosine):
    """Transmittance of a surface for light that goes straight on, at a cosine to the normal of the triangle."""
    flags = materials.flags[m]
    if flags[THRESHOLD] > 0.0:
        return 1.0 if input_at(materials, m, OPACITY, spot) < flags[THRESHOLD] else 0.0
    if flags[VEIL] in (SOLID, BODY):
        return 0.0
    if flags[VEIL] == PANE:
        return through_pane(cosine, flags[INDEX])
    clear = 1.0 - _clamped(input_at(materials, m, OPACITY, spot))
    return clear * let_through(layers, paint_at(materials, m, spot), abs(cosine)) if flags[VEIL] == CLEAR else clear


@unit
def veiled(layers, materials, m, spot, cosine, paint):
    """Paint of a transparent surface for rays that by chance did not pass it, and the factor of their light."""
    passed = passing(layers, materials, m, spot, cosine)
    opacity = _clamped(input_at(materials, m, OPACITY, spot))
    faint = Paint(opacity * paint.diffuse, paint.facing, paint.alpha, paint.coat, paint.coat_alpha, 0.0)
    return faint, 1.0 / max(1.0 - passed, 1e-12)


@inline
def presence_at(materials, m, spot):
    """Share of a surface that is there."""
    flags = materials.flags[m]
    if flags[THRESHOLD] > 0.0:
        return 0.0 if input_at(materials, m, OPACITY, spot) < flags[THRESHOLD] else 1.0
    return _clamped(input_at(materials, m, OPACITY, spot)) if flags[VEIL] == PRESENCE else 1.0


@inline
def paint_at(materials, m, spot):
    """The paint of a surface at a point."""
    colour = _clamped(input_at(materials, m, DIFFUSE, spot))
    coat, coat_alpha, facing, alpha = 0.0, LEAST_ALPHA, 0.0, 0.0
    if materials.flags[m, COATED] > 0.0:
        coat = _clamped(input_at(materials, m, COAT, spot))
        coat_alpha = max(LEAST_ALPHA, _clamped(input_at(materials, m, COAT_ROUGHNESS, spot)) ** 2)
    if materials.flags[m, LAYER] > 0.0:
        alpha = max(LEAST_ALPHA, _clamped(input_at(materials, m, ROUGHNESS, spot)) ** 2)
        if materials.flags[m, WORKFLOW] > 0.0:
            facing = _clamped(input_at(materials, m, SPECULAR, spot))
        else:
            metal = _clamped(input_at(materials, m, METALLIC, spot))
            facing = (1.0 - metal) * materials.flags[m, FACING] + metal * colour
            colour *= 1.0 - metal
    return Paint(colour, facing, alpha, coat, coat_alpha, 0.0)


@inline
def _alpha_of_glass(materials, m, spot):
    """Width of facets of a body of glass; 0 where it is smooth, or of the index of air."""
    alpha = _clamped(input_at(materials, m, ROUGHNESS, spot)) ** 2
    return alpha if alpha > LEAST_ALPHA and materials.flags[m, INDEX] != 1.0 else 0.0


@inline
def glass_at(materials, m, spot, side):
    """The paint of a face of glass as it is seen from its front, side 1, or from inside, -1."""
    index = materials.flags[m, INDEX]
    if materials.flags[m, VEIL] == PANE:  # what has not passed is mirrored
        return Paint(0.0, 1.0, 0.0, 0.0, LEAST_ALPHA, index)
    ratio = index if side > 0.0 else 1.0 / index
    return Paint(0.0, 0.0, _alpha_of_glass(materials, m, spot), 0.0, LEAST_ALPHA, ratio)


@unit
def passing_to_lamps(materials, m, spot, cosine, path):
    """Transmittance of a face of a body of glass for light of a lamp that goes straight on, 0 if the face is rough;
    with the absorption on the path before it where that is inside.

    Right for plane-parallel plates, but for the shift of their light; an estimate for other bodies.
    """
    if _alpha_of_glass(materials, m, spot) > 0.0:
        return 0.0
    share, stretch = through_face(cosine, materials.flags[m, INDEX])
    return share * math.exp(-materials.flags[m, ABSORPTION] * stretch * path) if cosine > 0.0 else share


class MaterialTable:
    """Materials of a scene, appended one by one, with linear pictures (h, w, 4) by name, the first row at the top."""

    def __init__(self, pictures: Mapping[str, Num[np.ndarray, "h w c"]]) -> None:
        self._names = list(pictures)
        sizes = [(picture.shape[1], picture.shape[0]) for picture in pictures.values()]
        first = np.cumsum([0, *(width * height for width, height in sizes)])
        blocks = [(start, *size) for start, size in zip(first, sizes, strict=False)]
        self._pictures = np.array(blocks, np.int64).reshape(-1, 3)
        texels = [np.asarray(picture, np.float32).reshape(-1, 4) for picture in pictures.values()]
        self._texels = np.concatenate([np.zeros((0, 4), np.float32), *texels])
        self._materials: list[tuple[Material, float, Mapping[str, int]]] = []
        self._flags: list[np.ndarray] = []

    def add(
        self,
        material: Material,
        radiance: float = 0.0,
        columns: Mapping[str, int] = MappingProxyType({}),
        is_closed: bool = True,
    ) -> int:
        """Append a material that also emits a radiance, with the first columns of its primvars; returns its row.

        Glass of a mesh that is not closed is a pane.
        """
        flags = np.zeros(FLAGS)
        flags[WORKFLOW] = material.specular_color is not None
        flags[FACING] = facing_of(material.ior)
        flags[THRESHOLD] = 0.0 if material.glass else material.opacity_threshold
        flags[LAYER] = _has_layer(material)
        flags[BUMPY] = material.normal.texture is not None
        flags[COATED] = material.clearcoat.differs(0.0)
        if material.glass:
            flags[VEIL] = BODY if is_closed else PANE
        elif flags[THRESHOLD] > 0 or not material.opacity.differs(1.0):
            flags[VEIL] = SOLID
        else:
            flags[VEIL] = PRESENCE if material.is_presence else CLEAR
        self._materials.append((material, radiance, columns))
        self._flags.append(flags)
        return len(self._flags) - 1

    def add_coat(self, coat: Coat | None) -> int:
        """Append the coat of the artwork of a target, or the index of air without one; returns its row."""
        return self.add(Material(roughness=Input(value=(coat.roughness,)), ior=coat.ior) if coat else Material(ior=1.0))

    def arrays(self, rgb_weights: Float64[np.ndarray, "3"], light: Slice) -> Materials:
        """All materials in a light, by its weights of red, green and blue; pictures are shared."""
        inputs = [self._inputs(*material, rgb_weights) for material in self._materials]
        flags = np.array(self._flags).reshape(-1, FLAGS)
        for row, (material, *_) in zip(flags, self._materials, strict=True):
            if material.glass:
                row[INDEX], row[ABSORPTION] = _in_light(material.glass, rgb_weights, light)
        return Materials(np.array(inputs).reshape(-1, INPUTS, COLUMNS), flags, self._pictures, self._texels)

    def _inputs(
        self, material: Material, radiance: float, columns: Mapping[str, int], rgb_weights: np.ndarray
    ) -> np.ndarray:
        """Inputs of a material in a light, (INPUTS, COLUMNS)."""
        inputs = np.zeros((INPUTS, COLUMNS))
        colours = {DIFFUSE: material.diffuse_color, EMISSION: material.emissive_color}
        if material.specular_color:
            colours[SPECULAR] = material.specular_color
        for column, value in colours.items():
            inputs[column] = self._row(value, rgb_weights, columns)
        numbers = {METALLIC: material.metallic, ROUGHNESS: material.roughness, OPACITY: material.opacity}
        numbers |= {COAT: material.clearcoat, COAT_ROUGHNESS: material.clearcoat_roughness}
        for column, value in numbers.items():
            inputs[column] = self._row(value, np.ones(1), columns)
        for axis in range(3):
            inputs[NORMAL_X + axis] = self._row(material.normal, np.eye(3)[axis], columns)
        inputs[EMISSION, CONSTANT] += radiance
        return inputs

    def _row(self, value: Input, weights: np.ndarray, columns: Mapping[str, int]) -> np.ndarray:
        """An input as the sum of its components, each with a weight."""
        row = np.zeros(COLUMNS)
        texture = value.texture
        if value.primvar:
            row[TEXTURE] = PRIMVAR
            row[FIRST] = columns[value.primvar]
            row[COEFFICIENTS : COEFFICIENTS + len(weights)] = weights
            return row
        row[TEXTURE] = NO_TEXTURE
        row[CONSTANT] = float(weights @ np.array(value.value))
        if texture is None:
            return row
        components = [0, 1, 2] if texture.channel == "rgb" else ["rgba".index(texture.channel)]
        row[TEXTURE] = self._names.index(texture.name)
        row[WRAP_S], row[WRAP_T] = (WRAPS.index(wrap) for wrap in texture.wrap)
        row[CONSTANT] = float(weights @ np.array(texture.bias)[components])
        row[[COEFFICIENTS + component for component in components]] = weights * np.array(texture.scale)[components]
        row[MAP : MAP + 6] = texture.st_from_primvar
        row[FIRST] = columns.get(texture.primvar, 0)
        return row


def _in_light(glass: Glass, rgb_weights: Float64[np.ndarray, "3"], light: Slice) -> tuple[float, float]:
    """Index of glass, and its coefficient of absorption [1/mm], in a slice of light."""
    indices = np.interp(light.wavelengths_nm, glass.wavelengths_nm, glass.indices)
    share = float(np.clip(rgb_weights @ np.array(glass.transmittance), _DARKEST, 1.0))
    return float(indices @ np.array(light.shares)), -math.log(share) / glass.thickness_mm + 0.0


def facing_of(ior: float) -> float:
    """Reflectance of a dielectric in air, face on (Fresnel)."""
    return ((ior - 1.0) / (ior + 1.0)) ** 2


def _has_layer(material: Material) -> bool:
    """Whether a material has a specular layer: not with the index of air, or a black `specularColor`."""
    if material.specular_color:
        return material.specular_color.differs(0.0)
    return material.metallic.differs(0.0) or material.ior != 1.0
