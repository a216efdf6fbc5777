"""An occluder is read as the stage draws it, in millimetres, where it is in each frame, and never inside the lens."""

import numpy as np
import pytest
from places import ROOT, TINY
from pxr import Usd, UsdGeom
from stage_text import head, stage_in

from pipeline.frames import apply
from pipeline.scene.load import open_dataset
from pipeline.scene.occluders import meets_lens, read_occluder

STAGE = (
    head("Dataset", end=2)
    + """
def PlenDataset "Dataset" (
    prepend references = @{tiny}@
)
{{
    rel plen:occluders = [</Dataset/Arm/Screen>, </Dataset/Arm/Dark>]

    def Xform "Arm"
    {{
        double3 xformOp:translate.timeSamples = {{
            1: (0, 0, -300),
            2: (0, 5, -310),
        }}
        double3 xformOp:scale = (2, 1, 1)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]

        def Mesh "Screen" (
            prepend apiSchemas = ["PlenOccluderAPI"]
        )
        {{
            int[] faceVertexCounts = [4, 3, 3]
            int[] faceVertexIndices = [0, 1, 2, 3, 0, 1, 4, 1, 2, 4]
            int[] holeIndices = [1]
            uniform token subdivisionScheme = "none"
            point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 2, 1)]
            uniform double plen:radiance = 0.25
        }}

        def Mesh "Dark"
        {{
            int[] faceVertexCounts = [3]
            int[] faceVertexIndices = [0, 1, 2]
            point3f[] points = [(5, 0, 0), (6, 0, 0), (6, 1, 0)]
            token visibility.timeSamples = {{
                1: "inherited",
                2: "invisible",
            }}
        }}
    }}
}}
"""
)


def written(folder, text: str = STAGE):
    return stage_in(folder, text.format(tiny=TINY.as_posix()))


def test_faces_become_triangles_and_poses_any_affine_transform(tmp_path) -> None:
    """A quad, a hole and a triangle; scaled twice along x; moved in the second frame, where the other is invisible."""
    dataset = open_dataset(written(tmp_path), [ROOT])
    screen, dark = (entry.occluder for entry in dataset.occluders)
    assert screen.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [1, 2, 4]]
    assert (screen.radiance, dark.radiance) == (0.25, 0.0)
    first, second = (frame.world_from_occluder for frame in dataset.frames)
    assert list(first) == ["/Dataset/Arm/Screen", "/Dataset/Arm/Dark"] and list(second) == ["/Dataset/Arm/Screen"]
    corners = [apply(np.array(poses["/Dataset/Arm/Screen"]), screen.corners_mm()[2]) for poses in (first, second)]
    assert corners[0].tolist() == [[2, 0, -300], [2, 1, -300], [4, 2, -299]]
    assert corners[1].tolist() == [[2, 5, -310], [2, 6, -310], [4, 7, -309]]


def test_its_points_are_in_the_unit_of_its_stage() -> None:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    mesh = UsdGeom.Mesh.Define(stage, "/Wall")
    mesh.CreatePointsAttr([(1, 0, 0), (2, 0, 0), (0, 3, 0)])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    mesh.CreateSubdivisionSchemeAttr("none")
    (corners,) = read_occluder(mesh.GetPrim()).corners_mm()
    assert corners.tolist() == [[1000, 0, 0], [2000, 0, 0], [0, 3000, 0]]


def test_a_triangle_meets_the_lens_where_a_fine_sampling_of_it_does() -> None:
    """Random triangles about a cylinder of radius 2 from z = -3 to 5; 20,000 points of each."""
    rng, found = np.random.default_rng(4), 0
    u, v = np.sort(rng.uniform(size=(2, 20_000)), axis=0)
    shares = np.stack([u, v - u, 1 - v], axis=1)
    for _ in range(300):
        triangle = rng.uniform(-8, 8, (3, 3))
        points = shares @ triangle
        beyond = np.maximum(np.hypot(points[:, 0], points[:, 1]) - 2, np.abs(points[:, 2] - 1) - 4).min()
        if abs(beyond) > 0.3:
            assert meets_lens(triangle[None], (-3.0, 5.0), 2.0) == (beyond < 0)
            found += beyond < 0
    assert 30 < found < 200


@pytest.mark.parametrize(
    ("corners", "meets"),
    [
        ([(-99, 30, -500), (99, 30, -500), (0, 30, 900)], False),  # a floor beside the whole camera
        ([(-99, -99, -200), (99, -99, -200), (0, 99, -200)], False),  # a wall behind it
        ([(-99, -99, 20), (99, -99, 20), (0, 99, 20)], True),  # a wall through the lens
        ([(-99, 10, -500), (99, 10, -500), (0, 10, 900)], True),  # a floor through the lens
    ],
)
def test_beside_and_behind_the_lens_there_is_room(corners, meets: bool) -> None:
    assert meets_lens(np.array([corners], float), (-30.0, 34.0), 25.0) == meets
