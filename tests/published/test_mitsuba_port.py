"""Claim: Mitsuba's dielectric slabs show the picture of a board through a flat port, and through a tilted pane.

Both pictures are divided by those of a white board, so that neither Fresnel's losses, which Mitsuba has and a relative
image has not, nor the falloff of a sensor, which Mitsuba has not, count.
"""

import numpy as np
import pytest
from builds import made
from laws.test_windows import PORT_MM, WATER, stage, window

from pipeline.files.exr import read_exr
from pipeline.frames import VISION_FROM_CAMERA
from pipeline.optics.table import displacements
from pipeline.scene.load import open_dataset

mitsuba = pytest.importorskip("mitsuba", reason="the extra [referees] is not installed")
SAMPLES, BINNED, REGION = 256, 4, 10
"""Paths a pixel of Mitsuba's film, our pixels along one of its, and its pixels along a region."""


def rendered(board, vision_from_target, slabs, fov_deg: float, size: tuple[int, int]) -> np.ndarray:
    """Mean radiance of a board in a medium behind slabs, (h, w); `board` is its texture, the top row first."""
    from published.mitsuba_sensor import pinhole

    transform = mitsuba.ScalarTransform4f
    (half_x, half_y), texture = board
    pixels = mitsuba.Bitmap(np.repeat(texture[:, :, None], 3, axis=2).astype(np.float32))
    light = {"type": "bitmap", "bitmap": pixels, "raw": True, "filter_type": "nearest"}
    placed = transform(vision_from_target @ np.diag([half_x, half_y, 1.0, 1.0]))
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 12},
        "sensor": pinhole(SAMPLES, fov_deg, size, near_clip=1.0),
        "board": {"type": "rectangle", "to_world": placed, "emitter": {"type": "area", "radiance": light}},
    }
    for number, (vision_from_plane, before, behind) in enumerate(slabs):  # the normal of a rectangle points to `before`
        bsdf = {"type": "dielectric", "int_ior": behind, "ext_ior": before}
        to_world = transform(vision_from_plane @ np.diag([900.0, 900.0, 1.0, 1.0]))
        scene[f"slab{number}"] = {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}
    return np.array(mitsuba.render(mitsuba.load_dict(scene)))[:, :, 0]


@pytest.mark.heavy
@pytest.mark.parametrize("turn", ["", "(25, -20, 0)"])
def test_a_picture_through_a_slab_is_mitsubas(tmp_path, common_store, turn):
    file = stage(tmp_path, "port", window(-PORT_MM, turn=turn), dataset=WATER)
    result = made(file, tmp_path / "out", common_store)
    dataset = open_dataset(file)
    camera, target = dataset.cameras[0].camera, dataset.targets[0].target
    ours, white = (
        luminance(result.out / place) for place in ("frames/0001/Rig.Camera/image.exr", "cameras/Rig.Camera/white.exr")
    )
    size = camera.sensor.width_px // BINNED, camera.sensor.height_px // BINNED
    half = target.pattern.drawing.half_x_mm, target.pattern.drawing.half_y_mm
    count = 1600
    x, y = ((np.arange(count) + 0.5) / count * 2 - 1 for _ in range(2))
    points = np.stack(np.meshgrid(x * half[0], -y * half[1]), axis=-1).reshape(-1, 2)
    texture = target.pattern.radiance(*points.T).reshape(count, count)
    slabs = []
    for number, (before, behind) in enumerate(((1.34, 1.52), (1.52, 1.0))):
        vertex = np.eye(4)
        vertex[2, 3] = camera.prescription.vertices_from_stop_mm[number]
        moved = displacements(camera.prescription)[number]
        there = VISION_FROM_CAMERA @ (vertex if moved is None else moved @ vertex)
        slabs.append((there @ np.diag([1.0, 1.0, -1.0, 1.0]), before, behind))
    fov = 2 * np.degrees(np.arctan(camera.sensor.size_mm[0] / 2 / camera.sensor_distance_mm))
    pose = dataset.frames[0].vision_from_target("Rig.Camera", dataset.targets[0].name)
    theirs, bright = (rendered((half, picture), pose, slabs, fov, size) for picture in (texture, np.ones_like(texture)))
    seen = regions(bright > 0.4) == 1  # regions that the board fills
    mine = regions(binned(ours / white))[seen]
    others = (regions(theirs) / regions(np.maximum(bright, 1e-9)))[seen]
    assert seen.sum() > 20
    assert np.abs(mine - others).max() < 0.01
    assert np.ptp(others) > 0.5


def binned(image: np.ndarray, by: int = BINNED) -> np.ndarray:
    height, width = (n // by for n in image.shape)
    return image[: height * by, : width * by].reshape(height, by, width, by).mean(axis=(1, 3))


def regions(image: np.ndarray) -> np.ndarray:
    return binned(image.astype(float), REGION)


def luminance(path) -> np.ndarray:
    """The first part of a file with one channel, (h, w)."""
    part = next(iter(read_exr(path).values()))
    return next(iter(part.channels.values()))
