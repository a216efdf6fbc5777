"""Sharing: images of several scenes are, to the bit, what each is alone; tasks of one camera make it ready once."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.files.jsonfile import write_json
from pipeline.frames import rigid
from pipeline.records.plain import to_plain
from pipeline.render import pixel_rays
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import irradiance_and_crosstalk, pictures
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.patterns.circles import CircleGrid
from pipeline.targets.surfaces import Cylinder
from pipeline.targets.target import Target
from pipeline.tasks.artefacts.cameras import FOCUSED, rig_of, tracer_alone

SQUARES = Checkerboard(columns=6, rows=3, square_mm=3.0)
POSE = rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.3, -0.2, 430.0]))
BEHIND = rigid(np.diag([1.0, -1.0, -1.0]), np.array([9.0, 2.0, 470.0]))
SCENES = [
    TargetLight([(Target(SQUARES), POSE)], 0.25),
    TargetLight([(Target(CircleGrid(columns=5, rows=4, spacing_mm=4.0, diameter_mm=2.0)), POSE)], 0.1),
    TargetLight([(Target(SQUARES), POSE), (Target(SQUARES), BEHIND)], 0.1),
    TargetLight([(Target(SQUARES, Cylinder(radius_mm=30.0)), POSE)], 0.5),
    TargetLight([], 0.7),
]
ROWS = (20, 29)


@pytest.mark.parametrize("kind", ["conventional", "plenoptic"])
def test_scenes_in_company_are_scenes_alone(kind: str, request: pytest.FixtureRequest, monkeypatch) -> None:
    camera: Camera = request.getfixturevalue(kind)
    tracer = Tracer(camera, seed=3)
    rig = Rig.of(tracer)
    white, foreign = irradiance_and_crosstalk(rig, 16, None, ROWS)
    parts = np.array([white - foreign, foreign])
    together = pictures(rig, 16, SCENES, parts, ROWS)
    assert np.ptp(together[:4], axis=(1, 2)).min() > 0
    for scene, image in zip(SCENES, together, strict=True):
        assert np.array_equal(image, pictures(rig, 16, [scene], parts, ROWS)[0])
    monkeypatch.setattr(pixel_rays, "_RAYS_PER_CHUNK", 500)
    assert np.array_equal(together, pictures(rig, 16, SCENES, parts, ROWS))
    first = [pictures(rig, 16, SCENES, parts[:, a - 20 : b - 20], (a, b)) for a, b in ((20, 23), (23, 29))]
    assert np.array_equal(together, np.concatenate(first, axis=1))


def test_tasks_of_a_camera_share_what_makes_it_ready_and_no_other_camera_or_seed_does(plenoptic, tmp_path) -> None:
    other = replace(plenoptic, sensor_distance_mm=np.nextafter(plenoptic.sensor_distance_mm, np.inf))
    ready = {}
    for name, camera, seed in (("one", plenoptic, 3), ("two", plenoptic, 3), ("seed", plenoptic, 4), ("mm", other, 3)):
        (tmp_path / name).mkdir()
        write_json(tmp_path / name / FOCUSED, to_plain(camera))
        inputs = {"camera": {FOCUSED: tmp_path / name / FOCUSED}}
        ready[name] = (tracer_alone(inputs, seed), rig_of(inputs, seed).tracer, rig_of(inputs, seed).images)
        assert (ready[name][0].camera, ready[name][0].seed) == (camera, seed)
    assert all(one is two for one, two in zip(ready["one"], ready["two"], strict=True))
    assert ready["one"][0] is ready["one"][1]
    assert not {*map(id, ready["one"])} & {*map(id, ready["seed"]), *map(id, ready["mm"])}
