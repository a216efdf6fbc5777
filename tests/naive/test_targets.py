"""Claim: rows of targets of every family lie where a bundle traced by the textbook says, on each point's own plane.

A build per family, as a user makes it, through a conventional camera with coarse pixels. For some of its rows random
rays all over the rear surface leave the stated image position; the mean of their hits on the tangent plane of the point
must be the point.
"""

from pathlib import Path

import numpy as np
import pytest
from naive import brute, textbook
from stage_text import head
from tolerances import COARSE_GRID_PX, SIGMAS

import pipeline
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.tracer import Tracer
from pipeline.files.exr import read_exr
from pipeline.files.tables import Table, read_table
from pipeline.scene.load import open_dataset

STAGE = (
    head("Dataset")
    + """
def PlenDataset "Dataset"
{
    rel plen:cameras = </Dataset/Rig/Camera>
    rel plen:targets = </Dataset/Thing>

    def "Rig" (
        prepend references = @rigs/conventional_100mm.usda@
    )
    {
        over "Camera"
        {
            uniform int plen:image:samples = 64
            uniform token plen:truth:method = "METHOD"
            uniform int plen:truth:samples = 512
            uniform int plen:truth:supersampling = FINER
        }

        over "Sensor"
        {
            uniform double plen:pixelPitch = 0.4
            uniform int2 plen:resolution = (60, 45)
        }
    }

    def "Thing" (
        prepend references = @targets/FILE.usda@
    )
    {
        double3 xformOp:translate = (1, -2, -440)
        float3 xformOp:rotateXYZ = (TURN)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    }
}
"""
)
ROWS, GROUPS, RAYS = 6, 8, 4_000


class Built:
    def __init__(self, folder: Path, file: str, turn: str, method: str = "direct", finer: int = 1) -> None:
        stage, text = folder / "dataset.usda", STAGE
        for name, value in (("FILE", file), ("TURN", turn), ("METHOD", method), ("FINER", str(finer))):
            text = text.replace(name, value)
        stage.write_text(text)
        assert pipeline.build(stage, folder / "out", jobs=1).exit_code == 0
        dataset = open_dataset(stage)
        self.target = dataset.targets[0].target
        self.points = self.target.points()
        self.pose = dataset.frames[0].vision_from_target("Rig.Camera", "Thing")
        self.camera = focused(dataset.cameras[0].camera)
        frame = folder / "out/frames/0001/Rig.Camera"
        self.rows: Table = read_table(frame / "correspondences.csv")
        self.header = (frame / "correspondences.csv").read_text()
        self.image = read_exr(frame / "image.exr")["image"].channels["Y"]

    def column(self, name: str) -> np.ndarray:
        return self.rows.numbers(name)

    def seen(self) -> set[int]:
        return set(self.column("point_id").astype(int))

    def facing(self) -> np.ndarray:
        """Cosine at each point between its normal and the way to the centre of the stop, positive in front."""
        at = self.points.position_mm @ self.pose[:3, :3].T + self.pose[:3, 3]
        normal = self.points.axes[:, :, 2] @ self.pose[:3, :3].T
        return -np.sum(at * normal, axis=1) / np.linalg.norm(at, axis=1)


@pytest.fixture
def build(tmp_path, monkeypatch):
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "store"))
    return lambda *arguments: Built(tmp_path, *arguments)


