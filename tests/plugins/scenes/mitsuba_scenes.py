"""Lit scenes twice: for this program and for Mitsuba 3, seen by the same pinhole at the origin of the vision frame."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from plugins.scenes.lit import ball, block, lamp, named, scene
from published.mitsuba_sensor import FOV_DEG, HEIGHT_PX, WIDTH_PX, mi, pinhole
from pxr import Usd, UsdGeom

from pipeline.plugins.scenes.lighting.draws import Names
from pipeline.plugins.scenes.lighting.lit_scene import LitScene
from pipeline.plugins.scenes.lighting.records import Finish, Material, PlacedLamp, Shaping
from pipeline.plugins.scenes.picture_files import decoded
from pipeline.plugins.scenes.reading.materials import read_finish
from pipeline.plugins.scenes.reading.pictures import name_of, named_by, picture_of
from pipeline.scene.occluders import read_occluder
from pipeline.scene.usd.readers import notes_of
from pipeline.targets.mesh import Occluder


@dataclass
class Both:
    things: list[tuple[Occluder, Material | Finish]] = field(default_factory=list)
    lamps: list[PlacedLamp] = field(default_factory=list)
    theirs: dict[str, Any] = field(default_factory=dict)
    pictures: dict[str, np.ndarray] = field(default_factory=dict)
    integrator: str = "path"

    def plate(self, pose: np.ndarray, half_mm: float, material: Material, bsdf: dict[str, Any]) -> None:
        """A square plate in z = 0 of its frame, with the same material twice."""
        corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
        points = tuple(tuple((pose @ [a * half_mm, b * half_mm, 0, 1])[:3].tolist()) for a, b in corners)
        self.things.append((Occluder(vertices_mm=points, triangles=((0, 1, 2), (0, 2, 3))), material))
        shape = mi.ScalarTransform4f(pose) @ mi.ScalarTransform4f().scale([half_mm, half_mm, 1])
        self.theirs[f"plate{len(self.things)}"] = {
            "type": "rectangle",
            "to_world": shape,
            "bsdf": bsdf if bsdf["type"] in ("mask", "thindielectric") else {"type": "twosided", "bsdf": bsdf},
        }

    def block(
        self, pose: np.ndarray, half_mm: tuple[float, float, float], material: Material, bsdf: dict, **more: Any
    ) -> None:
        """A box about the origin of its frame, which is of glass."""
        self.things.append((block([-half for half in half_mm], half_mm, pose), material))
        shape = mi.ScalarTransform4f(pose) @ mi.ScalarTransform4f().scale(list(half_mm))
        self.theirs[f"block{len(self.things)}"] = {"type": "cube", "to_world": shape, "bsdf": bsdf, **more}

    def ball(
        self, centre_mm: tuple[float, float, float], radius_mm: float, material: Material, bsdf: dict, **more: Any
    ) -> None:
        """A ball of glass, as fine triangles here."""
        self.things.append(ball(centre_mm, radius_mm, material, 2e-4))
        shape = {"type": "sphere", "center": list(centre_mm), "radius": radius_mm, "bsdf": bsdf, **more}
        self.theirs[f"ball{len(self.things)}"] = shape

    def lamp(self, kind: str, size: tuple[float, float], pose: np.ndarray, radiance: float) -> None:
        """A lamp that shines along the -z of its pose."""
        self.lamps.append(lamp(kind, size, pose, (radiance,) * 3))
        turned = mi.ScalarTransform4f(pose @ np.diag([1.0, -1.0, -1.0, 1.0]))
        area = {"type": "area", "radiance": {"type": "rgb", "value": [radiance] * 3}}
        black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
        scale = mi.ScalarTransform4f().scale
        shapes = {
            "rect": {"type": "rectangle", "to_world": turned @ scale([*size, 1])},
            "disk": {"type": "disk", "to_world": turned @ scale([size[0], size[0], 1])},
            "sphere": {"type": "sphere", "center": pose[:3, 3].tolist(), "radius": size[0]},
            "cylinder": {
                "type": "cylinder",
                "p0": (pose[:3, 3] - size[0] * pose[:3, 0]).tolist(),
                "p1": (pose[:3, 3] + size[0] * pose[:3, 0]).tolist(),
                "radius": size[1],
            },
        }
        name = f"lamp{len(self.lamps)}"
        if kind == "distant":
            light = {"type": "rgb", "value": [radiance] * 3}
            self.theirs[name] = {"type": "directional", "direction": (-pose[:3, 2]).tolist(), "irradiance": light}
        elif kind == "dome":
            self.theirs[name] = {"type": "constant", "radiance": {"type": "rgb", "value": [radiance] * 3}}
        else:
            self.theirs[name] = {**shapes[kind], "emitter": area, "bsdf": black}

    def spot(self, pose: np.ndarray, intensity: float, cone: float, softness: float, focus: float) -> None:
        """A lamp so small that it is a point, with a soft cone and a focus by UsdLux's formulas.

        Mitsuba's spot fades out linearly; instead it shines with the same intensity through a picture of the factors.
        """
        radius_mm = 1.0
        shaping = Shaping(cone=cone, softness=softness, focus=focus)
        radiance = (intensity / (np.pi * radius_mm**2),) * 3
        self.lamps.append(lamp("sphere", (radius_mm, 0.0), pose, radiance, shaping=shaping))
        across = (2.0 * (np.arange(1024) + 0.5) / 1024 - 1.0) * np.tan(cone)
        off = np.arctan(np.hypot(across, across[:, None]))
        x = np.clip((off - (1.0 - softness) * cone) / (softness * cone), 0.0, 1.0)
        factor = np.cos(off) ** focus * (1.0 - x * x * (3.0 - 2.0 * x))
        picture = np.repeat(factor[..., None], 3, axis=2).astype(np.float32)
        self.theirs[f"lamp{len(self.lamps)}"] = {
            "type": "spot",
            "to_world": mi.ScalarTransform4f(pose @ np.diag([1.0, -1.0, -1.0, 1.0])),
            "intensity": {"type": "rgb", "value": intensity},
            "cutoff_angle": np.degrees(cone),
            "beam_width": np.degrees(cone),
            "texture": {"type": "bitmap", "bitmap": mi.Bitmap(picture), "raw": True},
        }

    def sheets(self, file: Path, theirs: dict[str, dict[str, Any]]) -> None:
        """The polygons of a stage in millimetres, whose world is the vision frame; Mitsuba's part of each by name."""
        stage = Usd.Stage.Open(str(file))
        notes_of(stage).folders = [file.parent]
        for attribute, space in (each for prim in stage.TraverseAll() for each in named_by(prim)):
            picture = picture_of(attribute)
            self.pictures[name_of(attribute, space)] = decoded(picture.content, picture.suffix, space)
        for prim in (prim for prim in stage.TraverseAll() if prim.IsA(UsdGeom.Mesh)):
            self.things.append((read_occluder(prim), read_finish(prim)))
        for name, more in theirs.items():
            mesh = UsdGeom.Mesh.Get(stage, f"/{name}")
            st = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get()
            lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.GetPointsAttr().Get()]
            lines += [*(f"vt {s!r} {t!r}" for s, t in st), "f 1/1 2/2 3/3 4/4"]
            obj = file.with_name(f"{name}.obj")
            obj.write_text("\n".join(lines), encoding="utf-8")
            self.theirs[name] = {"type": "obj", "filename": str(obj), "face_normals": True, **more}

    def ours(self, bounces: int) -> LitScene:
        return scene(self.things, self.lamps, bounces=bounces, pictures=self.pictures)

    def reference(self, bounces: int, samples: int, seeds: int) -> np.ndarray:
        """Mitsuba's pictures with several seeds, (seeds, h, w)."""
        sensor = pinhole(samples, near_clip=1.0, far_clip=1e6)
        path = {"type": self.integrator, "max_depth": bounces + 2, "rr_depth": 100}
        loaded = mi.load_dict({"type": "scene", "integrator": path, "sensor": sensor, **self.theirs})
        return np.array([np.array(mi.render(loaded, spp=samples, seed=seed))[..., 0] for seed in range(seeds)])


def our_pictures(lit: LitScene, samples: int, seeds: int) -> np.ndarray:
    """Our pictures with several sets of rays, (seeds, h, w)."""
    generator, pictures = np.random.default_rng(5), []
    for seed in range(seeds):
        y, x = np.mgrid[:HEIGHT_PX, :WIDTH_PX]
        spread = generator.random((2, HEIGHT_PX, WIDTH_PX, samples))
        half = np.tan(np.radians(FOV_DEG) / 2)
        u = ((x[..., None] + spread[0]) / WIDTH_PX * 2 - 1) * half
        v = ((y[..., None] + spread[1]) * 2 / WIDTH_PX - HEIGHT_PX / WIDTH_PX) * half
        way = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        key, place = named(samples, WIDTH_PX * HEIGHT_PX)
        names = Names(key + np.uint32(seed * WIDTH_PX * HEIGHT_PX), place)
        pictures.append(lit.radiance(np.zeros_like(way), way, names).reshape(HEIGHT_PX, WIDTH_PX, samples).mean(axis=2))
    return np.array(pictures)
