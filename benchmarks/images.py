"""Time and error of images: now, and by the project as it was before images were reworked.

    python benchmarks/images.py [--small] [--before COMMIT] [--json FILE]

Both programs render the same rows of the same frames in turns, in processes of their own, on one thread; of time it is
the processor time of user and system that counts, kernels compiled before. The error is that against the image of many
samples. A commit is unpacked beside, from the repository that this file belongs to.
"""

import argparse
import importlib
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
BEFORE = "54ef84b"
_JUDGED_ROWS = 8
_TURNS = 9
"""Repetitions of what takes a fraction of a second; the first loads kernels and Embree."""
_CORNER = ((1.0, -4.0, 395.0), (9.0, -4.0, 395.0), (1.0, 4.0, 395.0))
_ACROSS = ((-90.0, -90.0, 390.0), (90.0, 90.0, 395.0), (90.0, 90.1, 395.0))
"""Triangles, vision frame [mm]: one hides a corner of the view; rays may meet the box about the other, which hides next
to nothing, wherever they go."""
_REFERENCE = 2048
"""Samples of the image that errors are against."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="tiny stages: does it run at all?")
    parser.add_argument("--before", default="", metavar="COMMIT", help=f"commit to compare with, such as {BEFORE}")
    parser.add_argument("--rows", type=int, default=0, help="so many rows about the middle of the image; 0: all")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        serve(json.loads(options.child))
        return
    names = ("tiny_conventional", "tiny_plenoptic") if options.small else ("01_conventional", "02_plenoptic")
    folder = "tests/data" if options.small else "examples"
    figures = {}
    with tempfile.TemporaryDirectory() as place:
        before = unpacked(options.before, Path(place)) if options.before else None
        for name in names:
            figures[name] = compared(f"{folder}/{name}/dataset.usda", before, Path(place), options)
            show(name, figures[name])
            sys.stdout.flush()
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def unpacked(commit: str, place: Path) -> Path:
    """The files of a commit, in a folder of their own."""
    folder = place / "before"
    folder.mkdir()
    archive = subprocess.run(["git", "-C", str(ROOT), "archive", commit], stdout=subprocess.PIPE, check=True)
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive.stdout, check=True)
    return folder


def compared(stage: str, before: Path | None, place: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Figures of a dataset, by program; each reads the stage of its own tree."""
    ask = {"stage": stage, "place": str(place), "small": options.small, "rows": options.rows}
    result = {"now": asked(ROOT, {**ask, "as": "now"})}
    if before is not None:
        result["before"] = asked(before, {**ask, "as": "before"})
        both = result["now"], result["before"]
        result["ratios"] = {
            key: both[1][key] / both[0][key] for key in ("frame_seconds", "frames_seconds", "white_seconds")
        }
    return result


def asked(root: Path, ask: dict[str, Any]) -> dict[str, Any]:
    """What the program in a folder answers."""
    command = [sys.executable, __file__, "--child", json.dumps({**ask, "root": str(root)})]
    done = subprocess.run(command, cwd=ask["place"], stdout=subprocess.PIPE, check=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])  # type: ignore[no-any-return]


def serve(ask: dict[str, Any]) -> None:
    """Answer as the program of a folder: print the figures as JSON."""
    sys.path.insert(0, ask["root"])
    import pipeline

    assert Path(pipeline.__file__).is_relative_to(ask["root"])
    from pipeline.camera.tracer import Tracer

    kind = Now if ask["as"] == "now" else Before
    dataset = pipeline.open_dataset(Path(ask["root"]) / ask["stage"])
    entry = dataset.cameras[0]
    tracer = Tracer(kind.taken("focused")(entry.camera), entry.sampling.seed)
    images = kind.taken("micro_images")(tracer) if tracer.camera.microlenses else None
    height = tracer.camera.sensor.height_px
    scenes = scenes_of(kind, dataset, entry)
    program = kind(tracer, images, entry.image_samples)
    print(json.dumps(program.figures(scenes, height, ask)))


def scenes_of(kind: "type[Program]", dataset: Any, entry: Any) -> list[Any]:
    """The light of every frame."""
    TargetLight = kind.taken("TargetLight")
    poses = [kind.taken("target_poses")(dataset, frame, entry.name) for frame in dataset.frames]
    placed = [[(target.target, pose[target.name]) for target in dataset.targets] for pose in poses]
    return [Scene(targets, dataset.background, TargetLight(targets, dataset.background)) for targets in placed]


class Scene(NamedTuple):
    """A frame: targets with their poses, the radiance beside them, and the program's own light of both."""

    targets: Any
    background: float
    light: Any


