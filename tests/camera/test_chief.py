"""Claim: from wherever light comes through a lens there is a chief ray, found as one smooth function of the height."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.chief_ray import chief_heights, chief_slopes
from pipeline.camera.pupil.outlines import passes
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.table import towards_scene, unbounded
from pipeline.scene.load import load

LENSES = Path(__file__).parents[2] / "stages/lenses"


@pytest.mark.parametrize(
    "name", ["wide_22mm_nakamura", "double_gauss_100mm_mandler", "double_gauss_100mm_mills", "macro_100mm_canon"]
)
def test_every_height_that_is_lit_has_a_chief_ray(name: str) -> None:
    """Up to the end of the image circle; steep rays near the axis of the rear surface once led the search astray."""
    prescription = load(LENSES / f"{name}.usda").lens.prescription
    table, film = towards_scene(prescription), first_order(prescription).rear_focus_mm
    stop_row = len(prescription.surfaces) - 1 - prescription.stop_index
    u = np.linspace(-1, 1, 61) * prescription.surfaces[-1].semi_diameter_mm
    grid = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    heights = np.linspace(0.02, 1.0, 50) * first_order(prescription).efl_mm
    lit = [passes(table, np.broadcast_to([h, 0.0, film], (len(grid), 3)), grid).any() for h in heights]
    heights = heights[: lit.index(False) if False in lit else None]
    assert len(heights) > 12

    crossings = chief_heights(table, stop_row, film, heights)

    start = np.column_stack([heights, 0 * heights, np.full(len(heights), film)])
    way = np.column_stack([crossings, 0 * heights, np.full(len(heights), table[0, 0])]) - start
    alive = np.ones(len(heights))
    trace_rays(unbounded(table[: stop_row + 1]), start, way / np.linalg.norm(way, axis=1, keepdims=True), alive)
    assert alive.all() and np.abs(start[:, 0]).max() < 1e-9
    steps = np.diff(crossings)
    assert (steps[1:] / steps[:-1] > 2 / 3).all() and (steps[1:] / steps[:-1] < 3 / 2).all()  # no jump to another ray


def test_a_height_without_one_is_refused_with_a_number_and_a_hint() -> None:
    prescription = load(LENSES / "double_gauss_100mm_tronnier.usda").lens.prescription
    table, film = towards_scene(prescription), first_order(prescription).rear_focus_mm
    with pytest.raises(CameraError, match=r"no ray from 400 mm off the axis") as caught:
        chief_slopes(table, 5, np.array([[1.0, 0.0, film], [0.0, 400.0, film], [300.0, 0.0, film]]))
    assert "pixel pitch in mm" in caught.value.hint
