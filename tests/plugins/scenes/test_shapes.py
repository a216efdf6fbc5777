"""Shapes of scenes made elsewhere: what is drawn of meshes, solids, instancers and skeletons, in each frame."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from builds import made
from places import ROOT
from plugins.scenes.stage_materials import material_text
from pxr import Gf, Usd, UsdGeom
from stage_text import head, in_the_library, mesh_text, placed, stage_in

from pipeline.limits import VARIABLE
from pipeline.plugins.scenes import reader
from pipeline.plugins.scenes.lighting import lit_scene
from pipeline.plugins.scenes.reading import materials, shaders, subdivided
from pipeline.scene.load import load
from pipeline.scene.usd.meshes import drawn, is_animated

CUBE = (
    [4] * 6,
    [0, 4, 6, 2, 0, 1, 5, 4, 4, 5, 7, 6, 3, 7, 5, 1, 6, 7, 3, 2, 2, 3, 1, 0],
    [(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)],
)


def mesh(counts, indices, points, scheme="catmullClark", path="/M", stage=None) -> UsdGeom.Mesh:
    stage = stage or Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 0.001)
    made = UsdGeom.Mesh.Define(stage, path)
    made.CreateFaceVertexCountsAttr(counts)
    made.CreateFaceVertexIndicesAttr(indices)
    made.CreatePointsAttr([Gf.Vec3f(*map(float, point)) for point in points])
    made.CreateSubdivisionSchemeAttr(scheme)
    STAGES.append(stage)
    return made


STAGES: list[Usd.Stage] = []
"""Prims live as long as their stages."""


def volume(shape) -> float:
    corners = shape.points[shape.triangles]
    return float(np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])) / 6)


def test_usds_fallback_is_a_catmull_clark_surface_and_none_its_polygons():
    made = mesh(*CUBE)
    made.GetSubdivisionSchemeAttr().Clear()
    smooth = drawn(made.GetPrim())
    assert np.abs(smooth.points).max() == pytest.approx(68 / 81, abs=1e-12)
    made.GetSubdivisionSchemeAttr().Set("none")
    polygons = drawn(made.GetPrim())
    assert (len(smooth.triangles), len(polygons.triangles)) == (12288, 12) and volume(polygons) == pytest.approx(8)
    made.GetSubdivisionSchemeAttr().Set("bilinear")
    assert volume(drawn(made.GetPrim())) == pytest.approx(8)


def counted(monkeypatch, module, name: str) -> list:
    """A list that grows with each call of a function of a module."""
    real, calls = getattr(module, name), []
    monkeypatch.setattr(module, name, lambda *arguments: calls.append(arguments) or real(*arguments))
    return calls


def test_a_build_refines_a_mesh_once_and_its_channels_share_the_triangles(tmp_path, monkeypatch):
    """It was refined for the build and again for its warnings, and made ready for rays again for each channel."""
    refined, trees = counted(monkeypatch, subdivided, "refined"), counted(monkeypatch, lit_scene, "MeshScene")
    counts, indices, points = CUBE
    body = f"int[] faceVertexCounts = {counts}\nint[] faceVertexIndices = {indices}\npoint3f[] points = {points}\n"
    stage = scene(tmp_path, f'def Mesh "Body"\n{{\n{body}}}\n', lit=True)
    few = "uniform int2 plen:resolution = (16, 12)\n"
    sensor = f'over "Sensor" (\nprepend references = @sensors/bayer_640x480_10um.usda@\n)\n{{\n{few}}}\n'
    lens = 'over "Lens"\n{\nuniform token plen:indexSource = "catalogue"\n}\n'
    rig = "@rigs/conventional_100mm.usda@\n)\n{\n"
    stage.write_text(stage.read_text().replace(rig, rig + sensor + lens))
    result = made(stage, tmp_path / "out", tmp_path / "store", preview=True)
    assert sum(task.name.startswith("image/") for task in result.tasks) == 3
    of_mesh = [mesh for (meshes,) in trees for mesh in meshes if len(mesh) > 1000]  # a tiny scene compiles kernels
    assert (len(refined), len(of_mesh)) == (1, 1)


KINDS = ("PointInstancer", "instances", "references")


def many(kind: str, count: int, ball: str = "", more: str = "") -> str:
    """A ball in many places, with something in it, and something more in the place before the last one."""
    one = f'Xform "One"\n{{\ndef Sphere "Ball"\n{{\n{ball}\n}}\n}}\n'
    if kind == "PointInstancer":
        two = f'def "Two" (\nreferences = </Scene/Things/Many/One>\n)\n{{\n{more}\n}}\n' if more else ""
        prototypes = ", ".join(f"</Scene/Things/Many/{name}>" for name in ("One", "Two")[: 2 if more else 1])
        which = [int(bool(more) and k == count - 2) for k in range(count)]
        return (
            f'def PointInstancer "Many"\n{{\nrel prototypes = [{prototypes}]\n'
            f"int[] protoIndices = {which}\npoint3f[] positions = {[(k, 0, 0) for k in range(count)]}\n"
            f"def {one}{two}}}\n"
        )
    is_shared = "true" if kind == "instances" else "false"
    own = (
        f'def "I{k}" (\ninstanceable = {is_shared}\nreferences = </Scene/Things/One>\n)\n'
        f"{{\n{placed(k, 0, 0)}\n{more * (k == count - 2)}\n}}\n"
        for k in range(count)
    )
    return f"class {one}{''.join(own)}"


@pytest.mark.parametrize("kind", KINDS)
def test_instances_share_one_tessellation(kind: str, tmp_path, monkeypatch):
    made_once = counted(monkeypatch, reader, "solid")
    loaded = load(scene(tmp_path, many(kind, 20), lit=True), look=True)
    assert loaded.errors == [] and len(loaded.dataset.occluders) == 20 and len(made_once) == 1
    assert len({id(entry.occluder.vertices_mm) for entry in loaded.dataset.occluders}) == 1


@pytest.mark.parametrize("kind", KINDS)
def test_what_instances_share_is_checked_once_and_a_further_one_takes_few_calls(kind: str, tmp_path, monkeypatch):
    """Calls of the package's own functions are counted, as time would be another on each machine. A further one takes
    260; with those of NumPy, and of checks that only tests have, it once took 530 to 600.
    """
    shared, calls, numbers = counted(monkeypatch, shaders, "_shade"), [], []
    monkeypatch.setattr(materials, "remarks_on", lambda prim: shared.append(prim) or [])
    for count in (5, 25):
        stage, made = scene(tmp_path, many(kind, count), lit=True), []
        load(stage, look=True)
        shared.clear()
        sys.setprofile(lambda frame, event, _, made=made: made.append(frame.f_code) if event == "call" else None)
        loaded = load(stage, look=True)
        sys.setprofile(None)
        assert loaded.problems == [] and len(loaded.dataset.occluders) == count
        numbers.append(len(shared))
        calls.append(sum(code.co_filename.startswith(str(ROOT / "pipeline")) for code in made))
    assert numbers == [2, 2] and (calls[1] - calls[0]) / 20 < 300


@pytest.mark.parametrize("kind", KINDS)
def test_a_mistake_in_what_instances_share_is_named_once(kind: str, tmp_path):
    stage = scene(tmp_path, many(kind, 6, "double radius = nan"))
    [problem] = load(stage, look=True).problems
    line = 1 + stage.read_text().splitlines().index("double radius = nan")
    assert (problem.code, problem.line, problem.severity) == ("not-finite", line, "error")


@pytest.mark.parametrize("kind", ("PointInstancer", "references"))
def test_what_one_of_many_says_itself_is_checked_and_drawn(kind: str, tmp_path):
    for radius, codes in (("-inf", ["not-finite"]), ("2", [])):
        own = f'over "Ball"\n{{\ndouble radius = {radius}\ncolor3f[] primvars:displayColor = [(1, 0, 0)]\n}}'
        stage = scene(tmp_path, many(kind, 6, more=own), lit=True)
        loaded = load(stage, look=True)
        assert [problem.code for problem in loaded.problems] == codes
        lines = [1 + stage.read_text().splitlines().index(f"double radius = {radius}")] if codes else []
        assert [problem.line for problem in loaded.problems] == lines
    looks = [
        (round(np.ptp(entry.occluder.vertices_mm[:, 0])), entry.finish.materials[0].diffuse_color.value)
        for entry in loaded.dataset.occluders
    ]
    assert len(looks) == 6 and looks.count((4, (1.0, 0.0, 0.0))) == 1 and len(set(looks)) == 2


def test_a_scheme_that_is_a_sample_counts():
    square = mesh([4], [0, 1, 2, 3], [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    square.GetSubdivisionSchemeAttr().Clear()
    square.GetSubdivisionSchemeAttr().Set("none", 1.0)
    assert len(drawn(square.GetPrim()).corners) == 2


def test_a_tolerance_in_mm_decides_how_fine_it_is():
    made = mesh(*CUBE)
    made.GetPrim().ApplyAPI("PlenOccluderAPI")
    counts = []
    for tolerance in (0.2, 0.02, 0.002):
        made.GetPrim().GetAttribute("plen:tolerance").Set(tolerance)
        counts.append(len(drawn(made.GetPrim()).triangles))
    assert counts == [48, 768, 12288]


def test_left_handed_faces_are_turned_with_their_normals():
    made = mesh(*CUBE)
    right = drawn(made.GetPrim())
    made.CreateOrientationAttr("leftHanded")
    left = drawn(made.GetPrim())
    assert volume(left) == pytest.approx(-volume(right)) and np.array_equal(left.normals, -right.normals)


def test_holes_support_their_neighbours_and_open_boundaries_only_support():
    n = 5
    faces = [(n * i + j, n * (i + 1) + j, n * (i + 1) + j + 1, n * i + j + 1) for i in range(4) for j in range(4)]
    points = [(i, j, i * j % 3) for i in range(n) for j in range(n)]
    made = mesh([4] * 16, [v for face in faces for v in face], points)
    whole = drawn(made.GetPrim())
    made.CreateHoleIndicesAttr([5])
    with_hole = drawn(made.GetPrim())
    assert np.array_equal(with_hole.points, whole.points)
    assert set(with_hole.faces.tolist()) == set(range(16)) - {5}
    made.CreateInterpolateBoundaryAttr("none")
    assert set(drawn(made.GetPrim()).faces.tolist()) == {6, 9, 10}


@pytest.mark.parametrize("scheme", ["catmullClark", "bilinear", "loop", "none"])
@pytest.mark.parametrize("interpolation", ["vertex", "varying", "faceVarying", "uniform", "constant"])
def test_primvars_that_are_linear_in_space_stay_so_where_the_surface_is_flat(scheme: str, interpolation: str):
    """A flat regular patch inside a boundary: B-splines and box splines reproduce linear functions."""
    n = 7
    quads = [(n * i + j, n * (i + 1) + j, n * (i + 1) + j + 1, n * i + j + 1) for i in range(6) for j in range(6)]
    faces = [part for a, b, c, d in quads for part in ((a, b, d), (b, c, d))] if scheme == "loop" else quads
    points = [(i, j, 0) for i in range(n) for j in range(n)]
    indices = [v for face in faces for v in face]
    made = mesh([len(face) for face in faces], indices, points, scheme)
    made.GetPrim().ApplyAPI("PlenOccluderAPI")
    shape, xy = drawn(made.GetPrim()), np.array(points)[:, :2].astype(float)
    values = {"uniform": np.arange(len(faces))[:, None], "constant": np.array([[3.0]]), "faceVarying": xy[indices]}
    carried = shape.at_corners(values.get(interpolation, xy), interpolation, np.array(indices))
    corners = shape.points[shape.triangles][:, :, :2]
    inside = ((corners > 1.01) & (corners < 4.99)).all(axis=(1, 2))
    if interpolation == "uniform":
        assert np.array_equal(carried[..., 0], np.repeat(shape.faces[:, None], 3, axis=1))
    elif interpolation == "constant":
        assert (carried == 3).all()
    else:
        np.testing.assert_allclose(carried[inside], corners[inside], rtol=0, atol=1e-12)


def test_face_varying_values_keep_their_seams_and_follow_the_vertices_elsewhere():
    """With one value for each vertex they are vertex values; without indices each face is a sheet of its own."""
    made = mesh(*CUBE)
    shape, values = drawn(made.GetPrim()), np.arange(8.0)[:, None]
    indices = np.array(CUBE[1])
    joined = shape.at_corners(values[indices], "faceVarying", indices)
    np.testing.assert_allclose(joined, shape.at_corners(values, "vertex"), rtol=0, atol=1e-12)
    alone = shape.at_corners(values[indices], "faceVarying")
    assert (alone.min(), alone.max()) == (0, 7) and joined.max() < 6.5
    made.CreateFaceVaryingLinearInterpolationAttr("all")
    linear = drawn(made.GetPrim()).at_corners(values[indices], "faceVarying", indices)
    np.testing.assert_allclose(linear, drawn(made.GetPrim()).at_corners(values, "varying"), rtol=0, atol=1e-12)


def test_creases_of_the_stage_are_sharp():
    made = mesh(*CUBE)
    made.CreateCreaseIndicesAttr([4, 5, 7, 6, 4])
    made.CreateCreaseLengthsAttr([5])
    made.CreateCreaseSharpnessesAttr([10.0])
    made.CreateCornerIndicesAttr([0])
    made.CreateCornerSharpnessesAttr([10.0])
    points = drawn(made.GetPrim()).points
    assert points[:, 2].max() == pytest.approx(1, abs=1e-12) and np.linalg.norm(points + 1, axis=1).min() < 1e-12
    rim = points[points[:, 2] > 1 - 1e-12]  # a closed cubic B-spline of four vertices, and what it encloses
    assert np.abs(rim[:, :2]).max() == pytest.approx(44 / 48, abs=1e-12)


@pytest.mark.parametrize(
    ("counts", "indices", "triangles", "word"),
    [
        ([4, 4], [0, 1, 2, 3, 0], 2, "name 8 corners"),
        ([3, 3], [0, 1, 2, 0, 1, 9], 1, "not among"),
        ([3, 2], [0, 1, 2, 0, 1], 1, "fewer than three"),
        ([3, 4], [0, 1, 2, 0, 0, 2, 3], 2, ""),
        ([], [], 0, "nothing is drawn"),
    ],
)
def test_faces_that_cannot_be_drawn_are_named_and_the_others_are_drawn(counts, indices, triangles, word):
    shape = drawn(mesh(counts, indices, [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], "none").GetPrim())
    assert len(shape.triangles) == triangles and word in " ".join(shape.flaws) and bool(shape.flaws) == bool(word)


@pytest.mark.parametrize("scheme", ["catmullClark", "loop"])
def test_what_has_no_rule_is_drawn_as_its_polygons(scheme: str):
    shape = drawn(mesh([3, 3, 4], [0, 1, 2, 0, 1, 3, 1, 0, 4, 5], np.eye(6, 3), scheme).GetPrim())
    assert len(shape.triangles) == 4 and "not subdivided" in shape.flaws[0]


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
@pytest.mark.parametrize("kind", ["Sphere", "Cube", "Cylinder", "Cylinder_1", "Cone", "Capsule", "Capsule_1", "Plane"])
def test_solids_fill_the_extent_that_usd_computes(kind: str, axis: str):
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/P", kind)
    for name, value in {"radius": 1.5, "radiusTop": 0.5, "radiusBottom": 1.25, "height": 3.0, "size": 2.5}.items():
        if prim.HasAttribute(name):
            prim.GetAttribute(name).Set(value)
    if prim.HasAttribute("axis"):
        prim.GetAttribute("axis").Set(axis)
    shape = drawn(prim)
    low, high = UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(prim), Usd.TimeCode.Default())
    extent = np.array([low, high])
    if kind != "Capsule_1":  # of which USD takes the larger radius at both ends
        np.testing.assert_allclose([shape.points.min(axis=0), shape.points.max(axis=0)], extent, rtol=0, atol=6e-3)
    top = shape.points[np.argmax(shape.points[:, "XYZ".index(axis)])]
    if kind == "Cone":
        np.testing.assert_allclose(np.delete(top, "XYZ".index(axis)), 0, atol=1e-12)
    assert shape.st is not None and shape.st.min() == 0 and shape.st.max() == 1


SOLID_CUBE = [(1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1), (-1, -1, -1), (-1, 1, -1), (1, 1, -1), (1, -1, -1)]
"""Vertices of a cube in OpenUSD's geomUtil/cuboidMeshGenerator.cpp, and its faces."""
SIDES = [(0, 1, 2, 3), (4, 5, 6, 7), (0, 6, 5, 1), (4, 7, 3, 2), (0, 3, 7, 6), (4, 2, 1, 5)]


