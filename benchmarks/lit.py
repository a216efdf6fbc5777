"""Noise and time of lit scenes, beside the path tracer of Mitsuba 3 (extra `referees`), on one thread.

    python benchmarks/lit.py [--small]

Both see the same scene through a pinhole, with as many paths per pixel: example 05's still life, a matt room with two
lamps, and a room with gloss below a lamp and an even sky. Each spreads its rays over a pixel as it does in images: ours
by Owen-scrambled Sobol points, Mitsuba by its multijittered ones, which it draws fastest for a power of two.

Printed are, of each program, million paths per second of processor time, the noise of a picture over its mean (root
mean square over several seeds, and of the median pixel), and for how long ours works until it has as little noise as
Mitsuba: below 1, ours is faster. Gray is one channel of ours, colour the red, green and blue channels of example 05's
camera, of which Mitsuba renders all three at once. Materials are not alike in all scenes (Mitsuba's `principled` is
none of ours), so means differ by some percent.

LLVM 14 and 15 crash Mitsuba 3.9 on processors with AVX-512: set DRJIT_LIBLLVM_PATH to a later one.
"""

import argparse
import base64
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import pipeline
from pipeline.camera.parts.spectrum import alone
from pipeline.frames import apply
from pipeline.jit.decorators import kernel
from pipeline.plugins.scenes.graph import LitThings
from pipeline.plugins.scenes.lighting.draws import Names, draw, points
from pipeline.plugins.scenes.lighting.lit_scene import LitView
from pipeline.plugins.scenes.lighting.records import Finish, Input, Lamp, Lighting, Material, PlacedLamp
from pipeline.plugins.scenes.picture_files import decoded
from pipeline.plugins.scenes.tasks.images import lit_view
from pipeline.records.plain import from_plain, to_plain
from pipeline.targets.mesh import Occluder
from pipeline.targets.preview import preview_picture

STAGE = Path(__file__).resolve().parent.parent / "examples/05_scene/dataset.usda"
_WIDTH_PX, _HEIGHT_PX, _HALF_WIDTH = 160, 100, 0.3
"""Size of pictures, and the tangent of half the angle of view."""
_GREEN_NM, _AT_ONCE = 550.0, 1 << 15
"""Wavelength of scenes in gray; rays that ours traces at once, about as many as in a strip of an image."""


