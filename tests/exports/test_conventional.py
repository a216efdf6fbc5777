"""Two pinholes before a board, through the formats for conventional cameras and programs that read them: the half-pixel
law. `test_programs` and `test_mrcal` have those whose programs not everybody has.
"""

import numpy as np
import pytest
from exports.flipping import flips, require_notice
from exports.pretended import CORNER_PX, Scene, write_build
from exports.readers import CHECKS

from pipeline.exports.export import export
from pipeline.results.output import open_output


@pytest.fixture(scope="module")
def scene():
    return Scene()


@pytest.fixture(scope="module")
def output(tmp_path_factory, scene):
    return open_output(write_build(tmp_path_factory.mktemp("pretended") / "out", scene))


def test_point_0_is_seen_in_the_middle_of_a_pixel(scene):
    np.testing.assert_allclose(scene.pixels("Left", 1)[0], CORNER_PX, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", CHECKS)
def test_its_reader_gets_back_every_number(output, scene, name, tmp_path):
    (folder,) = export(output, [name], tmp_path)
    CHECKS[name](folder, scene)


UNSEEN = (("*", "centre"), ("*", "microlenses"))
"""All centres of these cameras are one, and they have no microlenses."""


@pytest.mark.parametrize(("name", "field", "other"), list(flips(CHECKS, UNSEEN)))
def test_a_flip_of_a_convention_is_noticed(output, scene, name, field, other, tmp_path, monkeypatch):
    require_notice(lambda folder: CHECKS[name](folder, scene), output, name, {field: other}, tmp_path, monkeypatch)
