"""The picture of a target shows on each face of its preview what the face is coloured with."""

import numpy as np
import pytest

from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.preview import preview_faces, preview_picture
from pipeline.targets.surfaces import Cube, Cylinder
from pipeline.targets.target import Target

SIZE_PX = 512
"""Edge of a picture: a face of these boards is tens of pixels wide."""
BOARD = Checkerboard(columns=4, rows=3, square_mm=2.0, white=0.9, black=0.1)


@pytest.mark.parametrize(
    "surface", [None, Cube(edge_mm=20.0), Cylinder(radius_mm=20.0)], ids=["flat", "cube", "cylinder"]
)
def test_the_picture_has_the_colour_of_every_face_where_the_face_lies(surface):
    target = Target(BOARD) if surface is None else Target(BOARD, surface)
    faces, picture = preview_faces(target), preview_picture(target, SIZE_PX)
    assert set(np.unique(picture)) == {0.1, 0.9} and picture.shape == (SIZE_PX, SIZE_PX * len(target.patches()))
    assert faces.sheet.min() >= 0 and faces.sheet.max() <= 1
    middle = faces.sheet[faces.faces].mean(axis=1)
    column, row = (middle * (picture.shape[1], SIZE_PX)).astype(int).T
    sides = len(target.patches())  # each has its own part of the picture
    assert np.unique((middle[:, 0] * sides).astype(int)).tolist() == list(range(sides))
    assert (picture[SIZE_PX - 1 - row, column] == faces.radiance).all()


def test_the_first_square_of_a_board_is_black_at_the_top_left_of_its_picture():
    picture = preview_picture(Target(BOARD), 7 * 100)  # four columns of corners make five squares and two margins
    assert picture[7 * 100 // 6 + 10, 100 + 10] == 0.1
    assert picture[-1, 0] == 0.9 == picture[0, 0]
