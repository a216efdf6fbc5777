"""Images of several scenes that share rays: each is, to the bit, what it is alone, in whatever stretches it is made."""

import numpy as np
import pytest

from pipeline.camera.camera import Camera
from pipeline.camera.micro_images import micro_images
from pipeline.camera.tracer import Tracer
from pipeline.render import imaging
from pipeline.render.imaging import irradiance, irradiances

SCENES = [
    None,
    lambda origin, direction: direction[:, 0] + 2.0,
    lambda origin, direction: (origin[:, 1] > 0).astype(float),
]


@pytest.mark.parametrize("kind", ["conventional", "plenoptic"])
def test_scenes_in_company_are_scenes_alone(kind: str, request: pytest.FixtureRequest, monkeypatch) -> None:
    camera: Camera = request.getfixturevalue(kind)
    tracer = Tracer(camera, seed=3)
    images, rows = micro_images(tracer) if camera.microlenses else None, (20, 29)
    together = irradiances(tracer, images, 16, SCENES, rows)
    for scene, image in zip(SCENES, together, strict=True):
        assert image.max() > 0
        assert np.array_equal(image, irradiance(tracer, images, 16, scene, rows))
    monkeypatch.setattr(imaging, "_RAYS_PER_CHUNK", 5000)
    assert np.array_equal(together, irradiances(tracer, images, 16, SCENES, rows))
