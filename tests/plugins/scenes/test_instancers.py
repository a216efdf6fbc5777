"""Point instancers in each other, that share prototypes and refer to each other: their instances are those of USD."""

import numpy as np
import pytest
from plugins.scenes.test_shapes import counted, scene
from pxr import Usd, UsdGeom
from stage_text import edited, head, stage_in

from pipeline.limits import VARIABLE
from pipeline.plugins.scenes.reading import instancers
from pipeline.scene.load import load

RING = """
        def PointInstancer "Ring"
        {
            rel prototypes = </Scene/Things/Ring/Pair>
            int[] protoIndices = [0, 0, 0]
            point3f[] positions = [(0, 0, 0), (10, 0, 0), (0, 20, 0)]
            quath[] orientations = [(1, 0, 0, 0), (0.70710678, 0, 0, 0.70710678), (0, 0, 0, 1)]
            float3[] scales = [(1, 1, 1), (1, 1, 1), (2, 2, 2)]

            def Xform "Pair"
            {
                def PointInstancer "Two"
                {
                    rel prototypes = </Scene/Things/Ring/Pair/Two/Box>
                    int[] protoIndices = [0, 0]
                    point3f[] positions = [(1, 0, 0), (0, 0, 3)]

                    def Cube "Box"
                    {
                        double size = 1
                    }
                }
            }
        }
"""
"""Two boxes in each of three places: as they are, turned about z by 90 degrees, turned by 180 and twice as large."""


def places(loaded, frame: int = 0) -> list[list[float]]:
    """Origins of all shapes in the frame of the world, and sizes along x [mm]."""
    poses = loaded.dataset.frames[frame].world_from_occluder
    shown = loaded.dataset.occluders_in(loaded.dataset.frames[frame])
    boxes = [(np.array(poses[each.prim_path]), each.occluder.vertices_mm) for each in shown]
    return [[*pose[:3, 3].round(6), np.ptp((pose[:3, :3] @ points.T)[0]).round(3)] for pose, points in boxes]


def test_instancers_in_prototypes_are_in_each_instance(tmp_path, monkeypatch):
    """In closed form, and as USD's own matrices have it: p_outer + R s p_inner. As many walks as levels, and one."""
    walks = counted(monkeypatch, instancers, "_instancers")
    path = scene(tmp_path, RING)
    loaded = load(path)
    assert loaded.problems == [] and len(walks) == 3
    by_hand = [(1, 0, -450), (0, 0, -447), (10, 1, -450), (10, 0, -447), (-2, 20, -450), (0, 20, -444)]
    found = np.array(places(loaded))
    np.testing.assert_allclose(found[:, :3], by_hand, rtol=0, atol=1e-2)  # orientations are halves
    assert found[:, 3].tolist() == [1] * 4 + [2] * 2
    stage = Usd.Stage.Open(str(path))
    outer, inner = (
        UsdGeom.PointInstancer.Get(stage, f"/Scene/Things/{at}").ComputeInstanceTransformsAtTime(1, 1)
        for at in ("Ring", "Ring/Pair/Two")
    )
    above = UsdGeom.XformCache(1).GetLocalToWorldTransform(stage.GetPrimAtPath("/Scene/Things/Ring"))
    by_usd = [list((low * high * above).ExtractTranslation()) for high in outer for low in inner]
    np.testing.assert_allclose(found[:, :3], by_usd, rtol=0, atol=1e-6)


def test_instances_in_instances_count_for_the_limit_before_they_are_written(tmp_path, monkeypatch):
    """Three instances, and two in each of them."""
    path, written = scene(tmp_path, RING), counted(monkeypatch, instancers, "_write_instances")
    monkeypatch.setenv(VARIABLE, "instances=8")
    [error] = load(path).errors
    assert (error.code, error.line) == (
        "over-limit",
        1 + path.read_text().splitlines().index(" " * 16 + 'def PointInstancer "Two"'),
    )
    assert "instances=9" in error.hint and len(written) == 1
    monkeypatch.setenv(VARIABLE, "instances=9")
    assert load(path).problems == [] and len(written) == 1 + 4


FIRST = """
        def PointInstancer "First"
        {
            rel prototypes = [</Scene/Things/First/Small>, </Scene/Things/First/Large>]
            int[] protoIndices = [0, 0]
            point3f[] positions = [(0, 0, 0), (9, 0, 0)]

            def Cube "Small"
            {
                double size = 1
            }

            def Cube "Large"
            {
                double size = 3
            }
        }
"""
COPY = 'def "Other" (references = </Scene/Things/First>)\n{\n%s\n}\n'
SHARING = """
        def PointInstancer "Other"
        {
            rel prototypes = </Scene/Things/First/Small>
            int[] protoIndices = [0]
            point3f[] positions = [(7, 7, 0)]
        }
"""