def deviations_px(built: Built, count: int = ROWS) -> tuple[np.ndarray, np.ndarray]:
    """Where the mean hits, seen from the point, mapped to the image; and the standard error of that, (n, 2) each."""
    rng, tracer = np.random.default_rng(21), Tracer(built.camera)
    x, y, ids = built.column("x_px"), built.column("y_px"), built.column("point_id").astype(int)
    found, error = [], []
    for row in np.linspace(0, len(x) - 1, count).astype(int):
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = built.points.axes[ids[row]], built.points.position_mm[ids[row]]
        plane = built.pose @ frame

        def means(dx, dy, groups, plane=plane, row=row):
            start = tracer.positions_mm(x[[row]] + dx, y[[row]] + dy)[0]
            rows = []
            for _ in range(groups):
                position, direction, weight = brute.rays_through(built.camera, start, None, None, RAYS, rng)
                kept = weight > 0
                hits = textbook.at_plane(position[kept], direction[kept], plane)
                rows.append(np.average(hits, axis=0, weights=weight[kept]))
            return np.array(rows)

        along_x, along_y = ((means(*step, 2).mean(axis=0) - means(*-step, 2).mean(axis=0)) / 2 for step in np.eye(2))
        px_per_mm = np.linalg.inv(np.stack([along_x, along_y], axis=1))
        px = means(0, 0, GROUPS) @ px_per_mm.T
        found.append(px.mean(axis=0))
        sigma = np.array([built.column("sigma_x_px")[row], built.column("sigma_y_px")[row]])
        error.append(np.hypot(px.std(axis=0, ddof=1) / np.sqrt(GROUPS), sigma))
    return np.array(found), np.array(error)


FAMILIES = [
    ("charuco_8x5", "10, -25, 5"),
    ("aprilgrid_6x6", "0, 0, 2"),
    ("circles_asymmetric_4x11", "20, 10, 0"),
    ("deltille_7x5", "0, 30, 0"),
    ("checkerboard_4x7_warped", "0, 35, 0"),
    ("checkerboard_4x7_measured", "-20, 5, 0"),
    ("charuco_cylinder", "5, 10, 0"),
    ("aprilgrid_cube", "25, -30, 0"),
    ("checkerboard_stairs", "10, 15, 0"),
    ("pyramid_mesh", "5, 10, 20"),
]


@pytest.mark.heavy
@pytest.mark.parametrize(("file", "turn"), FAMILIES, ids=[file for file, _ in FAMILIES])
def test_rows_are_where_a_brute_force_bundle_meets_the_tangent_plane(build, file: str, turn: str) -> None:
    built = build(file, turn)
    found, error = deviations_px(built, min(ROWS, len(built.column("x_px"))))
    assert np.abs(found).max() < 0.05
    assert (np.abs(found) < SIGMAS * error + COARSE_GRID_PX).all()
    # Every point that faces the camera and lies within the image has a row, and no other point has one.
    facing = set(np.flatnonzero(built.facing() > 0))
    assert built.seen() <= facing
    assert len(built.seen()) > 0.5 * len(facing)
    assert built.image.max() > 0.5


def test_points_that_face_away_have_no_rows(build) -> None:
    built = build("aprilgrid_cube", "25, -30, 0")
    faces = {index // 36 for index in built.seen()}
    assert faces == set(np.flatnonzero(built.facing()[::36] > 0))
    assert len(faces) == 3
    assert "points_facing_away 108" in built.header


@pytest.mark.heavy
def test_methods_agree_on_a_cube(build, tmp_path) -> None:
    """Position images traced to each face's own plane, against `direct`.

    They are twice as fine, because the search in them is linear and pixels are coarse here.
    """
    (tmp_path / "other").mkdir()
    direct = build("aprilgrid_cube", "25, -30, 0")
    traced = Built(tmp_path / "other", "aprilgrid_cube", "25, -30, 0", "image", 2)
    assert np.array_equal(direct.column("point_id"), traced.column("point_id"))
    for axis in "xy":
        apart = np.abs(direct.column(f"{axis}_px") - traced.column(f"{axis}_px"))
        sigma = np.hypot(direct.column(f"sigma_{axis}_px"), traced.column(f"sigma_{axis}_px"))
        assert (apart < SIGMAS * sigma + COARSE_GRID_PX).all()


def test_the_sag_of_a_cylinder_over_the_blur_is_reported(build) -> None:
    """Two standard deviations of the bundle on the plane, squared, over twice the radius."""
    built = build("charuco_cylinder", "5, 10, 0")
    stated = float(built.header.split("over the blur ")[1].split(" mm")[0])
    blur = np.sqrt((built.column("blur_xx_px2") + built.column("blur_yy_px2")).max())
    mm_per_px = 0.4 * 440 / 131.8
    assert 0.1 < stated / ((2 * blur * mm_per_px) ** 2 / 80) < 2