class Program:
    """Images of one camera, and what they cost.

    Attributes
    ----------
    places : mapping of str
        Modules of the program's functions and classes that have moved.
    """

    places: ClassVar[dict[str, str]] = {}

    @classmethod
    def taken(cls, name: str) -> Any:
        """A function or class of the program, from the module where it is."""
        return getattr(importlib.import_module(cls.places[name]), name)

    def __init__(self, tracer: Any, images: Any, samples: int) -> None:
        self.tracer, self.images, self.samples = tracer, images, samples

    def white(self, rows: tuple[int, int]) -> Any:
        """What images need of the white image."""
        raise NotImplementedError

    def pictures(self, scenes: list[Any], rows: tuple[int, int], white: Any) -> np.ndarray:
        """Images of some scenes."""
        raise NotImplementedError

    def figures(self, scenes: list[Any], height: int, ask: dict[str, Any]) -> dict[str, Any]:
        """Seconds of processor, rays, and error of some rows."""
        half = min(ask["rows"] or height, height) // 2
        rows = height // 2 - half, height // 2 + half
        judged = height // 2 - _JUDGED_ROWS // 2, height // 2 + _JUDGED_ROWS // 2
        self.pictures(scenes[:1], judged, self.white(judged))  # kernels
        white, white_s = timed(lambda: self.white(rows))
        alone = [timed(lambda scene=scene: self.pictures([scene], rows, white)) for scene in scenes]
        errors = self.errors(scenes, judged, ask)
        return {
            "rows": list(rows),
            "samples": self.samples,
            "frames": len(scenes),
            "white_seconds": white_s,
            "frame_seconds": sum(seconds for _, seconds in alone) / len(scenes),
            "frames_seconds": sum(seconds for _, seconds in alone),
            "rms_error": float(np.sqrt(np.mean(errors**2))),
            **self.more(scenes, rows, white, [image[0] for image, _ in alone]),
        }

    def more(self, scenes: list[Any], rows: tuple[int, int], white: Any, alone: list[np.ndarray]) -> dict[str, float]:
        """Figures of this program alone."""
        return {}

    def errors(self, scenes: list[Any], rows: tuple[int, int], ask: dict[str, Any]) -> np.ndarray:
        """Deviations from images of many samples, which the first program leaves for the others."""
        file = Path(ask["place"]) / f"{Path(ask['stage']).parent.name}.npy"
        if not file.exists():
            np.save(file, self.reference(scenes, rows, 64 if ask["small"] else _REFERENCE))
        reference: np.ndarray = np.load(file)
        return self.pictures(scenes, rows, self.white(rows)) - reference

    def reference(self, scenes: list[Any], rows: tuple[int, int], samples: int) -> np.ndarray:
        """Images of all rays, with another seed."""
        raise NotImplementedError


class Now(Program):
    """The program that this file belongs to."""

    places: ClassVar = {
        "focused": "pipeline.camera.focusing.depth_of_field",
        "micro_images": "pipeline.camera.micro_images.centres",
        "target_poses": "pipeline.products.things",
        "TargetLight": "pipeline.render.glow",
    }

    def white(self, rows: tuple[int, int]) -> Any:
        from pipeline.camera.rig import Rig
        from pipeline.render.imaging import irradiance_and_crosstalk

        white, foreign = irradiance_and_crosstalk(Rig(self.tracer, self.images), self.samples, None, rows)
        return np.array([white - foreign, foreign])

    def pictures(self, scenes: list[Any], rows: tuple[int, int], white: Any) -> np.ndarray:
        from pipeline.camera.rig import Rig
        from pipeline.render.imaging import pictures

        return pictures(Rig(self.tracer, self.images), self.samples, [scene.light for scene in scenes], white, rows)

    def more(self, scenes: list[Any], rows: tuple[int, int], white: Any, alone: list[np.ndarray]) -> dict[str, float]:
        """Frames in company, to the bit what they are alone; rays of each; all rays of a frame, Embree asked or not."""
        together, seconds = timed(lambda: self.pictures(scenes, rows, white))
        assert np.array_equal(together, alone)
        middle = sum(rows) // 2 - _JUDGED_ROWS, sum(rows) // 2 + _JUDGED_ROWS
        flat, some, hidden = scenes[0], self.behind_card(scenes[0], _CORNER), self.behind_card(scenes[0], _ACROSS)
        flat_s, some_s, embree_s = (
            timed(lambda scene=scene: self.all_rays(scene, middle), _TURNS)[1] for scene in (flat, some, hidden)
        )
        whole = started(lambda: self.white(rows))
        return {
            "frames_seconds": seconds,
            "rays_of_white": whole,
            "rays_of_frame": sum(started(lambda s=scene: self.pictures([s], rows, white)) for scene in scenes)
            / len(scenes),
            "rays_of_frames": started(lambda: self.pictures(scenes, rows, white)),
            "all_rays_per_second": started(lambda: self.white(middle)) / flat_s,
            "all_rays_per_second_with_card": started(lambda: self.white(middle)) / some_s,
            "all_rays_per_second_by_embree": started(lambda: self.white(middle)) / embree_s,
        }

    def all_rays(self, scene: Any, rows: tuple[int, int]) -> np.ndarray:
        """An image without any shortcut."""
        from pipeline.camera.rig import Rig
        from pipeline.render.imaging import irradiance

        return irradiance(Rig(self.tracer, self.images), self.samples, scene.light.radiance, rows)

    def behind_card(self, scene: Any, corners: Any) -> Any:
        """The same scene with a triangle before it."""
        from pipeline.render.glow import TargetLight
        from pipeline.targets.mesh import Occluder

        light = TargetLight(
            scene.targets, scene.background, [(Occluder(vertices_mm=corners, triangles=((0, 1, 2),)), np.eye(4))]
        )
        return scene._replace(light=light)

    def reference(self, scenes: list[Any], rows: tuple[int, int], samples: int) -> np.ndarray:
        import dataclasses

        from pipeline.camera.rig import Rig
        from pipeline.render.imaging import irradiance

        tracer = dataclasses.replace(self.tracer, seed=self.tracer.seed + 77)
        return np.array([irradiance(Rig(tracer, self.images), samples, scene.light.radiance, rows) for scene in scenes])


