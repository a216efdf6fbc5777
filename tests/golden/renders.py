"""Images of tiny scenes with any seed, for golden images."""

import dataclasses

import numpy as np
from places import DATA

from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.render.glow import Placed, TargetLight
from pipeline.render.imaging import SceneView, known_white_parts, pictures_in_lights, white_parts
from pipeline.scene.dataset import Dataset
from pipeline.scene.load import load


class Scene:
    """Frame 2 of a tiny dataset as a build renders it.

    Parameters
    ----------
    shift_px : float
        A mistake: so far the image moves to the right.
    """

    def __init__(self, name: str, shift_px: float = 0.0) -> None:
        dataset = load(DATA / name / "dataset.usda").dataset
        entry, frame = dataset.cameras[0], dataset.frames[1]
        targets = [(one.target, frame.vision_from_target(entry.name, one.name)) for one in dataset.targets]
        sensor = entry.camera.sensor
        moved = dataclasses.replace(sensor, offset_x_mm=sensor.offset_x_mm + shift_px * sensor.pitch_mm)
        camera = dataclasses.replace(entry.camera, sensor=moved)
        self.samples, self.rig = entry.image_samples, Rig.of(Tracer(camera, entry.sampling.seed))
        self.light = self.light_of(dataset, targets)

    def image(self, seed: int) -> np.ndarray:
        """The image with a seed."""
        rig = dataclasses.replace(self.rig, tracer=dataclasses.replace(self.rig.tracer, seed=seed))
        known = known_white_parts(rig)
        white = white_parts(rig, self.samples) if known is None else known
        return pictures_in_lights(rig, self.samples, [self.light], white)[0]

    def light_of(self, dataset: Dataset, targets: Placed) -> SceneView:
        """What the camera sees."""
        return TargetLight(targets, dataset.background)
