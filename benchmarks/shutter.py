"""What does a row cost whose time is that of its own line? Processor time beside rows of a board that stands still.

    python benchmarks/shutter.py [--small]

The rigs of examples 01 and 02, one board of 28 corners that flies past and turns, an accuracy of 0.001 px. A line is
exposed for an instant, or for half a millisecond, which takes two planes for each row. The better of several turns.
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np
from kept import keeping, timed
from scipy.spatial.transform import Rotation

import pipeline
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.motion import Motion, Shutter
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.moving import solve_points, time_of_rows
from pipeline.truth.planes import Planes, tangent_planes

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
BOARD = Checkerboard(columns=7, rows=4, square_mm=1.5)
ACCURACY_PX, LEAST_HITS = 1e-3, 0.05


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="one turn: does it run at all?")
    turns = 1 if parser.parse_args().small else 5
    for name in ("01_conventional", "02_plenoptic"):
        rig = Rig.of(Tracer(pipeline.open_dataset(EXAMPLES / name / "dataset.usda").cameras[0].camera))
        planes = tangent_planes(pose_at(0.0), BOARD.points_mm())
        rows, still_s = timed(partial(still, rig, planes), turns)
        print(f"{name}: {rows} rows of a board at rest, {1e3 * still_s / rows:.2f} ms each")
        for exposure_s in (0.0, 5e-4):
            count, moving_s = timed(partial(at_their_times, rig, before(rig, exposure_s)), turns)
            ratio = moving_s / count / (still_s / rows)
            print(f"  {count} rows of lines exposed for {1e3 * exposure_s:g} ms: {ratio:.2f} times as long each")


def still(rig: Rig, planes: np.ndarray) -> int:
    """Number of rows of a board at rest, which are solved."""
    return len(solve(rig, guesses(rig, planes)[0], planes, ACCURACY_PX, LEAST_HITS).solutions.point)


def at_their_times(rig: Rig, moving: Planes) -> int:
    """Number of rows of a moving board, which are solved, with all that a table says of their time."""
    rows = solve_points(rig, moving, slice(None), ACCURACY_PX, LEAST_HITS)
    assert rows is not None
    time_of_rows(rig, moving, rows.solutions)
    return len(rows.solutions.point)


def before(rig: Rig, exposure_s: float) -> Planes:
    """The board before a shutter that scans the image in 20 ms."""
    size_px = rig.tracer.camera.sensor.size_px
    shutter = Shutter(
        scan_order="topToBottom", opens_s=-0.01, line_s=0.02 / size_px[1], exposure_s=exposure_s, instants=1
    )
    edges_s = (-0.02, 0.02)
    times_s = Motion.times_s(np.array(edges_s))[0].tolist()
    motion = Motion(edges_s=edges_s, poses=(tuple(pose_at(t).tolist() for t in times_s),))
    return Planes(tangent_planes(np.eye(4), BOARD.points_mm()), motion, shutter, size_px)


def pose_at(time_s: float) -> np.ndarray:
    """vision_from_target: 0.3 m/s to the right, and two turns a second about the line of sight."""
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ Rotation.from_euler("zy", [4 * np.pi * time_s, 0.1]).as_matrix()
    pose[:3, 3] = 300 * time_s, 0.0, 434.4
    return pose


if __name__ == "__main__":
    with keeping("shutter"):
        main()