def test_sides_and_corners_of_a_cube_are_counted_as_renderers_of_usd_count_them():
    stage = Usd.Stage.CreateInMemory()
    shape = drawn(UsdGeom.Cube.Define(stage, "/Cube").GetPrim())
    places = shape.points[shape.triangles]
    np.testing.assert_array_equal(shape.at_corners(np.array(SOLID_CUBE, float), "vertex"), places)
    sides = shape.at_corners(np.arange(6.0)[:, None], "uniform")[:, 0, 0].astype(int)
    assert sorted(sides) == sorted([*range(6)] * 2)
    for number, corners in zip(sides, places.tolist(), strict=True):
        assert {tuple(corner) for corner in corners} < {SOLID_CUBE[vertex] for vertex in SIDES[number]}


@pytest.mark.parametrize(("kind", "count"), [("Cube", 5), ("Sphere", 2)])
def test_colours_of_faces_that_a_solid_does_not_have_are_named(kind: str, count: int, tmp_path):
    colours = ", ".join(["(1, 0, 0)"] * (count - 1) + ["(0, 1, 0)"])
    content = f'def {kind} "Thing"\n{{\ncolor3f[] primvars:displayColor = [{colours}] (interpolation = "uniform")\n}}\n'
    [problem] = load(scene(tmp_path, content, lit=True)).problems
    assert problem.code == "not-drawn" and f"{count} values, which do not fit" in problem.message


