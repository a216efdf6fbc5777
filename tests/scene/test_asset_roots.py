"""A stage reads only what lies below its project, the library, and what the caller allows."""

import pytest

from pipeline.roots import allowed_roots
from pipeline.scene.load import load

STAGE = """#usda 1.0
(
    defaultPrim = "Scene"
    metersPerUnit = 0.001
    upAxis = "Y"
)

def Xform "Scene"
{{
    def "Part" (
        prepend references = @{asset}@
    )
    {{
    }}
}}
"""
PART = """#usda 1.0
(
    defaultPrim = "Part"
    metersPerUnit = 0.001
    upAxis = "Y"
)

def Xform "Part"
{
}
"""


@pytest.fixture
def places(tmp_path):
    """A project, and a folder beside it that holds a part."""
    project, outside = tmp_path / "project", tmp_path / "outside"
    (project / "scenes").mkdir(parents=True)
    outside.mkdir()
    (project / "pyproject.toml").write_text("")
    (outside / "part.usda").write_text(PART)
    (project / "part.usda").write_text(PART)
    return project, outside


def stage(project, asset):
    """Write a stage that references an asset."""
    path = project / "scenes/scene.usda"
    path.write_text(STAGE.format(asset=asset))
    return path


def test_the_whole_project_of_a_stage_is_allowed(places):
    assert load(stage(places[0], "../part.usda")).problems == []


@pytest.mark.parametrize("asset", ["../../outside/part.usda", "{outside}/part.usda"])
def test_a_file_outside_is_refused_with_the_line_that_names_it(places, asset):
    project, outside = places

    (problem,) = load(stage(project, asset.format(outside=outside))).problems

    assert (problem.code, problem.line) == ("asset-outside", 11)
    assert "--allow-root" in problem.hint


def test_a_link_that_leads_out_is_refused(places):
    project, outside = places
    (project / "scenes/link.usda").symlink_to(outside / "part.usda")

    assert [problem.code for problem in load(stage(project, "./link.usda")).problems] == ["asset-outside"]


def test_a_caller_can_allow_more(places):
    project, outside = places

    assert load(stage(project, "../../outside/part.usda"), allow_roots=[outside]).problems == []


def test_without_a_project_only_the_folder_of_the_stage_is_allowed(tmp_path):
    (tmp_path / "deep").mkdir()
    project, library, extra = allowed_roots(tmp_path / "deep/scene.usda", [tmp_path])

    assert project == (tmp_path / "deep").resolve()
    assert library.name == "stages"
    assert extra == tmp_path.resolve()


def test_the_library_is_found_by_search_path(places):
    assert load(stage(places[0], "lenses/double_gauss_100mm_tronnier.usda")).problems == []