@pytest.mark.parametrize("is_before", [False, True])
@pytest.mark.parametrize(
    ("other", "there"),
    [
        (COPY % "", [(0, 0, 1), (9, 0, 1)]),
        (COPY % 'over "Small"\n{\ndouble size = 2\n}', [(0, 0, 2), (9, 0, 2)]),
        (COPY % "point3f[] positions = [(0, 5, 0), (9, 5, 0)]", [(0, 5, 1), (9, 5, 1)]),
        (COPY % "int[] protoIndices = [1, 0]", [(0, 0, 3), (9, 0, 1)]),
        (COPY % "int64[] invisibleIds = [0]", [(9, 0, 1)]),
        (SHARING, [(7, 7, 1)]),
    ],
)
def test_an_instancer_that_refers_to_another_has_its_own_instances(is_before: bool, other: str, there: list, tmp_path):
    """To one of the same stage, whose instances and hidden prototypes it would have by this reference."""
    loaded = load(scene(tmp_path, other + FIRST if is_before else FIRST + other))
    copy = load(stage_in(tmp_path, loaded.flattened))
    for each in (loaded, copy):
        assert each.problems == []
        assert sorted((x, y, size) for x, y, _, size in places(each)) == sorted([(0, 0, 1), (9, 0, 1), *there])


@pytest.mark.parametrize("held", ["Group", "Other"])
def test_an_instancer_in_its_own_prototype_is_left_out_with_a_warning(held: str, tmp_path):
    """Or in that of one which lies in its prototype; what stands beside it is drawn."""
    group = """def Xform "%s"
    {
        def Sphere "Ball"
        {
        }

        def PointInstancer "Endless"
        {
            rel prototypes = </Scene/Things/%s>
            int[] protoIndices = [0]
            point3f[] positions = [(9, 0, 0)]
        }
    }
"""
    loaded = load(scene(tmp_path, group % ("Group", held) + group % ("Other", "Group" if held == "Other" else "Other")))
    assert {(each.code, each.severity) for each in loaded.problems} == {("not-drawn", "warning")}
    assert [each.at for each in loaded.problems] == [f"/Scene/Things/{name}/Endless" for name in ("Group", "Other")]
    assert len(loaded.dataset.occluders) == 2


def test_the_visibility_of_a_prototype_is_that_of_its_instances_in_each_frame(tmp_path):
    """It is hidden as a prototype, by the program; a reference may scale its time."""
    blinking = 'token visibility.timeSamples = {\n2: "inherited",\n4: "invisible",\n}\ndouble size'
    (tmp_path / "first.usda").write_text(
        (head("First") + FIRST.replace("Scene/Things/", "").replace("double size", blinking)).replace("= 24", "= 48")
    )
    loaded = load(scene(tmp_path, 'def "First" (references = @first.usda@)\n{\n}\n', 2))
    assert loaded.problems == [] and [len(places(loaded, frame)) for frame in (0, 1)] == [2, 0]


@pytest.mark.parametrize(
    ("edits", "there", "codes"),
    [
        ([("First/Large>", "First/Gone>"), ("[0, 0]", "[0, 1]")], [(0, 0, 1)], ["missing-target"]),
        ([("int[]", "int64[] ids = [7, 7]\nint[]")], [(0, 0, 1), (9, 0, 1)], []),
    ],
)
def test_what_is_wrong_with_one_instance_leaves_the_others(edits: list, there: list, codes: list, tmp_path):
    """A prototype that is not there, and one id for two; in a file of others."""
    (tmp_path / "first.usda").write_text(head("First") + edited(FIRST.replace("Scene/Things/", ""), *edits))
    loaded = load(scene(tmp_path, 'def "First" (references = @first.usda@)\n{\n}\n'))
    assert [each.code for each in loaded.problems] == codes and loaded.errors == []
    assert sorted((x, y, size) for x, y, _, size in places(loaded)) == there


@pytest.mark.parametrize(
    "edit",
    [
        ("double size = 1", 'double size = 1\nuniform token[] xformOpOrder = ["!resetXformStack!"]'),
        ('def Cube "Small"', 'over "Small" (references = </Scene/Things/Apart>)'),
    ],
)
def test_a_prototype_stands_where_its_instancer_places_it_whatever_is_above_it(edit: tuple, tmp_path):
    """It may leave out transforms above itself, as in `ComputeInstanceTransformsAtTime`, and need not be defined."""
    apart = 'class Cube "Apart"\n{\n}\n'
    loaded = load(scene(tmp_path, apart + edited(FIRST, edit)))
    assert loaded.problems == [] and places(loaded) == [[0, 0, -450, 1], [9, 0, -450, 1]]
