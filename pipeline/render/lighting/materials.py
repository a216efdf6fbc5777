"""Materials made ready for the kernels, in one light."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.records.shapes import Float64, Num
from pipeline.render.lighting import material_kernels as kernels
from pipeline.render.lighting.material_kernels import COEFFICIENTS, INPUTS, MAP, Materials
from pipeline.render.lighting.records import Coat, Input, Material


class MaterialTable:
    """A list of materials that grows.

    `pictures`, mapping of (h, w, 4) arrays: linear pictures by name; the first row is the top.
    """

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
        flags = np.array(self._flags, float).reshape(-1, kernels.FLAGS)
        return Materials(np.array(inputs).reshape(-1, INPUTS, kernels.COLUMNS), flags, self._pictures, self._texels)

    def _inputs(self, material: Material, radiance: float, raised: np.ndarray) -> np.ndarray:
        inputs = np.zeros((INPUTS, kernels.COLUMNS))
        colours = {kernels.DIFFUSE: material.diffuse_color, kernels.EMISSION: material.emissive_color}
        if material.specular_color:
            colours[kernels.SPECULAR] = material.specular_color
        for place, value in colours.items():
            inputs[place] = self._row(value, raised)
        numbers = (material.metallic, material.roughness, material.opacity)
        for place, value in zip((kernels.METALLIC, kernels.ROUGHNESS, kernels.OPACITY), numbers, strict=True):
            inputs[place] = self._row(value, np.ones(1))
        for axis in range(3):
            inputs[kernels.NORMAL_X + axis] = self._row(material.normal, np.eye(3)[axis])
        inputs[kernels.EMISSION, kernels.CONSTANT] += radiance
        return inputs

    def _row(self, value: Input, weights: np.ndarray) -> np.ndarray:
        """An input whose components are summed up with some weights."""
        row, texture = np.zeros(kernels.COLUMNS), value.texture
        row[kernels.TEXTURE] = -1
        row[kernels.CONSTANT] = float(weights @ np.array(value.value))
        if texture is None:
            return row
        places = [0, 1, 2] if texture.channel == "rgb" else ["rgba".index(texture.channel)]
        row[kernels.TEXTURE] = self._names.index(texture.name)
        row[kernels.WRAP_S], row[kernels.WRAP_T] = (kernels.WRAPS.index(wrap) for wrap in texture.wrap)
        row[kernels.CONSTANT] = float(weights @ np.array(texture.bias)[places])
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


def all_of(materials: Sequence[Material]) -> list[str]:
    """Names of the pictures that materials ask for, each once."""
    return list(
        dict.fromkeys(value.texture.name for material in materials for value in _inputs(material) if value.texture)
    )


def _inputs(material: Material) -> list[Input]:
    named = (getattr(material, name) for name in Material.__slots__)
    return [value for value in named if isinstance(value, Input)]
