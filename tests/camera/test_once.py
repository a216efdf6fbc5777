"""What is kept of a pure function: the same arguments give the same result without computing, any others do not."""

from dataclasses import dataclass

import numpy as np
import pytest

from pipeline.camera.pupil.outlines import once


@dataclass(frozen=True)
class Plane:
    """A record of arrays."""

    axes: np.ndarray


@pytest.fixture
def calls():
    """Arguments of every computation, and the function that keeps its results."""
    made = []
    return made, once(lambda *args: made.append(args) or len(made))


def test_equal_bytes_are_computed_once(calls):
    made, of = calls
    table = np.arange(6.0).reshape(2, 3)
    assert of(table, 1, Plane(table), (0.5, 2.0)) == of(table.copy(), 1, Plane(table.copy()), (0.5, 2.0)) == 1
    assert len(made) == 1


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (np.zeros(2), np.array([0.0, 5e-324])),
        (np.zeros(2), np.array([0.0, -0.0])),
        (np.zeros((2, 3)), np.zeros((3, 2))),
        (np.zeros(2), np.zeros(2, np.int64)),
        (0.0, -0.0),
        (1.0, np.nextafter(1.0, 2.0)),
        (Plane(np.zeros(2)), Plane(np.ones(2))),
        ((1.0, 2.0), (2.0, 1.0)),
    ],
)
def test_any_other_bit_is_another_result(calls, one, other):
    _, of = calls
    assert (of(one), of(other), of(one)) == (1, 2, 1)