class Race(NamedTuple):
    """What one program needs for a picture, (h, w, channels) of several seeds."""

    pictures: np.ndarray
    paths: int
    seconds: float

    @property
    def noise(self) -> tuple[float, float]:
        """Root mean square of all pixels over their mean, and the median pixel's own."""
        mean, noise = self.pictures.mean(axis=0), self.pictures.std(axis=0, ddof=1)
        return float(np.sqrt(np.mean(noise**2)) / mean.mean()), float(np.median(noise / np.maximum(mean, 1e-12)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="16 paths per pixel and two seeds: does it run at all?")
    small = parser.parse_args().small
    samples, seeds = (16, 2) if small else (64, 6)
    still_life, channels = example_05()
    scenes = {
        "example 05, gray": (still_life, [channels[1]]),
        "example 05, colour": (still_life, channels),
        "matt room, gray": (matt_room(), [[0]]),
        "room with gloss, gray": (room_with_gloss(), [[0]]),
    }
    print(f"{'':24}{'program':10}{'Mpaths/s':>10}{'noise':>9}{'median':>9}{'mean':>9}{'time to equal noise':>21}")
    for name, (view, lights) in scenes.items():
        ours, theirs = our_race(view, lights, samples, seeds), their_race(view, samples, seeds)
        if len(lights) == 1:
            theirs = theirs._replace(pictures=theirs.pictures[..., 1:2])
        ratios = [ours.seconds * a**2 / (theirs.seconds * b**2) for a, b in zip(ours.noise, theirs.noise, strict=True)]
        show(name, "ours", ours, f"{ratios[0]:.2f}, median {ratios[1]:.2f}")
        show("", "Mitsuba", theirs, "")


def show(name: str, program: str, race: Race, ratio: str) -> None:
    """Print a row of the table."""
    noise, median = race.noise
    rate = race.paths / race.seconds / 1e6
    print(
        f"{name:24}{program:10}{rate:10.3f}{noise:9.4f}{median:9.4f}{race.pictures.mean():9.4f}{ratio:>21}", flush=True
    )


def raced(picture: Callable[[int], np.ndarray], paths: int, seeds: int) -> Race:
    """Pictures of several seeds, and the time of the median one; the first warms up and does not count."""
    pictures, seconds = [], []
    for seed in range(1 + seeds):
        start = time.process_time()
        pictures.append(picture(seed))
        seconds.append(time.process_time() - start)
    return Race(np.array(pictures[1:]), paths, float(np.median(seconds[1:])))


def our_race(view: LitView, channels: list[list[int]], samples: int, seeds: int) -> Race:
    """Ours: each channel is the mean of its wavelengths, which share its paths as those of an image do."""
    scenes = [[view.in_light(number) for number in lights] for lights in channels]
    pixels, each = _WIDTH_PX * _HEIGHT_PX, samples >> (len(channels[0]).bit_length() - 1)
    y, x = np.divmod(np.arange(pixels)[:, None], _WIDTH_PX)

    def picture(seed: int) -> np.ndarray:
        generator, images = np.random.default_rng([5, seed]), []
        keys = generator.integers(1 << 32, size=pixels, dtype=np.uint32)
        for scenes_of in scenes:
            image = np.zeros(pixels)
            for number, scene in enumerate(scenes_of):
                spread = np.empty((pixels, each, 2))
                spread_over_pixels(points(), generator.integers(1 << 32, size=pixels, dtype=np.uint32), spread)
                direction = np.ones((pixels, each, 3))
                direction[..., 0] = ((x + spread[..., 0]) / _WIDTH_PX * 2 - 1) * _HALF_WIDTH
                direction[..., 1] = ((y + spread[..., 1]) * 2 / _WIDTH_PX - _HEIGHT_PX / _WIDTH_PX) * _HALF_WIDTH
                direction = (direction / np.linalg.norm(direction, axis=-1, keepdims=True)).reshape(-1, 3)
                names = Names(np.repeat(keys, each), np.tile(number * each + np.arange(each), pixels))
                parts = [slice(i, i + _AT_ONCE) for i in range(0, len(direction), _AT_ONCE)]
                light = [
                    scene.radiance(np.zeros_like(direction[i]), direction[i], Names(names.key[i], names.rank[i]))
                    for i in parts
                ]
                image += np.concatenate(light).reshape(pixels, each).mean(axis=1) / len(scenes_of)
            images.append(image.reshape(_HEIGHT_PX, _WIDTH_PX))
        return np.stack(images, axis=-1)

    return raced(picture, pixels * each * sum(map(len, channels)), seeds)


@kernel
def spread_over_pixels(points, key, spread):
    """So many points of each of some unit squares (pixels, count, 2), written, as evenly as rays of images start."""
    for i in range(spread.shape[0]):
        for k in range(spread.shape[1]):
            spread[i, k, 0], spread[i, k, 1] = draw(points, key[i], k, 0)


def their_race(view: LitView, samples: int, seeds: int) -> Race:
    """Mitsuba's vectorised path tracer, with its own rule for ends of paths."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(1)
    sensor = {
        "type": "perspective",
        "fov": float(np.degrees(2 * np.arctan(_HALF_WIDTH))),
        "near_clip": 1.0,
        "far_clip": 1e6,
        "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 0], target=[0, 0, 1], up=[0, -1, 0]),
        "film": {"type": "hdrfilm", "width": _WIDTH_PX, "height": _HEIGHT_PX, "rfilter": {"type": "box"}},
        "sampler": {"type": "multijitter", "sample_count": samples},
    }
    path = {"type": "path", "max_depth": view.lighting.bounces + 2}
    scene = mi.load_dict({"type": "scene", "integrator": path, "sensor": sensor, **their_scene(mi, view)})
    paths = _WIDTH_PX * _HEIGHT_PX * samples
    return raced(lambda seed: np.array(mi.render(scene, spp=samples, seed=seed))[..., :3], paths, seeds)


def their_scene(mi: Any, view: LitView) -> dict[str, Any]:
    """The view for Mitsuba."""
    shapes: dict[str, Any] = {}
    for number, ((occluder, pose), plain) in enumerate(zip(view.occluders, view.lighting.finishes, strict=True)):
        finish = from_plain(Finish, plain)
        corners = apply(pose, occluder.corners_mm().reshape(-1, 3)).reshape(-1, 3, 3)
        turned = np.array(finish.normals).reshape(-1, 3) @ pose[:3, :3].T if finish.normals is not None else None
        st = np.array(finish.primvars["st"]).reshape(-1, 2) if "st" in finish.primvars else None
        bsdf = their_material(mi, view, finish.materials[0])
        shapes[f"thing{number}"] = their_mesh(mi, corners.reshape(-1, 3), turned, st, bsdf)
    for number, (target, pose) in enumerate(view.targets):
        for patch in target.patches():
            points = patch.mesh().reshape(-1, 3)
            half = np.array([patch.drawing.half_x_mm, patch.drawing.half_y_mm])
            st = (0.5 + points[:, :2] / (2 * half)) * (1, -1) + (0, 1)
            artwork = np.repeat(preview_picture(target, 1024)[..., None], 3, axis=2).astype(np.float32)
            texture = {"type": "bitmap", "bitmap": mi.Bitmap(artwork), "raw": True, "filter_type": "nearest"}
            bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture}}
            shapes[f"board{number}"] = their_mesh(mi, apply(pose @ patch.target_from_patch, points), None, st, bsdf)
    for number, placed in enumerate(view.lighting.lamps):
        shapes[f"lamp{number}"] = their_lamp(mi, from_plain(Lamp, placed.lamp), np.array(placed.vision_from_lamp))
    return shapes


def their_mesh(mi: Any, points: np.ndarray, normals: Any, st: Any, bsdf: dict[str, Any]) -> Any:
    """Triangles, three points each."""
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    mesh = mi.Mesh("mesh", len(points), len(points) // 3, properties, normals is not None, st is not None)
    values = mi.traverse(mesh)
    values["vertex_positions"] = points.astype(np.float32).ravel()
    values["faces"] = np.arange(len(points), dtype=np.uint32)
    if normals is not None:
        values["vertex_normals"] = normals.astype(np.float32).ravel()
    if st is not None:
        values["vertex_texcoords"] = st.astype(np.float32).ravel()
    values.update()
    return mesh


def their_material(mi: Any, view: LitView, material: Material) -> dict[str, Any]:
    """The nearest of Mitsuba's materials."""
    texture = material.diffuse_color.texture
    colour: dict[str, Any] = {"type": "rgb", "value": list(material.diffuse_color.value)}
    if texture:
        picture = np.flipud(np.array(view.pictures[texture.name], np.float32)[..., :3])
        colour = {"type": "bitmap", "bitmap": mi.Bitmap(np.ascontiguousarray(picture)), "raw": True}
    if material.ior == 1.0:
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colour}}
    of_layer = {"metallic": material.metallic.value[0], "roughness": material.roughness.value[0], "eta": material.ior}
    return {"type": "twosided", "bsdf": {"type": "principled", "base_color": colour, **of_layer}}


