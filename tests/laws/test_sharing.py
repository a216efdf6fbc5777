"""Sharing: images of several scenes are, to the bit, what each is alone; tasks of one camera make it ready once."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.camera.camera import Camera
from pipeline.camera.micro_images import micro_images
from pipeline.camera.tracer import Tracer
from pipeline.files.jsonfile import write_json
from pipeline.records import to_plain
from pipeline.render import imaging
from pipeline.render.imaging import irradiance, irradiances
from pipeline.tasks.cameras import FOCUSED, tracer_alone, tracer_of

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


def test_tasks_of_a_camera_share_what_makes_it_ready_and_no_other_camera_or_seed_does(plenoptic, tmp_path) -> None:
    other = replace(plenoptic, sensor_distance_mm=np.nextafter(plenoptic.sensor_distance_mm, np.inf))
    ready = {}
    for name, camera, seed in (("one", plenoptic, 3), ("two", plenoptic, 3), ("seed", plenoptic, 4), ("mm", other, 3)):
        (tmp_path / name).mkdir()
        write_json(tmp_path / name / FOCUSED, to_plain(camera))
        inputs = {"camera": {FOCUSED: tmp_path / name / FOCUSED}}
        ready[name] = (tracer_alone(inputs, seed), *tracer_of(inputs, seed))
        assert (ready[name][0].camera, ready[name][0].seed) == (camera, seed)
    assert all(one is two for one, two in zip(ready["one"], ready["two"], strict=True))
    assert ready["one"][0] is ready["one"][1]
    assert not {*map(id, ready["one"])} & {*map(id, ready["seed"]), *map(id, ready["mm"])}
