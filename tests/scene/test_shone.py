"""Which lamps shine on which side of a board: the check against rendered light."""

import numpy as np
import pytest
from laws.lit import lamp, looked, scene, towards

from pipeline.records.plain import from_plain
from pipeline.render.lighting.records import Lamp
from pipeline.scene.lamps import _shines
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

BOARD = Target(Checkerboard(columns=4, rows=3, square_mm=10.0, white=1.0, black=1.0))
SPOT = (5.0, 5.0, 500.0)
SIZES = {
    "rect": (20.0, 10.0),
    "disk": (15.0, 0.0),
    "sphere": (12.0, 0.0),
    "cylinder": (20.0, 5.0),
    "distant": (0.1, 0.0),
}


@pytest.mark.parametrize("kind", SIZES)
@pytest.mark.parametrize("z", [(0.0, 0.1, -1.0), (0.1, 0.0, 1.0)])
@pytest.mark.parametrize("centre", [(30.0, 0.0, 200.0), (30.0, 0.0, 800.0)])
def test_what_the_check_says_is_what_an_image_shows(kind: str, z: tuple, centre: tuple) -> None:
    pose = np.diag([1.0, -1.0, -1.0, 1.0])  # the front of the board faces the eye at the origin
    pose[2, 3] = SPOT[2]
    placed = lamp(kind, SIZES[kind], towards(z, centre))
    lit = scene([], [placed], targets=[(BOARD, pose, None)])
    found = looked(lit, SPOT, (100.0, 0.0, 0.0), 256)[0] > 0
    places, fronts = np.array([SPOT]), pose[None, :3, 2]
    said = _shines(from_plain(Lamp, placed.lamp), np.array(placed.vision_from_lamp), places, fronts)
    assert said == found
