"""What do derivatives of rows by ten numbers cost? Processor time beside the rows themselves.

    python benchmarks/derivatives.py [--small]

The rigs of examples 01 and 02, one board of 28 corners at an accuracy of 0.001 px; six numbers of its pose, a radius, a
thickness, the sensor's distance and the pitch of its pixels. The better of several turns.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from kept import keeping, timed
from scipy.spatial.transform import Rotation

import pipeline
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.frames import rigid
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.truth.derivatives import Neighbour, SolvedRows, Variation, derivatives
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.planes import Planes, tangent_planes
from pipeline.truth.rows import Solutions

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
BOARD = Checkerboard(columns=7, rows=4, square_mm=1.5)
STEP = 1e-4
POSE = rigid(Rotation.from_euler("xyz", (190.0, 15.0, 5.0), degrees=True).as_matrix(), np.array([0.5, -0.5, 430.0]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="one turn: does it run at all?")
    turns = 1 if parser.parse_args().small else 5
    for name in ("01_conventional", "02_plenoptic"):
        rig = Rig.of(Tracer(pipeline.open_dataset(EXAMPLES / name / "dataset.usda").cameras[0].camera))
        rows, still_s = timed(partial(solved, rig), turns)
        rates, more_s = timed(partial(varied, rig, rows), turns)
        _, blur_s = timed(partial(varied, rig, rows, with_blur=True), turns)
        count = len(rows.point)
        print(f"{name}: {count} rows, {1e3 * still_s / count:.2f} ms each")
        print(f"  by {rates} numbers: {more_s / still_s:.2f} times as much again; with blur {blur_s / still_s:.1f}")


def solved(rig: Rig) -> Solutions:
    planes = tangent_planes(POSE, BOARD.points_mm())
    return solve(rig, guesses(rig, planes)[0], planes, 1e-3, 0.05).solutions


def varied(rig: Rig, rows: Solutions, with_blur: bool = False) -> int:
    """Number of derivatives of each row, which are computed; cameras are made ready, too."""
    here = Planes(tangent_planes(POSE, BOARD.points_mm()))
    sides = [
        *(partial(moved, rig, number) for number in range(6)),
        *(partial(edited, rig, here, f) for f in EDITS),
    ]
    variations = [Variation(STEP, side(-STEP), side(STEP)) for side in sides]
    solved = SolvedRows(rows.point, rows.cell, rows.xy_px, here)
    rates = derivatives(rig, solved, variations, with_blur=with_blur)
    assert np.isfinite(rates.x_px).all()
    return rates.x_px.shape[1]


def moved(rig: Rig, number: int, by: float) -> Neighbour:
    step = by * np.eye(6)[number]
    turn = rigid(Rotation.from_rotvec(step[3:], degrees=True).as_matrix(), step[:3])
    return Neighbour(rig.tracer, Planes(tangent_planes(POSE @ turn, BOARD.points_mm())))


def edited(rig: Rig, planes: Planes, edit: Callable[[Camera, float], Camera], by: float) -> Neighbour:
    return Neighbour(rig.tracer.next_to(edit(rig.tracer.camera, by)), planes)


def of_surface(name: str, camera: Camera, by: float) -> Camera:
    surfaces = list(camera.prescription.surfaces)
    surfaces[2] = replace(surfaces[2], **{name: getattr(surfaces[2], name) + by})
    return replace(camera, prescription=replace(camera.prescription, surfaces=tuple(surfaces)))


EDITS: tuple[Callable[[Camera, float], Camera], ...] = (
    partial(of_surface, "radius_mm"),
    partial(of_surface, "thickness_mm"),
    lambda camera, by: replace(camera, sensor_distance_mm=camera.sensor_distance_mm + by),
    lambda camera, by: replace(camera, sensor=replace(camera.sensor, pitch_mm=camera.sensor.pitch_mm + 1e-3 * by)),
)


if __name__ == "__main__":
    with keeping("derivatives"):
        main()
