"""Materials: inputs as affine functions of texels, and what a surface is made of at a point.

In one light each input of a material is a number: a constant plus a sum over the four components of a texel, each
times a coefficient. Both hold scale and bias of the texture, and the light.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline
from pipeline.records.shapes import Float64, Num
from pipeline.render.lighting.records import Coat, Input, Material
from pipeline.render.lighting.reflection import LEAST_ALPHA, Paint

DIFFUSE, METALLIC, ROUGHNESS, EMISSION, OPACITY, SPECULAR, NORMAL_X, NORMAL_Y, NORMAL_Z = range(9)
"""Inputs of a material [1]."""
INPUTS = 9
"""Number of inputs."""
TEXTURE, WRAP_S, WRAP_T, CONSTANT = range(4)
"""Columns of an input: row of its texture, -1 without; wrap modes, numbers of `WRAPS`; its constant."""
COEFFICIENTS, MAP = 4, 8
"""First columns of the coefficients of a texel's components, and of the map from the primvar to s and t."""
COLUMNS = 14
"""Number of columns of an input."""
WORKFLOW, FACING, THRESHOLD, LAYER, BUMPY = range(5)
"""Flags of a material: whether `specularColor` counts; reflectance of a facet of its dielectric face on; opacity below
which it is a hole, 0: none; whether it has a specular layer; whether its normal is not constant."""
FLAGS = 5
"""Number of flags."""
WRAPS = ("repeat", "mirror", "clamp", "black")
"""Wrap modes, by their number in kernels."""
REPEAT, MIRROR, CLAMP, BLACK = range(4)
"""Numbers of the wrap modes."""


class Materials(NamedTuple):
    """All materials in one light: inputs (m, INPUTS, COLUMNS) and flags (m, FLAGS)."""

    inputs: np.ndarray
    flags: np.ndarray
    pictures: np.ndarray  # (k, 3) int64, first texel, width and height of each texture
    texels: np.ndarray  # (n, 4) float32, linear, the first row of a picture is its top


@inline
def _wrapped(index, count, mode):
    """Index of a texel; -1: beyond the picture, black."""
    if 0 <= index < count:
        return index
    if mode == REPEAT:
        return index % count
    if mode == MIRROR:
        turn = index % (2 * count)
        return turn if turn < count else 2 * count - 1 - turn
    return min(max(index, 0), count - 1) if mode == CLAMP else -1


@inline
def _texel(materials, picture, x, y, place):
    """One component of a texel; column and row as `_wrapped` gives them."""
    if x < 0 or y < 0:
        return 0.0
    first, width = materials.pictures[picture, 0], materials.pictures[picture, 1]
    return materials.texels[first + y * width + x, place]


@inline
def input_at(materials, m, which, st):
    """An input of a material at texture coordinates, between the centres of four texels."""
    row = materials.inputs[m, which]
    value, picture = row[CONSTANT], int(row[TEXTURE])
    if picture < 0:
        return value
    width, height = materials.pictures[picture, 1], materials.pictures[picture, 2]
    s = row[MAP] * st[0] + row[MAP + 1] * st[1] + row[MAP + 2]
    t = row[MAP + 3] * st[0] + row[MAP + 4] * st[1] + row[MAP + 5]
    x, y = s * width - 0.5, (1.0 - t) * height - 0.5
    if not abs(x) + abs(y) < 1e15:
        return value
    i, j = math.floor(x), math.floor(y)
    a, b = x - i, y - j
    left, right = _wrapped(i, width, row[WRAP_S]), _wrapped(i + 1, width, row[WRAP_S])
    up, down = _wrapped(j, height, row[WRAP_T]), _wrapped(j + 1, height, row[WRAP_T])
    for k in range(4):
        if row[COEFFICIENTS + k] != 0.0:
            upper = (1.0 - a) * _texel(materials, picture, left, up, k) + a * _texel(materials, picture, right, up, k)
            lower = (1.0 - a) * _texel(materials, picture, left, down, k)
            lower += a * _texel(materials, picture, right, down, k)
            value += row[COEFFICIENTS + k] * ((1.0 - b) * upper + b * lower)
    return value


@inline
def is_hole(materials, m, st):
    """Whether a material lets everything through at a point."""
    threshold = materials.flags[m, THRESHOLD]
    return threshold > 0.0 and input_at(materials, m, OPACITY, st) < threshold


@inline
def _share(x):
    return min(max(x, 0.0), 1.0)


@inline
def paint_at(materials, m, st):
    """The paint of a surface at a point."""
    colour = _share(input_at(materials, m, DIFFUSE, st))
    if materials.flags[m, LAYER] == 0.0:
        return Paint(colour, 0.0, 0.0)
    alpha = max(LEAST_ALPHA, _share(input_at(materials, m, ROUGHNESS, st)) ** 2)
    if materials.flags[m, WORKFLOW] > 0.0:
        return Paint(colour, _share(input_at(materials, m, SPECULAR, st)), alpha)
    metal = _share(input_at(materials, m, METALLIC, st))
    return Paint((1.0 - metal) * colour, (1.0 - metal) * materials.flags[m, FACING] + metal * colour, alpha)