def their_lamp(mi: Any, lamp: Lamp, pose: np.ndarray) -> dict[str, Any]:
    """A rect, a sphere or an even sky."""
    light = {"type": "rgb", "value": list(lamp.radiance)}
    if lamp.kind == "dome":
        return {"type": "constant", "radiance": light}
    turned = mi.ScalarTransform4f(pose @ np.diag([1.0, -1.0, -1.0, 1.0]))
    shape = {
        "rect": {"type": "rectangle", "to_world": turned @ mi.ScalarTransform4f().scale([*lamp.size, 1])},
        "sphere": {"type": "sphere", "center": pose[:3, 3].tolist(), "radius": lamp.size[0]},
    }[lamp.kind]
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    return {**shape, "emitter": {"type": "area", "radiance": light}, "bsdf": black}


def example_05() -> tuple[LitView, list[list[int]]]:
    """The first frame of example 05 before its first camera, and the numbers of the lights of each channel."""
    dataset = pipeline.open_dataset(STAGE)
    entries, things = dataset.cameras[0].in_channels, LitThings(dataset, painted=True)
    entry, frame = entries[0], dataset.frames[0]
    slices = [entry.channel.slices for entry in entries if entry.channel]
    lights = tuple(light for of_channel in slices for light in of_channel)
    lit = lit_view(replace(things.view(frame, entry, ()), lights=lights), {})
    ends = np.cumsum([0, *map(len, slices)]).tolist()
    pictures = {
        entry.name: decoded(base64.b64decode(entry.encoded), entry.suffix, entry.space) for entry in dataset.pictures
    }
    numbers = [list(range(start, end)) for start, end in pairwise(ends)]
    return LitView(lit.targets, lit.occluders, lit.lighting, pictures, lit.background, lit.lights), numbers