class Before(Program):
    """The program without images of rows or of several scenes: the sensor is cut to the rows."""

    places: ClassVar = {
        "focused": "pipeline.camera.focus",
        "micro_images": "pipeline.camera.micro_images",
        "target_poses": "pipeline.tasks.poses",
        "TargetLight": "pipeline.render.light",
    }

    def white(self, rows: tuple[int, int]) -> Any:
        return self._irradiance(None, rows)

    def pictures(self, scenes: list[Any], rows: tuple[int, int], white: Any) -> np.ndarray:
        return np.array([self._irradiance(scene.light.radiance, rows) for scene in scenes])

    def _irradiance(self, radiance: Any, rows: tuple[int, int]) -> np.ndarray:
        import dataclasses

        from pipeline.camera.tracer import Tracer
        from pipeline.render.imaging import irradiance

        camera, sensor = self.tracer.camera, self.tracer.camera.sensor
        middle = (rows[0] + rows[1] - sensor.height_px) / 2 * sensor.pitch_mm
        cut = dataclasses.replace(sensor, height_px=rows[1] - rows[0], offset_y_mm=sensor.offset_y_mm - middle)
        tracer = Tracer(dataclasses.replace(camera, sensor=cut), self.tracer.seed)
        return irradiance(tracer, self.images, self.samples, radiance)


def started(make: Any) -> int:
    """Rays that are started meanwhile."""
    from pipeline.jit.work import work

    before = work().kernels["image_rays"].rays
    make()
    return int(work().kernels["image_rays"].rays - before)


def timed(make: Any, turns: int = 1) -> tuple[Any, float]:
    """What is made, and the least processor time of some turns [s]."""
    least = np.inf
    for _ in range(turns):
        start = time.process_time()
        made = make()
        least = min(least, time.process_time() - start)
    return made, least


def show(name: str, figures: dict[str, Any]) -> None:
    """Print the figures of a dataset."""
    now = figures["now"]
    first, end = now["rows"]
    print(
        f"{name}: rows {first} to {end}, {now['samples']} samples, {now['rays_of_white']:.3g} rays without a shortcut"
    )
    for program in ("before", "now"):
        if program in figures:
            one = figures[program]
            print(
                f"  {program:6s}  white {one['white_seconds']:.2f} s, a frame {one['frame_seconds']:.3f} s, all frames "
                f"{one['frames_seconds']:.3f} s, rms error {one['rms_error']:.5f}"
            )
    print(
        f"  now: a frame starts {now['rays_of_frame']:.3g} rays, {now['rays_of_frame'] / now['frame_seconds']:.3g} per "
        f"second; it stands for {now['rays_of_white'] / now['frame_seconds']:.3g} per second, "
        f"in company for {now['rays_of_white'] * now['frames'] / now['frames_seconds']:.3g}"
    )
    card, embree = (
        now[f"all_rays_per_second_{what}"] / now["all_rays_per_second"] for what in ("with_card", "by_embree")
    )
    print(
        f"  now, every ray shaded: {now['all_rays_per_second']:.3g} per second; with a card before a corner "
        f"{card:.0%} of that, all asked of Embree {embree:.0%}"
    )
    for what, ratio in figures.get("ratios", {}).items():
        print(f"  before / now, {what.replace('_', ' ')}: {ratio:.1f}")


if __name__ == "__main__":
    main()