def scene(folder, content: str, end: int = 1, lit: bool = False):
    path = folder / "scene.usda"
    sun = '        def DistantLight "Sun"\n        {\n        }\n' if lit else ""
    things = f'def Xform "Things"\n{{\n{placed(0, 0, -450)}\n{sun}{content}}}'
    stage = in_the_library(things, board=placed(0, 0, -500), occluders="/Scene/Things", end=end)
    path.write_text(stage, encoding="utf-8")
    return path


MANY = """
        def PointInstancer "Many"
        {
            rel prototypes = [</Scene/Things/Many/Protos/Plate>, </Scene/Things/Many/Box>]
            int[] protoIndices = [0, 1, 0, 1]
            point3f[] positions.timeSamples = {
                1: [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)],
                2: [(0, 0, 5), (1, 0, 5), (2, 0, 5), (3, 0, 5)],
            }
            float3[] scales = [(1, 1, 1), (2, 1, 1), (1, 1, 1), (1, 1, 3)]
            quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), (0.70710678, 0, 0, 0.70710678), (1, 0, 0, 0)]
            int64[] ids = [5, 6, 7, 8]
            int64[] invisibleIds.timeSamples = {
                1: [],
                2: [7],
            }

            def Scope "Protos"
            {
                def Plane "Plate"
                {
                    double width = 4
                }
            }

            def Cube "Box"
            {
                double size = 1
                double3 xformOp:translate = (10, 0, 0)
                uniform token[] xformOpOrder = ["xformOp:translate"]
            }
        }
"""


