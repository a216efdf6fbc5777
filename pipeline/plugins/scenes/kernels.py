"""Kernels of this plug-in, compiled by a call with a tiny scene."""

import numpy as np

from pipeline.app.compile_kernels import Part
from pipeline.camera.parts.spectrum import alone
from pipeline.plugins.scenes.lighting.draws import Names
from pipeline.plugins.scenes.lighting.lit_scene import LitView
from pipeline.plugins.scenes.lighting.records import Finish, Glass, Input, Lamp, Lighting, Material, PlacedLamp
from pipeline.records.plain import to_plain
from pipeline.targets.mesh import Occluder


def _paths_of_light() -> None:
    """Trace rays to a card with a hole, a glass prism and a solid card under a sky."""
    corners = np.array([[-9.0, -9.0, 50.0], [9.0, -9.0, 50.0], [0.0, 9.0, 50.0], [0.0, 0.0, 60.0]])
    card = Occluder(vertices_mm=corners[:3], triangles=np.array([[0, 1, 2]]))
    prism = Occluder(vertices_mm=corners, triangles=np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))
    hole = Material(opacity_threshold=0.5, opacity=Input(value=(0.0,)))
    glass = Material(roughness=Input(value=(0.0,)), glass=Glass(wavelengths_nm=(550.0,), indices=(1.5,)))
    sky = PlacedLamp(
        lamp=to_plain(Lamp(kind="dome", radiance=(1.0, 1.0, 1.0), texture="sky")), vision_from_lamp=np.eye(4).tolist()
    )
    view = LitView(
        targets=[],
        occluders=[(card, np.eye(4)), (prism, np.diag([1.0, 1.0, 1.2, 1.0])), (card, np.diag([1.0, 1.0, 2.0, 1.0]))],
        lighting=Lighting(
            lamps=(sky,), finishes=tuple(to_plain(Finish(materials=(part,))) for part in (hole, glass, Material()))
        ),
        pictures={"sky": np.ones((2, 4, 4), np.float32)},
        background=0.0,
        lights=(alone(550.0) * 2,),
    )
    rays = np.tile([0.0, 0.0, 1.0], (4, 1))
    view.in_light(0).radiance(np.zeros((4, 3)), rays, Names(np.zeros(4, np.uint32), np.arange(4)))


PARTS = (Part("lighting", _paths_of_light),)