class MaterialTable:
    """A list of materials that grows, with linear pictures (h, w, 4) by name; their first row is the top."""

    def __init__(self, pictures: Mapping[str, Num[np.ndarray, "h w c"]]) -> None:
        self._names = list(pictures)
        sizes = [(picture.shape[1], picture.shape[0]) for picture in pictures.values()]
        first = np.cumsum([0, *(width * height for width, height in sizes)])
        places = [(start, *size) for start, size in zip(first, sizes, strict=False)]
        self._pictures = np.array(places, np.int64).reshape(-1, 3)
        texels = [np.asarray(picture, np.float32).reshape(-1, 4) for picture in pictures.values()]
        self._texels = np.concatenate([np.zeros((0, 4), np.float32), *texels])
        self._materials: list[tuple[Material, float]] = []
        self._flags: list[tuple[float, ...]] = []

    def add(self, material: Material, radiance: float = 0.0) -> int:
        """Add a material that also shines by itself; returns its row."""
        bumpy = material.normal.texture is not None
        self._materials.append((material, radiance))
        facing = facing_of(material.ior)
        flags = material.specular_color is not None, facing, material.opacity_threshold, _has_layer(material), bumpy
        self._flags.append(flags)
        return len(self._flags) - 1

    def add_coat(self, coat: Coat | None) -> int:
        """Add what lies on the artwork of a target; returns its row."""
        row = self.add(Material(roughness=Input(value=(coat.roughness if coat else 0.0,)), ior=coat.ior if coat else 1))
        self._flags[row] = (False, facing_of(coat.ior) if coat else 0.0, 0.0, coat is not None, False)
        return row

    def arrays(self, raised: Float64[np.ndarray, "3"]) -> Materials:
        """All materials in a light, by its weights of red, green and blue; pictures are shared."""
        inputs = [self._inputs(*material, raised) for material in self._materials]
        flags = np.array(self._flags, float).reshape(-1, FLAGS)
        return Materials(np.array(inputs).reshape(-1, INPUTS, COLUMNS), flags, self._pictures, self._texels)

    def _inputs(self, material: Material, radiance: float, raised: np.ndarray) -> np.ndarray:
        inputs = np.zeros((INPUTS, COLUMNS))
        colours = {DIFFUSE: material.diffuse_color, EMISSION: material.emissive_color}
        if material.specular_color:
            colours[SPECULAR] = material.specular_color
        for place, value in colours.items():
            inputs[place] = self._row(value, raised)
        numbers = (material.metallic, material.roughness, material.opacity)
        for place, value in zip((METALLIC, ROUGHNESS, OPACITY), numbers, strict=True):
            inputs[place] = self._row(value, np.ones(1))
        for axis in range(3):
            inputs[NORMAL_X + axis] = self._row(material.normal, np.eye(3)[axis])
        inputs[EMISSION, CONSTANT] += radiance
        return inputs

    def _row(self, value: Input, weights: np.ndarray) -> np.ndarray:
        """An input whose components are summed up with some weights."""
        row, texture = np.zeros(COLUMNS), value.texture
        row[TEXTURE] = -1
        row[CONSTANT] = float(weights @ np.array(value.value))
        if texture is None:
            return row
        places = [0, 1, 2] if texture.channel == "rgb" else ["rgba".index(texture.channel)]
        row[TEXTURE] = self._names.index(texture.name)
        row[WRAP_S], row[WRAP_T] = (WRAPS.index(wrap) for wrap in texture.wrap)
        row[CONSTANT] = float(weights @ np.array(texture.bias)[places])
        row[[COEFFICIENTS + place for place in places]] = weights * np.array(texture.scale)[places]
        row[MAP:] = texture.st_from_primvar
        return row


def facing_of(ior: float) -> float:
    """Reflectance of a dielectric in air, face on (Fresnel)."""
    return ((ior - 1.0) / (ior + 1.0)) ** 2


def _has_layer(material: Material) -> bool:
    """Whether a specular layer is there: none has the index of air, or a black `specularColor`."""
    if material.specular_color:
        return bool(material.specular_color.texture or any(material.specular_color.value))
    return bool(material.metallic.texture or any(material.metallic.value) or material.ior != 1.0)


def texture_names(materials: Sequence[Material]) -> list[str]:
    """Names of the pictures that materials ask for, each once."""
    inputs = [getattr(material, name) for material in materials for name in Material.__slots__]
    return list(dict.fromkeys(value.texture.name for value in inputs if isinstance(value, Input) and value.texture))