@pytest.mark.parametrize("kind", ["Scope ", ""])
def test_instances_are_prims_where_usd_puts_them_in_the_frames_in_which_they_are_there(kind: str, tmp_path):
    loaded = load(scene(tmp_path, MANY.replace("Scope ", kind), 2))
    assert loaded.problems == []
    dataset = loaded.dataset
    assert [len(list(dataset.occluders_in(frame))) for frame in dataset.frames] == [4, 3]
    boxes = []
    for frame in dataset.frames:
        for entry in dataset.occluders_in(frame):
            corners = entry.occluder.corners_mm().reshape(-1, 3)
            pose = np.array(frame.world_from_occluder[entry.prim_path])
            boxes.append(np.ptp(corners @ pose[:3, :3].T, axis=0).round(3).tolist())
    assert boxes == [[4, 2, 0], [2, 1, 1], [2, 4, 0], [1, 1, 3], [4, 2, 0], [2, 1, 1], [1, 1, 3]]
    second = dataset.frames[1].world_from_occluder["/Scene/Things/Many/Instance_1/Shape"]
    np.testing.assert_allclose(np.array(second)[:3, 3], (1 + 2 * 10, 0, -450 + 5), rtol=0, atol=1e-12)


def test_colours_of_instances_are_those_of_the_frame_and_follow_their_ids(tmp_path):
    flock = """def PointInstancer "Flock"
    {
        rel prototypes = </Scene/Things/Flock/Ball>
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 0), (9, 0, 0)]
        int64[] ids.timeSamples = {
            1: [5, 6],
            2: [6, 5],
        }
        color3f[] primvars:displayColor (
            interpolation = "vertex"
        )
        color3f[] primvars:displayColor.timeSamples = {
            1: [(0.1, 0, 0), (0.2, 0, 0)],
            2: [(0.2, 0, 0), (0.4, 0, 0)],
        }

        def Sphere "Ball"
        {
        }
    }
    """
    five, six = [], []
    for entry in load(scene(tmp_path, flock, 2, lit=True)).dataset.occluders:
        finish = entry.finish
        colour = finish.primvars["displayColor"][0] if finish.primvars else finish.materials[0].diffuse_color.value
        (five if "Instance_0" in entry.prim_path else six).append((entry.frame, round(colour[0], 6)))
    assert (five, six) == ([(1, 0.1), (2, 0.4)], [(None, 0.2)])


