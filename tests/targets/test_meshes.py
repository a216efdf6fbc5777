"""Meshes of targets and occluders name vertices that they have."""

import pytest

from pipeline.targets.mesh import MeshTarget, Occluder
from pipeline.targets.patterns.pattern import TargetError

VERTICES = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
WHOLE = (0, 1, 2)
BEYOND = {"behind the last": (0, 1, 3), "before the first": (0, 1, -1)}


def occluder(*triangles: tuple[int, int, int]) -> Occluder:
    return Occluder(vertices_mm=VERTICES, triangles=triangles)


def target(*triangles: tuple[int, int, int]) -> MeshTarget:
    light = ((1.0, 1.0, 1.0),) * len(triangles)
    points = {"points_mm": ((0.25, 0.25, 0.0),), "normals": ((0.0, 0.0, 1.0),)}
    return MeshTarget(vertices_mm=VERTICES, triangles=triangles, albedo=light, **points)


@pytest.mark.parametrize("make", [occluder, target])
def test_one_face_that_names_a_vertex_beyond_the_mesh_is_refused_also_among_others(make) -> None:
    assert len(make(WHOLE).triangles) == 1
    for face in BEYOND.values():
        for faces in ((WHOLE, face), (face, WHOLE)):
            with pytest.raises(TargetError) as error:
                make(*faces)
            assert error.value.code == "bad-mesh" and "beyond the 3 of the mesh" in error.value.what
