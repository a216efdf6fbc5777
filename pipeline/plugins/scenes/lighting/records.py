"""Lamps, materials and finishes of a lit scene, as parameters of tasks."""

import math
from dataclasses import dataclass, field
from typing import Annotated, Any

from pipeline.motion import Motion
from pipeline.records.plain import ByContent
from pipeline.targets.target import Coat

Rgb = tuple[float, float, float]
"""Linear components of sRGB's primaries."""
Numbers = tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Shaping:
    """Radiance of a lamp by direction, as the ShapingAPI of UsdLux has it."""

    focus: float = 0.0  # power of the cosine from the axis
    focus_tint: Rgb = (0.0, 0.0, 0.0)
    cone: float = math.pi / 2  # largest angle from the axis [rad]
    softness: float = 0.0  # part of the cone in which light fades out


@dataclass(frozen=True, slots=True, kw_only=True)
class Lamp:
    """A lamp of UsdLux, in its own frame: x, y and z as USD has them."""

    kind: str  # `rect`, `disk`, `sphere`, `cylinder`, `distant` or `dome`
    radiance: Rgb  # what leaves it, relative; of a distant lamp without extent the irradiance across its light
    # rect: half its width and height [mm]. Disk, sphere: radius, 0. Cylinder: half its length, radius. Distant: half
    # its angle [rad], 0
    size: tuple[float, float] = (0.0, 0.0)
    texture: str = ""  # name of the task's input that holds the picture of a dome or a rect; empty: there is none
    shaping: Shaping | None = None  # None: the same in all directions

    @property
    def area(self) -> float:
        """Area of the bright side [mm^2]; for distant lamps and domes the solid angle of their light [sr]."""
        a, b = self.size
        areas = {
            "rect": 4 * a * b,
            "disk": math.pi * a * a,
            "sphere": 4 * math.pi * a * a,
            "cylinder": 4 * math.pi * a * b,
            "distant": 4 * math.pi * math.sin(a / 2) ** 2,
            "dome": 4 * math.pi,
        }
        return areas[self.kind]


@dataclass(frozen=True, slots=True, kw_only=True)
class Texture:
    """A picture on a surface: value = scale * texel + bias, by component."""

    name: str  # name of the task's input that holds the picture
    channel: str = "rgb"  # `rgb`, or `r`, `g`, `b`, `a` for an input that is one number
    scale: Numbers = (1.0, 1.0, 1.0, 1.0)
    bias: Numbers = (0.0, 0.0, 0.0, 0.0)
    wrap: tuple[str, str] = ("repeat", "repeat")  # `repeat`, `mirror`, `clamp` or `black`, along s and t
    st_from_primvar: Numbers = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)  # rows of the affine map from the primvar to s and t
    primvar: str = "st"  # name of the texture coordinates


@dataclass(frozen=True, slots=True, kw_only=True)
class Input:
    """An input of a material: a value of one or three numbers, a texture, or a primvar, whose name is not empty."""

    value: Numbers
    texture: Texture | None = None
    primvar: str = ""

    def differs(self, idle: float) -> bool:
        """Whether the input may be anything else than a number."""
        return bool(self.texture or self.primvar or any(number != idle for number in self.value))


@dataclass(frozen=True, slots=True, kw_only=True)
class Glass:
    """A clear medium below a surface: its refractive index, relative to air, and its absorption."""

    # ascending, and the index at each; linear in between, and constant beyond
    wavelengths_nm: Numbers
    indices: Numbers
    transmittance: Rgb = (1.0, 1.0, 1.0)  # share of white light that `thickness_mm` of it let pass
    thickness_mm: float = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """A UsdPreviewSurface. `specular_color`, where it is given, replaces `metallic` and `ior`.

    Without a threshold, opacity acts on the whole surface if `is_presence`, else on its paint alone. Of a material with
    `glass` only `roughness`, `normal` and `emissive_color` count.
    """

    diffuse_color: Input = Input(value=(0.18, 0.18, 0.18))
    metallic: Input = Input(value=(0.0,))
    roughness: Input = Input(value=(0.5,))
    emissive_color: Input = Input(value=(0.0, 0.0, 0.0))
    opacity: Input = Input(value=(1.0,))
    normal: Input = Input(value=(0.0, 0.0, 1.0))
    specular_color: Input | None = None
    ior: float = 1.5
    opacity_threshold: float = 0.0
    clearcoat: Input = Input(value=(0.0,))
    clearcoat_roughness: Input = Input(value=(0.01,))
    is_presence: bool = False
    glass: Glass | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Finish(ByContent):
    """Materials of the triangles of a mesh, with normals in its frame and primvars at their corners, by name."""

    materials: tuple[Material, ...]
    material_of: Any = None  # index of the material of each triangle, (t,); None: all have the first
    normals: Any = None  # (t, 9) float64; None: flat ones
    primvars: dict[str, Any] = field(default_factory=dict)  # (t, 3 k) of k numbers


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedLamp:
    """A lamp in a frame; the transform is a rotation and a translation [mm]. It may move before an open shutter."""

    lamp: dict[str, Any]
    vision_from_lamp: Annotated[list[list[float]], "poses"]
    motion: Annotated[Motion | None, "motions"] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Lighting:
    """Lamps of a lit view, the coat of each target, and the finish of each occluder, a plain `Finish`."""

    lamps: Annotated[tuple[PlacedLamp, ...], "lamps"]
    coats: Annotated[tuple[Coat | None, ...], "targets/*"] = ()
    finishes: Annotated[tuple[dict[str, Any], ...], "occluders"] = ()
    bounces: int = 2  # reflections of a path beyond the surface that the camera sees and direct light reaches
