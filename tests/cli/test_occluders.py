"""Claim: what a user puts before a board takes rows from the table and light from the image, frame by frame."""

from pathlib import Path

import numpy as np
import pytest
from builds import made
from stage_text import edited, mesh_text, placed, stage_in, tiny_text, without_method

from pipeline.app.verify import verify
from pipeline.files.exr import read_exr
from pipeline.files.tables import Table, read_table

EDGE = [(0, -50, 0), (80, -50, 0), (80, 50, 0), (0, 50, 0)]
RELATION, BRIGHT = "\nrel plen:occluders = </TinyConventional/Screen>\n", "uniform double plen:radiance = 2"
MOVES = edited(
    placed(0, 0, 0), ("translate = (0, 0, 0)", "translate.timeSamples = {1: (0.01, 0, -425), 2: (40, 0, -425)}")
)
SCREEN = RELATION + mesh_text("Screen", EDGE, BRIGHT, MOVES, schemas="PlenOccluderAPI")


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> tuple[Path, Path]:
    """Output folders of the tiny dataset without and with a bright screen that covers its right half in frame 1."""
    folder = tmp_path_factory.mktemp("occluders")
    text = tiny_text("conventional")
    for name, content in (("free", text), ("covered", text.rstrip().removesuffix("}") + SCREEN + "}\n")):
        (folder / name).mkdir()
        result = made(stage_in(folder / name, content), folder / name / "out", folder / "store")
        kinds = {task.kind for task in result.tasks if task.state == "executed"}
    assert kinds == {"image", "truth", "certificate"}, "an occluder leaves the camera's rays alone"
    return folder / "free/out", folder / "covered/out"


def table_of(out: Path, frame: int) -> Table:
    return read_table(out / f"frames/{frame:04d}/Rig.Camera/correspondences.csv")


def test_rows_behind_the_screen_are_gone_and_counted(built) -> None:
    """3 x 2 points, turned by 5 degrees in their plane: the edge cuts the bundles of the middle column.

    What is left has not moved by a bit."""
    free, covered = (table_of(out, 1) for out in built)
    x_mm, visible = free.numbers("camera_x_mm"), {}
    for row, point in enumerate(covered.numbers("point_id").astype(int)):
        visible[point] = covered.numbers("visibility")[row]
    left, right = np.flatnonzero(x_mm < -0.5), np.flatnonzero(x_mm > 0.5)
    assert len(left) == len(right) == 2
    assert all(visible[point] == 1.0 for point in left) and not set(right) & set(visible)
    assert all(0 < visible[point] < 1 for point in set(visible) - set(left))
    note = next(line for line in covered.comments if line.startswith("Board:"))
    hidden = 6 - len(visible)
    assert f"dropped_hidden {hidden}" in note and f"partly_hidden {4 - hidden}" in note
    assert f"rows {len(visible)}" in note
    assert free.numbers("visibility").tolist() == [1.0] * 6
    kept = covered.numbers("point_id").astype(int)
    others = set(free.columns) - {"visibility"}
    assert all(covered.columns[name] == [free.columns[name][row] for row in kept] for name in others)
    assert table_of(built[1], 2).columns == table_of(built[0], 2).columns, "in frame 2 it stands aside"


@pytest.mark.parametrize("method", ["two-plane", "image", "direct"])
def test_the_rule_is_the_same_for_every_method(built, method: str, tmp_path) -> None:
    """Which points are hidden, and by how much; positions of the other methods differ by hundredths of a pixel."""
    stage = (built[1].parent / "dataset.usda").read_text(encoding="utf-8")
    stage = stage.replace("uniform int plen:seed", "uniform int[] plen:frames = [1]\n    uniform int plen:seed", 1)
    wanted = f'uniform token plen:truth:method = "{method}"\n            uniform int plen:truth:samples'
    stage = without_method(stage).replace("uniform int plen:truth:samples", wanted, 1)
    made(stage_in(tmp_path, stage), tmp_path / "out", built[1].parents[1] / "store")
    here, there = table_of(tmp_path / "out", 1), table_of(built[1], 1)
    assert set(here.columns["method"]) == {method}
    assert here.columns["point_id"] == there.columns["point_id"]
    np.testing.assert_allclose(here.numbers("visibility"), there.numbers("visibility"), rtol=0, atol=0.02)


def test_the_image_shows_the_screen_where_it_stands(built) -> None:
    free, covered = (
        [read_exr(out / f"frames/{n:04d}/Rig.Camera/image.exr")["image"].channels["Y"] for n in (1, 2)] for out in built
    )
    assert np.array_equal(free[1], covered[1])
    middle = free[0].shape[1] // 2
    np.testing.assert_allclose(covered[0][:, : middle - 6], free[0][:, : middle - 6], rtol=1e-6)
    np.testing.assert_allclose(covered[0][4:-4, middle + 8], 2.0, rtol=0.03)


def test_verify_agrees(built) -> None:
    assert verify(built[1]).agrees


def bending(last_mm: float) -> str:
    """The screen, moved by its points."""
    moved = {frame: [(x + at, y, -425) for x, y, _ in EDGE] for frame, at in ((1, 0.01), (2, last_mm))}
    points = ", ".join(f"{frame}: {places}" for frame, places in moved.items())
    animated = f"point3f[] points.timeSamples = {{{points}}}"
    return RELATION + mesh_text("Screen", EDGE, BRIGHT, animated, schemas="PlenOccluderAPI")


def test_points_that_move_hide_and_show_like_a_mesh_that_moves_and_an_edit_of_a_frame_builds_that_frame(
    built, tmp_path
):
    text, store = tiny_text("conventional").rstrip().removesuffix("}"), built[1].parents[1] / "store"
    stage = stage_in(tmp_path, f"{text}{bending(40)}}}\n")
    made(stage, tmp_path / "out", store)
    for frame in (1, 2):
        here, there = table_of(tmp_path / "out", frame), table_of(built[1], frame)
        assert here.columns["point_id"] == there.columns["point_id"]
        np.testing.assert_allclose(here.numbers("visibility"), there.numbers("visibility"), rtol=0, atol=1e-6)
    stage.write_text(f"{text}{bending(0.01)}}}\n", encoding="utf-8")
    tasks = [task.name for task in made(stage, tmp_path / "out", store).tasks if task.state == "executed"]
    assert {name.split("/")[0] for name in tasks} == {"image", "truth", "certificate"}
    assert all("/0001" not in name for name in tasks)
    assert len(table_of(tmp_path / "out", 2).columns["x_px"]) < 6
