"""Small lit scenes for the laws of light: plates and lamps before an eye at the origin; vision frame, mm."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from laws.meshes import mesh
from tolerances import LIT_ERRORS

from pipeline.camera.parts.spectrum import alone
from pipeline.frames import rigid
from pipeline.plugins.scenes.lighting.draws import Names
from pipeline.plugins.scenes.lighting.lit_scene import LitScene, LitView
from pipeline.plugins.scenes.lighting.records import (
    Coat,
    Finish,
    Glass,
    Input,
    Lamp,
    Lighting,
    Material,
    PlacedLamp,
    Shaping,
)
from pipeline.plugins.scenes.reading import solids
from pipeline.records.plain import to_plain
from pipeline.targets.mesh import Occluder
from pipeline.targets.target import AnyTarget

RAYS = 1 << 14
"""Rays along the same line."""
SCRAMBLES = 64
"""Parts into which these rays are divided, each with random numbers of its own."""


def towards(z: Sequence[float], centre_mm: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """A pose whose z axis has a direction; lamps shine along -z."""
    axis = np.array(z, float) / np.linalg.norm(z)
    side = np.cross(axis, [0.3, -0.5, 0.8])
    side /= np.linalg.norm(side)
    return rigid(np.stack([side, np.cross(axis, side), axis], axis=1), np.array(centre_mm, float))


def lamp(
    kind: str,
    size: tuple[float, float] = (0.0, 0.0),
    pose: np.ndarray | None = None,
    radiance: tuple[float, float, float] = (1.0, 1.0, 1.0),
    texture: str = "",
    shaping: Shaping | None = None,
) -> PlacedLamp:
    plain = to_plain(Lamp(kind=kind, radiance=radiance, size=size, texture=texture, shaping=shaping))
    return PlacedLamp(lamp=plain, vision_from_lamp=(np.eye(4) if pose is None else pose).tolist())


def plate(z_mm: float, half_mm: float = 400.0, x_mm: float = 0.0) -> Occluder:
    """A square across the axis."""
    a, b = x_mm - half_mm, x_mm + half_mm
    return mesh([(a, -half_mm, z_mm), (b, -half_mm, z_mm), (b, half_mm, z_mm), (a, half_mm, z_mm)])


def block(low_mm: Sequence[float], high_mm: Sequence[float], pose: np.ndarray | None = None) -> Occluder:
    """A box between two corners, moved by a pose."""
    ends = (low_mm, high_mm)
    places = [(ends[a][0], ends[b][1], ends[c][2], 1.0) for a in (0, 1) for b in (0, 1) for c in (0, 1)]
    faces = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    points = (np.array(places) @ (np.eye(4) if pose is None else pose).T)[:, :3]
    return mesh(points, [three for a, b, c, d in faces for three in ((a, b, c), (a, c, d))])


def ball(centre_mm: Sequence[float], radius_mm: float, material: Material, sag: float) -> tuple[Occluder, Finish]:
    """A ball as triangles, whose middles lie within `sag` of its radius from it, and its normals."""
    solid = solids.sphere(radius_mm, sag * radius_mm)
    normals = tuple(map(tuple, solid.normals.reshape(-1, 9).tolist()))
    return mesh(solid.points + centre_mm, solid.triangles), Finish(materials=(material,), normals=normals)


def glass(index: float = 1.5, roughness: float = 0.0, **more: Any) -> Material:
    """Glass of one index, which absorbs nothing unless more is said of it."""
    of_glass = Glass(wavelengths_nm=(550.0,), indices=(index,), **more)
    return Material(roughness=Input(value=(roughness,)), glass=of_glass)


def matt(reflectance: float) -> Material:
    """A material without a specular layer: its index is that of air."""
    return Material(diffuse_color=Input(value=(reflectance,) * 3), ior=1.0)


def scene(
    things: Sequence[tuple[Occluder, Material | Finish]],
    lamps: Sequence[PlacedLamp],
    *,
    targets: Sequence[tuple[AnyTarget, np.ndarray, Coat | None]] = (),
    bounces: int = 0,
    wavelength_nm: float = 550.0,
    pictures: dict[str, np.ndarray] | None = None,
    background: float = 0.0,
) -> LitScene:
    """A lit scene of meshes, each with its material or more, and targets, each with its pose and its coat."""
    lighting = Lighting(
        lamps=tuple(lamps),
        coats=tuple(coat for *_, coat in targets),
        finishes=tuple(
            to_plain(Finish(materials=(made,)) if isinstance(made, Material) else made) for _, made in things
        ),
        bounces=bounces,
    )
    view = LitView(
        targets=[(target, pose) for target, pose, _ in targets],
        occluders=[(mesh, np.eye(4)) for mesh, _ in things],
        lighting=lighting,
        pictures=pictures or {},
        background=background,
        lights=(alone(wavelength_nm),),
    )
    return view.in_light(0)


def named(rays: int, pixels: int = 1) -> Names:
    """Names of so many rays of each of some pixels, pixel by pixel."""
    return Names(np.repeat(np.arange(pixels, dtype=np.uint32), rays), np.tile(np.arange(rays), pixels))


def looked(
    lit: LitScene,
    at_mm: Sequence[float],
    eye_mm: Sequence[float] = (0.0, 0.0, 0.0),
    rays: int = RAYS,
    scrambles: int = SCRAMBLES,
) -> tuple[float, float]:
    """Mean radiance along many paths from an eye towards a point, and its standard error.

    The points of a path are evenly spread, so that the spread of single rays says nothing about the mean. Scrambles
    are independent of each other, and each of them has the right mean: what their means differ by is the error.
    """
    way = np.array(at_mm, float) - np.array(eye_mm, float)
    origin, direction = np.tile(np.array(eye_mm, float), (rays, 1)), np.tile(way / np.linalg.norm(way), (rays, 1))
    count = min(scrambles, rays)
    values = lit.radiance(origin, direction, named(rays // count, count)).reshape(count, -1).mean(axis=1)
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(count))


def agrees(look: tuple[float, float], expected: float, slack: float = 0.0, noise: float | None = None) -> None:
    """Whether a mean is the expected one within its error and `slack`, and the error within a share of it, `noise`."""
    found, error = look
    assert abs(found - expected) <= LIT_ERRORS * error + slack, (found, error, expected)
    assert noise is None or LIT_ERRORS * error < noise * expected


def sky_on(material: Material, eye_mm: Sequence[float], rays: int = RAYS) -> tuple[float, float]:
    """Look from a place at the middle of a plate, alone below an even sky of radiance 1."""
    return looked(scene([(plate(500.0), material)], [lamp("dome")]), (0.0, 0.0, 500.0), eye_mm, rays)
