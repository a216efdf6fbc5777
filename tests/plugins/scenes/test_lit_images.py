"""A golden image of a lit scene: `pytest --update-golden tests/plugins/scenes/test_lit_images.py` writes it."""

from pathlib import Path

import pytest
from golden.conftest import golden  # noqa: F401  # a fixture
from golden.renders import Scene
from golden.test_images import notices_a_tenth_of_a_pixel, same_or_written
from plugins.scenes.lit import lamp, towards

from pipeline.camera.parts.spectrum import alone
from pipeline.plugins.scenes.lighting.lit_scene import LitView
from pipeline.plugins.scenes.lighting.records import Coat, Lighting
from pipeline.render.glow import Placed
from pipeline.scene.dataset import Dataset

FILE = Path(__file__).parent / "tiny_lit.exr"


class Lit(Scene):
    """The scene of the tiny conventional dataset below a bulb and a sky."""

    def light_of(self, dataset: Dataset, targets: Placed) -> LitView:
        lamps = (lamp("sphere", (20.0, 0.0), towards((0, 0, -1), (40, 60, 300)), (3.0,) * 3), lamp("dome"))
        lighting = Lighting(lamps=lamps, coats=(Coat(roughness=0.2),), bounces=1)
        return LitView(targets, [], lighting, {}, dataset.background, (alone(dataset.cameras[0].wavelength_nm),))


def test_an_image_with_other_seeds_is_the_golden_one_within_its_noise(golden):  # noqa: F811
    same_or_written(Lit("tiny_conventional"), FILE, golden)


@pytest.mark.heavy
def test_a_tenth_of_a_pixel_is_noticed():
    notices_a_tenth_of_a_pixel(Lit("tiny_conventional", shift_px=0.1), FILE)