def test_prototypes_have_the_primvars_of_scopes_between_them_and_their_instancer(tmp_path):
    """Those of all instances, and nothing of the scope on what has its own."""
    red = 'color3f[] primvars:displayColor = [(1, 0, 0)]\n\ndef Plane "Plate"'
    dataset = load(scene(tmp_path, MANY.replace('def Plane "Plate"', red), 2, lit=True)).dataset
    colours = {each.prim_path[-7:-6]: each.finish.materials[0].diffuse_color.value for each in dataset.occluders}
    assert colours == {"0": (1, 0, 0), "1": (0.18, 0.18, 0.18), "2": (1, 0, 0), "3": (0.18, 0.18, 0.18)}


def test_too_few_colours_of_instances_are_named(tmp_path):
    few = 'color3f[] primvars:displayColor = [(1, 0, 0)] (\ninterpolation = "vertex"\n)\nint[] protoIndices'
    loaded = load(scene(tmp_path, MANY.replace("int[] protoIndices", few), 2, lit=True))
    [problem] = loaded.problems
    assert (problem.code, problem.at) == ("not-drawn", "/Scene/Things/Many.primvars:displayColor")
    assert "too few values for 4 instances" in problem.message


@pytest.mark.parametrize(
    ("schema", "line", "name"),
    [
        ("GeomModelAPI", 'token model:drawMode = "cards"', "model:drawMode"),
        ("ColorSpaceAPI", 'uniform token colorSpace:name = "lin_ap1_scene"', "colorSpace:name"),
        (
            "GeomModelAPI",
            'color3f[] primvars:displayColor = [(1, 0, 0)] (colorSpace = "lin_ap1_scene")',
            "primvars:displayColor",
        ),
    ],
)
def test_what_has_no_effect_on_a_thing_is_named(schema: str, line: str, name: str, tmp_path):
    content = f'def Sphere "Ball" (prepend apiSchemas = ["{schema}"])\n{{\n{line}\n}}\n'
    loaded = load(scene(tmp_path, content))
    assert [(each.code, each.at) for each in loaded.problems] == [("not-drawn", f"/Scene/Things/Ball.{name}")]


RED = material_text("/Scene/Things/Red", "color3f inputs:diffuseColor = (1, 0, 0)")


@pytest.mark.parametrize("is_collection", [False, True])
def test_instances_have_the_materials_that_their_prototypes_have_by_prims_above_them(is_collection: bool, tmp_path):
    """The scope with the prototypes is bound, or a collection of the instancer names one of them."""
    collection = """prepend rel collection:red:includes = </Scene/Things/Many/Protos/Plate>
            rel material:binding:collection:red = [</Scene/Things/Many.collection:red>, </Scene/Things/Red>]
            rel prototypes"""
    bound = MANY.replace('"Protos"\n', '"Protos"\n(prepend apiSchemas = ["MaterialBindingAPI"])\n')
    bound = bound.replace("def Plane", "rel material:binding = </Scene/Things/Red>\n\ndef Plane")
    if is_collection:
        apis = '"Many"\n(prepend apiSchemas = ["CollectionAPI:red", "MaterialBindingAPI"])\n'
        bound = MANY.replace('"Many"\n', apis).replace("rel prototypes", collection)
    dataset = load(scene(tmp_path, bound + RED, 2, lit=True)).dataset
    colours = {each.prim_path[-7:-6]: each.finish.materials[0].diffuse_color.value for each in dataset.occluders}
    assert colours == {"0": (1, 0, 0), "1": (0.18, 0.18, 0.18), "2": (1, 0, 0), "3": (0.18, 0.18, 0.18)}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("protoIndices = [0, 1, 0, 1]", "protoIndices = [0, 1, 0, 9]", "protoIndices names prototype 9, of 2"),
        ("scales = [(1, 1, 1)", "scales = [(1, nan, 1)", "instance 0 is not finite"),
        ("scales = [(1, 1, 1), ", "scales = [", '"scales" has 3 values for 4 instances'),
        ("orientations = [(1, 0, 0, 0), ", "orientations = [", '"orientations" has 3 values for 4 instances'),
        ("2: [(0, 0, 5), (1, 0, 5), (2, 0, 5), (3, 0, 5)]", "2: []", '"positions" has 0 values for 4 instances'),
        ("int64[] ids", "number[] ids", "another type"),
    ],
)
def test_instances_that_are_wrong_have_a_warning(tmp_path, old, new, words):
    """In a file of others. USD itself reads beyond the end of arrays that are too short."""
    many = MANY.replace("Scene/Things", "Top").replace(old, new)
    (tmp_path / "many.usda").write_text(f'{head("Top")}def Xform "Top"\n{{\n{many}}}\n')
    loaded = load(scene(tmp_path, 'def "Others" (prepend references = @many.usda@)\n{\n}\n', 2))
    assert loaded.errors == [] and loaded.dataset.occluders == ()
    [warning] = [each for each in loaded.problems if each.code == "not-drawn"]
    assert warning.at == "/Scene/Things/Others/Many" and words in warning.message