def matt_room() -> LitView:
    """Three plates below a window and a small bulb."""
    lamps = [
        lamp("rect", (60.0, 40.0), towards((0.2, -0.8, -0.6), (-80.0, -90.0, 250.0)), 4.0),
        lamp("sphere", (15.0, 0.0), towards((0.0, 0.0, -1.0), (90.0, -40.0, 330.0)), 10.0),
    ]
    return room([], lamps, bounces=2)


def room_with_gloss() -> LitView:
    """The same with a metal and a plastic, below a window and an even sky."""
    metal = Material(diffuse_color=grey(0.8), metallic=Input(value=(1.0,)), roughness=Input(value=(0.2,)))
    plastic = Material(diffuse_color=grey(0.4), roughness=Input(value=(0.3,)))
    lamps = [
        lamp("rect", (60.0, 40.0), towards((0.2, -0.8, -0.6), (-80.0, -90.0, 250.0)), 3.0),
        lamp("dome", (0.0, 0.0), np.eye(4), 0.3),
    ]
    things = [
        (plate((-70.0, 60.0, 330.0), (0.5, -0.4, -0.8), 70.0), metal),
        (plate((70.0, -40.0, 400.0), (-0.5, 0.3, -0.8), 50.0), plastic),
    ]
    return room(things, lamps, bounces=3)


def room(things: list[tuple[Occluder, Material]], lamps: list[PlacedLamp], bounces: int) -> LitView:
    """A wall, a floor, a leaning plate, all matt, and other things."""
    facing = (0.0, 0.0, -1.0)
    things = [
        (plate((0.0, 0.0, 500.0), facing, 500.0), matt(0.7)),
        (plate((0.0, 120.0, 300.0), (0.0, -1.0, 0.0), 400.0), matt(0.5)),
        (plate((60.0, 20.0, 380.0), (-0.6, 0.2, -0.8), 60.0), matt(0.3)),
        *things,
    ]
    finishes = tuple(to_plain(Finish(materials=(material,))) for _, material in things)
    lighting = Lighting(lamps=tuple(lamps), finishes=finishes, bounces=bounces)
    return LitView([], [(thing, np.eye(4)) for thing, _ in things], lighting, {}, 0.0, (alone(_GREEN_NM),))


def towards(z: tuple[float, float, float], centre_mm: tuple[float, float, float]) -> np.ndarray:
    """A pose whose z axis has a direction."""
    axis = np.array(z) / np.linalg.norm(z)
    side = np.cross(axis, (0.3, -0.5, 0.8))
    side /= np.linalg.norm(side)
    pose = np.eye(4)
    pose[:3] = np.stack([side, np.cross(axis, side), axis, centre_mm], axis=1)
    return pose


def plate(centre_mm: tuple[float, float, float], z: tuple[float, float, float], half_mm: float) -> Occluder:
    """A square."""
    square = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * half_mm
    points = apply(towards(z, centre_mm), square)
    return Occluder(vertices_mm=tuple(map(tuple, points.tolist())), triangles=((0, 1, 2), (0, 2, 3)))


def lamp(kind: str, size: tuple[float, float], pose: np.ndarray, radiance: float) -> PlacedLamp:
    """A neutral lamp."""
    return PlacedLamp(
        lamp=to_plain(Lamp(kind=kind, radiance=(radiance,) * 3, size=size)), vision_from_lamp=pose.tolist()
    )


def grey(value: float) -> Input:
    """A neutral colour."""
    return Input(value=(value,) * 3)


def matt(reflectance: float) -> Material:
    """A material without a specular layer."""
    return Material(diffuse_color=grey(reflectance), ior=1.0)


if __name__ == "__main__":
    main()
