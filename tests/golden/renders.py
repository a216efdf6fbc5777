"""Images of tiny scenes with any seed, for golden images: conventional, plenoptic, and lit."""

import dataclasses

import numpy as np
from laws.lit import lamp, towards
from places import DATA

from pipeline.camera.parts.spectrum import alone
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import known_white_parts, pictures_in_lights, white_parts
from pipeline.render.lighting.lit_scene import LitView
from pipeline.render.lighting.records import Coat, Lighting
from pipeline.scene.load import load

TINY = {"tiny_conventional": "tiny_conventional", "tiny_plenoptic": "tiny_plenoptic", "tiny_lit": "tiny_conventional"}
"""Stages of the golden images, by name."""


class Scene:
    """Frame 2 of a tiny dataset, with lamps or without, as a build renders it.

    Parameters
    ----------
    shift_px : float
        A mistake: so far the image moves to the right.
    """

    def __init__(self, name: str, shift_px: float = 0.0) -> None:
        dataset = load(DATA / TINY[name] / "dataset.usda").dataset
        entry, frame = dataset.cameras[0], dataset.frames[1]
        targets = [(one.target, frame.vision_from_target(entry.name, one.name)) for one in dataset.targets]
        sensor = entry.camera.sensor
        moved = dataclasses.replace(sensor, offset_x_mm=sensor.offset_x_mm + shift_px * sensor.pitch_mm)
        camera = dataclasses.replace(entry.camera, sensor=moved)
        self.samples, self.rig = entry.image_samples, Rig.of(Tracer(camera, entry.sampling.seed))
        self.light: TargetLight | LitView = TargetLight(targets, dataset.background)
        if name == "tiny_lit":
            lamps = (lamp("sphere", (20.0, 0.0), towards((0, 0, -1), (40, 60, 300)), (3.0,) * 3), lamp("dome"))
            lighting = Lighting(lamps=lamps, coats=(Coat(roughness=0.2),), bounces=1)
            self.light = LitView(targets, [], lighting, {}, dataset.background, (alone(entry.wavelength_nm),))

    def image(self, seed: int) -> np.ndarray:
        """The image with a seed."""
        rig = dataclasses.replace(self.rig, tracer=dataclasses.replace(self.rig.tracer, seed=seed))
        known = known_white_parts(rig)
        white = white_parts(rig, self.samples) if known is None else known
        return pictures_in_lights(rig, self.samples, [self.light], white)[0]