def test_instances_have_a_limit(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, "instances=3")
    (error,) = load(scene(tmp_path, MANY, 2)).errors
    assert error.code == "over-limit" and "instances=4" in error.hint


def test_an_edit_of_an_instancer_whose_instances_are_written_out_has_a_warning(tmp_path):
    """In the dataset.usda of a build instances are there already: without an edit they are those of the instancer."""
    built = stage_in(tmp_path, load(scene(tmp_path, MANY, 2)).flattened)
    assert load(built).problems == []
    text = built.read_text(encoding="utf-8")
    for old, new in [
        ("(0, 0, 5), (1, 0, 5)", "(0, 0, 5), (1.5, 0, 5)"),
        ("(2, 1, 1)", "(2, 1, 2)"),
    ]:
        assert text.count(old) == 1
        built.write_text(text.replace(old, new), encoding="utf-8")
        (warning,) = load(built).problems
        assert (warning.code, warning.at) == ("not-drawn", "/Scene/Things/Many")


ARM = """
        def SkelRoot "Hero" (
            prepend apiSchemas = ["SkelBindingAPI"]
        )
        {
            rel skel:animationSource = </Scene/Things/Hero/Moves>
            rel skel:skeleton = </Scene/Things/Hero/Bones>

            def Skeleton "Bones" (
                prepend apiSchemas = ["SkelBindingAPI"]
            )
            {
                uniform token[] joints = ["Root", "Root/Elbow"]
                uniform matrix4d[] bindTransforms = [( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1) ),
                    ( (1,0,0,0), (0,1,0,0), (0,0,1,0), (10,0,0,1) )]
                uniform matrix4d[] restTransforms = [( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1) ),
                    ( (1,0,0,0), (0,1,0,0), (0,0,1,0), (10,0,0,1) )]
            }

            def SkelAnimation "Moves"
            {
                uniform token[] joints = ["Root", "Root/Elbow"]
                uniform token[] blendShapes = ["Thick"]
                float[] blendShapeWeights.timeSamples = {
                    0.5: [0],
                    4.5: [1],
                }
                quatf[] rotations.timeSamples = {
                    0.5: [(1, 0, 0, 0), (1, 0, 0, 0)],
                    4.5: [(1, 0, 0, 0), (0.70710678, 0, 0, 0.70710678)],
                }
                half3[] scales = [(1, 1, 1), (1, 1, 1)]
                float3[] translations = [(0, 0, 0), (10, 0, 0)]
            }

            def Mesh "Skin" (
                prepend apiSchemas = ["SkelBindingAPI"]
            )
            {
                int[] faceVertexCounts = [3]
                int[] faceVertexIndices = [0, 1, 2]
                point3f[] points = [(0, 0, 0), (20, 0, 0), (20, 2, 0)]
                normal3f[] primvars:normals = [(0, 1, 0), (0, 1, 0), (0, 1, 0)] (
                    interpolation = "vertex"
                )
                int[] primvars:skel:jointIndices = [0, 1, 1] (
                    elementSize = 1
                    interpolation = "vertex"
                )
                float[] primvars:skel:jointWeights = [1, 1, 1] (
                    elementSize = 1
                    interpolation = "vertex"
                )
                uniform token[] skel:blendShapes = ["Thick"]
                rel skel:blendShapeTargets = </Scene/Things/Hero/Skin/Thick>
                uniform token subdivisionScheme = "none"

                def BlendShape "Thick"
                {
                    uniform vector3f[] offsets = [(0, 0, 4)]
                    uniform int[] pointIndices = [0]
                }
            }
        }
"""


def test_a_skeleton_moves_points_and_normals_and_blend_shapes_add_to_them_at_each_frame(tmp_path):
    """The elbow at (10, 0, 0) turns about z by 90 degrees from 0.5 to 4.5, and the shape grows; in closed form."""
    loaded = load(scene(tmp_path, ARM, 4, lit=True))
    assert loaded.problems == [] or {problem.code for problem in loaded.problems} <= {"unlit"}
    for frame in loaded.dataset.frames:
        (entry,) = loaded.dataset.occluders_in(frame)
        share = (frame.number - 0.5) / 4
        c, s = np.cos(share * np.pi / 2), np.sin(share * np.pi / 2)
        expected = [(0, 0, 4 * share), (10 + 10 * c, 10 * s, 0), (10 + 10 * c - 2 * s, 10 * s + 2 * c, 0)]
        np.testing.assert_allclose(entry.occluder.vertices_mm, expected, rtol=0, atol=2e-6)
        np.testing.assert_allclose(entry.finish.normals[0], (0, 1, 0, -s, c, 0, -s, c, 0), rtol=0, atol=2e-6)


