"""Mitsuba's AOVs say the same of a room before a pinhole: distance, position, normal and shape of every pixel.

Means over a pixel differ by the noise of 256 independent rays, which is its spread over 16.
"""

from dataclasses import replace

import numpy as np
import pytest
from laws import rigs
from laws.test_model_cameras import model
from plugins.scenes.test_labels import Labelled, labelled

mitsuba = pytest.importorskip("mitsuba", reason="needs the extra `referees`")
SAMPLES = 256
SIGMAS = 5.0
"""Standard errors that the worst of some thousand means may be off [1]: five happen once in two million."""
NEAR_MM = 0.01
"""Vision z where Mitsuba's rays begin, from which it counts distances [mm]."""
FLAT = 2e-5
"""The same where nothing varies, over the length of the vector: single precision of Mitsuba's sums [1]."""
WEIGHED = 0.01
"""Part of the spread by which weights of rays move a mean [1]: ours fall by cos^4 over a pixel, Mitsuba's do not."""


@pytest.fixture(scope="module")
def pictures() -> tuple[Labelled, dict[str, np.ndarray]]:
    from plugins.scenes.test_mitsuba import room
    from published.mitsuba_sensor import FOV_DEG, HEIGHT_PX, WIDTH_PX, mi, pinhole

    both = room()
    camera = model(rigs.conventional(width_px=WIDTH_PX, height_px=HEIGHT_PX), "pinhole")
    edge_mm = 2 * camera.sensor_distance_mm * np.tan(np.radians(FOV_DEG) / 2)
    camera = replace(camera, sensor=replace(camera.sensor, pitch_mm=edge_mm / WIDTH_PX))
    ours = labelled(model(camera, "pinhole"), occluders=[(mesh, np.eye(4)) for mesh, _ in both.things], samples=SAMPLES)
    sensor = pinhole(SAMPLES, near_clip=NEAR_MM)
    aovs = {"type": "aov", "aovs": "d:depth,p:position,n:sh_normal,i:shape_index"}
    loaded = mi.load_dict({"type": "scene", "integrator": aovs, "sensor": sensor, **both.theirs})
    values = np.array(mi.render(loaded, spp=SAMPLES), float)[..., -8:]
    values[..., 0] += NEAR_MM * ours["range"] / ours["Z"]
    return ours, {"range": values[..., :1], "P": values[..., 1:4], "N": values[..., 4:7], "shape": values[..., 7]}


@pytest.mark.parametrize("name", ["range", "P", "N"])
def test_distance_position_and_normal(pictures, name):
    ours, theirs = pictures
    mean = np.stack([ours[name]] if name == "range" else [ours[f"{name}.{axis}"] for axis in "XYZ"], axis=-1)
    other = theirs[name] * np.sign(np.sum(mean * theirs[name], axis=-1, keepdims=True))  # normals of backs
    length = np.linalg.norm(mean, axis=-1)
    allowed = (SIGMAS / np.sqrt(SAMPLES) + WEIGHED) * ours[f"spread.{name}"] + FLAT * length
    assert (ours["A"] == 1).all()
    assert (np.linalg.norm(mean - other, axis=-1) <= allowed).all()


def test_shapes_and_their_shares(pictures):
    """The mean of Mitsuba's indices is that of ours, by shares."""
    ours, theirs = pictures
    ids, shares = ours["Crypto00.R"], ours["Crypto00.G"]
    index = {i: np.unique(theirs["shape"][(ids == i) & (shares == 1)]) for i in np.unique(ids)}
    assert len(index) == 3 and all(len(values) == 1 for values in index.values())
    index[np.float32(0)] = np.zeros(1)
    expected, square = np.zeros(ids.shape), np.zeros(ids.shape)
    for rank in range(3):
        for a, b in ("RG", "BA"):
            of_rank = np.vectorize(lambda i: index[i][0])(ours[f"Crypto{rank:02d}.{a}"])
            expected += of_rank * ours[f"Crypto{rank:02d}.{b}"]
            square += of_rank**2 * ours[f"Crypto{rank:02d}.{b}"]
    spread = np.sqrt(np.maximum(square - expected**2, 0))
    assert np.count_nonzero(spread > 0.1) > 20
    assert (np.abs(expected - theirs["shape"]) <= (SIGMAS / np.sqrt(SAMPLES) + WEIGHED) * spread + FLAT).all()
