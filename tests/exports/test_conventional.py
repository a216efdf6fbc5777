"""Two pinholes before a board, through every format for conventional cameras and its reader: the half-pixel law."""

import numpy as np
import pytest
from exports.flipping import require_notice
from exports.maps import CHECKS as MAPS
from exports.pretended import CORNER_PX, Scene, write_build
from exports.readers import CHECKS

from pipeline.export_formats import FORMATS, Cameras
from pipeline.exports.conventions import CONVENTIONS, Board, ImageAxes, Origin, Pose, Rays, Rotation, Unit
from pipeline.exports.export import export
from pipeline.exports.formats import WRITERS
from pipeline.results.output import open_output

FIELDS = {"origin": Origin, "axes": ImageAxes, "board": Board, "pose": Pose, "rotation": Rotation, "unit": Unit}
FIELDS |= {"rays": Rays}


def flips():
    """Every other value of every field of every convention; "none" is no claim, and neither is made of one."""
    for name in CHECKS:
        for field, values in FIELDS.items():
            stated = getattr(CONVENTIONS[name], field)
            if stated.name != "NONE":
                others = [other for other in values if other not in (stated,) and other.name != "NONE"]
                yield from (pytest.param(name, field, other, id=f"{name}-{field}-{other.name}") for other in others)


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


@pytest.mark.parametrize(("name", "field", "other"), list(flips()))
def test_a_flip_of_a_convention_is_noticed(output, scene, name, field, other, tmp_path, monkeypatch):
    require_notice(lambda folder: CHECKS[name](folder, scene), output, name, {field: other}, tmp_path, monkeypatch)


def test_every_format_has_a_writer_and_a_check():
    assert list(WRITERS) == list(CONVENTIONS)
    assert CHECKS.keys() | MAPS.keys() == {
        name for name, one in FORMATS.items() if one.cameras is not Cameras.PLENOPTIC
    }