@pytest.mark.parametrize("is_before", [False, True])
@pytest.mark.parametrize("kind", ["copy", "instances"])
def test_each_of_several_that_are_one_character_moves_once(kind: str, is_before: bool, tmp_path):
    """A copy whose animation keeps the elbow straight, or two instances; elbows of the others turn by 45 degrees."""
    straight = 'over "Moves"\n{\nquatf[] rotations = [(1, 0, 0, 0), (1, 0, 0, 0)]\n}'
    copy = f'def "Copy" (references = </Scene/Things/Hero>)\n{{\n{straight}\n}}\n'
    crowd = (
        'def PointInstancer "Crowd"\n{\nint[] protoIndices = [0, 0]\npoint3f[] positions = [(0, 0, 0), (0, 50, 0)]\n'
        "rel prototypes = </Scene/Things/Hero>\n}\n"
    )
    more = copy if kind == "copy" else crowd
    loaded = load(scene(tmp_path, (more + ARM if is_before else ARM + more).replace("4.5", "3.5"), 2))
    assert loaded.problems == []
    tips = {one.prim_path: one.occluder.vertices_mm[1] for one in loaded.dataset.occluders_in(loaded.dataset.frames[1])}
    bent = (10 + 50**0.5, 50**0.5, 0)
    wanted = {"Hero": bent, "Copy": (20, 0, 0), "Instance_0": bent, "Instance_1": bent}
    assert len(tips) == (2 if kind == "copy" else 3)
    for path, tip in tips.items():
        name = next(part for part in path.split("/") if part in wanted)
        np.testing.assert_allclose(tip, wanted[name], rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("[0, 1, 1] (", "[0, 1, 2] (", "not-drawn"),
        ("float[] blendShapeWeights.", "int[] blendShapeWeights.", "wrong-type"),
    ],
)
def test_what_usd_cannot_move_is_named(tmp_path, old, new, code):
    """A joint that is not there, and weights of a type that USD does not take."""
    assert code in {problem.code for problem in load(scene(tmp_path, ARM.replace(old, new), 2)).problems}


@pytest.mark.parametrize("content", [MANY, ARM])
def test_the_stage_of_a_build_has_the_same_shapes(content: str, tmp_path):
    """What was written out is in it, and is not written out again."""
    loaded = load(scene(tmp_path, content, 2))
    copy = tmp_path / "copy.usda"
    copy.write_text(loaded.flattened, encoding="utf-8")
    again = load(copy)
    assert again.errors == [] and again.dataset.occluders == loaded.dataset.occluders
    assert again.dataset.frames == loaded.dataset.frames


@pytest.mark.parametrize("content", [MANY, ARM])
def test_time_codes_of_what_is_written_out_are_those_of_the_stage_at_any_rate(content: str, tmp_path):
    text = Usd.Stage.Open(str(scene(tmp_path, content, 2))).ExportToString()
    assert "timeCodesPerSecond = 24" in text
    usual, fast = (tmp_path / f"{rate}.usda" for rate in (24, 1000))
    usual.write_text(text, encoding="utf-8")
    fast.write_text(text.replace("timeCodesPerSecond = 24", "timeCodesPerSecond = 1000"), encoding="utf-8")
    datasets = [load(path).dataset for path in (usual, fast)]
    assert datasets[0].occluders == datasets[1].occluders and datasets[0].frames == datasets[1].frames
    assert datasets[0].frames[0].world_from_occluder != datasets[0].frames[1].world_from_occluder or content == ARM


SLIDE = """def Mesh "Slide"
    {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points.timeSamples = {
            1: [(0, 0, 0), (1, 0, 0), (0, 1, 0)],
            3: [(90, 0, 0), (91, 0, 0), (90, 1, 0)],
        }
        uniform token subdivisionScheme = "none"
        vector3f[] velocities.timeSamples = {
            1: [(72, 0, 0), (72, 0, 0), (72, 0, 0)],
            3: [(0, 0, 0), (0, 0, 0), (0, 0, 0)],
        }
    }
"""


@pytest.mark.parametrize(("velocities", "x_mm"), [("(72, 0, 0), (72, 0, 0), (72", 3), ("(72, 0, 0), (72", 45)])
def test_a_mesh_with_velocities_moves_by_them_between_its_samples(velocities: str, x_mm: float, tmp_path):
    """As USD's documentation has it: 72 mm/s are 3 mm in a frame of 1 / 24 s. Those that do not fit its points are
    named, and points are interpolated.
    """
    loaded = load(scene(tmp_path, SLIDE.replace("(72, 0, 0), (72, 0, 0), (72", velocities), 3))
    assert [each.code for each in loaded.problems] == ["not-drawn"] * (x_mm == 45)
    assert [entry.occluder.vertices_mm[0][0] for entry in loaded.dataset.occluders] == [0, x_mm, 90]


def test_only_an_edited_frame_changes_and_a_still_shape_is_one_for_all(tmp_path):
    heights = ", ".join(f"{n}: [(0, 0, 0), (1, 0, 0), (0, {n}, 0)]" for n in (1, 2, 3))
    flag = mesh_text("Flag", [(0, 0, 0)] * 3, f"point3f[] points.timeSamples = {{{heights}}}")
    moving = f'{flag}def Sphere "Ball"\n{{\ndouble radius = 3\n}}\n'
    before = load(scene(tmp_path, moving, 3)).dataset.occluders
    after = load(scene(tmp_path, moving.replace("(0, 2, 0)", "(0, 2.5, 0)"), 3)).dataset.occluders
    assert [entry.frame for entry in before] == [1, 2, 3, None]
    assert [a == b for a, b in zip(before, after, strict=True)] == [True, False, True, True]
    assert replace(before[0], frame=2).occluder != before[1].occluder


@pytest.mark.parametrize("is_inherited", [False, True])
def test_an_animated_display_colour_is_that_of_the_frame(is_inherited: bool, tmp_path):
    colours = "color3f[] primvars:displayColor.timeSamples = {\n1: [(1, 0, 0)],\n2: [(0, 0, 1)],\n}\n"
    ball = f'def Sphere "Ball"\n{{\n{"" if is_inherited else colours}}}\n'
    content = f'def Xform "Group"\n{{\n{colours if is_inherited else ""}{ball}}}\n'
    dataset = load(scene(tmp_path, content, 2, lit=True)).dataset
    drawn_colours = [entry.finish.primvars["displayColor"][0, :3].tolist() for entry in dataset.occluders]
    assert drawn_colours == [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    assert {entry.finish.materials[0].diffuse_color.primvar for entry in dataset.occluders} == {"displayColor"}


def test_colours_that_are_empty_at_first_are_those_of_the_frame(tmp_path):
    """As OpenUSD's testUsdImagingGLColorOpacityPrimvar has them, whose mesh has no points then either."""
    samples = {
        "int[] faceVertexCounts": ("[]", "[3]"),
        "int[] faceVertexIndices": ("[]", "[0, 1, 2]"),
        "point3f[] points": ("[]", "[(0, 0, 0), (1, 0, 0), (0, 1, 0)]"),
        'color3f[] primvars:displayColor (interpolation = "vertex")\ncolor3f[] primvars:displayColor': (
            "[]",
            "[(1, 0, 0), (0, 1, 0), (0, 0, 1)]",
        ),
    }
    flag = "\n".join(f"{name}.timeSamples = {{\n1: {one},\n2: {two},\n}}" for name, (one, two) in samples.items())
    content = f'def Mesh "Flag"\n{{\nuniform token subdivisionScheme = "none"\n{flag}\n}}\n'
    [entry] = load(scene(tmp_path, content, 2, lit=True)).dataset.occluders
    assert (entry.frame, entry.finish.primvars["displayColor"].tolist()) == (2, [[1, 0, 0, 0, 1, 0, 0, 0, 1]])


def test_of_subsets_that_share_a_face_the_first_counts(tmp_path):
    """As in OpenUSD's testUsdImagingGLGeomSubsets."""
    red, none = "\nrel material:binding = </Scene/Things/Red>", ""
    subsets = "".join(
        f'def GeomSubset "Part{n}" (prepend apiSchemas = ["MaterialBindingAPI"])\n{{\n'
        f'uniform token familyName = "materialBind"\nint[] indices = [0]{bound}\n}}\n'
        for n, bound in enumerate((red, none))
    )
    flag = mesh_text("Flag", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], subsets)
    [entry] = load(scene(tmp_path, flag + RED, lit=True)).dataset.occluders
    assert entry.finish.materials[entry.finish.material_of[0]].diffuse_color.value == (1, 0, 0)


def test_indices_of_colours_that_are_not_there_are_named(tmp_path):
    colours = "color3f[] primvars:displayColor = [(1, 0, 0)]\nint[] primvars:displayColor:indices = [0, 7]\n"
    loaded = load(scene(tmp_path, f'def Sphere "Ball"\n{{\n{colours}}}\n', lit=True))
    assert [(each.code, "indices of values" in each.message) for each in loaded.problems] == [("not-drawn", True)]


def test_several_colours_of_a_whole_shape_are_named(tmp_path):
    """Those of an exporter that forgot their interpolation."""
    colours = "color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]"
    loaded = load(scene(tmp_path, mesh_text("Flag", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], colours), lit=True))
    assert [(each.code, "3 values and is constant" in each.message) for each in loaded.problems] == [
        ("not-drawn", True)
    ]
    [entry] = loaded.dataset.occluders
    assert entry.finish.primvars["displayColor"].tolist() == [[1, 0, 0] * 3]


def test_animated_faces_of_a_subset_are_named(tmp_path):
    subset = """def GeomSubset "Part"
    {
        uniform token familyName = "materialBind"
        int[] indices.timeSamples = {
            1: [0],
            2: [],
        }
    }
    """
    flag = mesh_text("Flag", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], subset)
    (warning,) = load(scene(tmp_path, flag, 2, lit=True)).problems
    assert (warning.code, warning.at) == ("not-drawn", "/Scene/Things/Flag/Part.indices")


def test_what_is_not_drawn_is_named_prim_by_prim(tmp_path):
    kinds = ["BasisCurves", "Points", "NurbsPatch", "TetMesh", "HermiteCurves", "Volume"]
    content = "".join(f'        def {kind} "{kind}{n}"\n        {{\n        }}\n' for kind in kinds for n in (1, 2))
    problems = load(scene(tmp_path, content)).problems
    assert {(problem.severity, problem.code) for problem in problems} == {("warning", "not-drawn")}
    assert [problem.at for problem in problems] == [f"/Scene/Things/{kind}{n}" for kind in kinds for n in (1, 2)]


def test_an_animated_radius_is_that_of_the_frame():
    stage = Usd.Stage.CreateInMemory()
    ball = UsdGeom.Sphere.Define(stage, "/Ball")
    for time in (1.0, 2.0):
        ball.GetRadiusAttr().Set(3 * time, time)
    assert is_animated(ball.GetPrim())
    assert [np.abs(drawn(ball.GetPrim(), time).points).max() for time in (1.0, 2.0)] == [3.0, 6.0]
