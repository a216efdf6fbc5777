"""A stage reads only what lies below its project, the library, and what the caller allows."""

import itertools

import pytest
from pxr import Ar, Sdf

from pipeline.scene.load import load
from pipeline.scene.usd.roots import allowed_roots, library_path, register

HEAD = '#usda 1.0\n(\n    defaultPrim = "A"\n    metersPerUnit = 0.001\n    upAxis = "Y"\n{more})\n'
PART = HEAD.format(more="") + 'def Xform "A"\n{\n}\n'
ARCS = {
    "sublayer": ("    subLayers = [{asset}]\n", ""),
    "sublayer with an offset": ("    subLayers = [{asset} (offset = 3)]\n", ""),
    "reference": ("", 'def "A" (\n    references = {asset}\n)\n{{\n}}\n'),
    "payload": ("", 'def "A" (\n    append payload = {asset}</A> (offset = 3)\n)\n{{\n}}\n'),
    "variant": (
        "",
        'def "A" (\n    variants = {{\n        string v = "b"\n    }}\n    prepend variantSets = "v"\n)\n{{\n'
        '    variantSet "v" = {{\n        "a" {{\n        }}\n        "b" (\n            references = {asset}\n'
        "        ) {{\n        }}\n    }}\n}}\n",
    ),
}
OUTSIDE = {
    "relative": "../outside/part.usda",
    "absolute": "{outside}/part.usda",
    "dots": "./sub/..//../outside/./part.usda",
    "link": "./link.usda",
    "link beside the root layer": "link.usda",
    "folder that is a link": "./folder/part.usda",
    "folder with brackets": "./x[1]/part.usda",
    "arguments": "../outside/part.usda:SDF_FORMAT_ARGS:a=b",
    "member": "../outside/part.usdz[in.usda]",
    "member of a link": "./link.usdz[in.usda]",
}
INSIDE = (
    *("./part.usda", "part.usda", "../project/part.usda", "./y[1]/part.usda"),
    *("./p.usdz", "./p.usdz[in.usda]", "p.usdz[in.usda]", "./y[1]/p.usdz[in.usda]"),
)


@pytest.fixture
def places(tmp_path):
    """A project with links that lead out, and the folder that they lead to."""
    project, outside = tmp_path / "project", tmp_path / "outside"
    (project / "sub").mkdir(parents=True)
    (project / "pipeline.toml").touch()
    outside.mkdir()
    (outside / "part.usda").write_text(PART)
    package(outside / "part.usdz", PART)
    for name in ("part.usda", "part.usdz"):
        (project / name.replace("part", "link")).symlink_to(outside / name)
    for name in ("folder", "x[1]"):
        (project / name).symlink_to(outside)
    return project, outside


def package(path, text):
    member = path.parent / "in.usda"
    member.write_text(text)
    with Sdf.ZipFileWriter.CreateNew(str(path)) as archive:
        archive.AddFile(str(member), "in.usda")
    member.unlink()


def stage(folder, asset, arc="reference"):
    more, body = ARCS[arc]
    path = folder / "s.usda"
    path.write_text((HEAD.format(more=more) + body).format(asset=f"@{asset}@"))
    return path


def test_a_file_outside_is_refused_at_the_line_that_names_it_however_it_is_spelt(places):
    project, outside = places
    for arc, (spelling, asset) in itertools.product(ARCS, OUTSIDE.items()):
        path = stage(project, asset.format(outside=outside), arc)
        (problem,) = load(path).problems
        assert (problem.code, problem.file) == ("asset-outside", str(path)), (arc, spelling)
        assert "@" in path.read_text().splitlines()[problem.line - 1], (arc, spelling)
        assert "--allow-root" in problem.hint
        assert load(path, allow_roots=[outside]).errors == [], (arc, spelling)


def test_every_file_outside_is_told_at_once(places):
    project, _ = places
    path = project / "s.usda"
    path.write_text(
        HEAD.format(more="    subLayers = [\n        @./link.usda@,\n        @../outside/part.usdz@\n    ]\n")
    )

    problems = load(path).problems

    assert sorted((problem.code, problem.line) for problem in problems) == [("asset-outside", 7), ("asset-outside", 8)]


@pytest.mark.parametrize("are_all", [False, pytest.param(True, marks=pytest.mark.heavy)])
def test_files_inside_may_be_named_in_every_way(places, are_all):
    project, _ = places
    (project / "part.usda").write_text(PART)
    (project / "y[1]").symlink_to(project)
    package(project / "p.usdz", PART)
    for asset, arc in itertools.product(INSIDE, ARCS) if are_all else zip(INSIDE, itertools.cycle(ARCS), strict=False):
        loaded = load(stage(project, asset, arc))

        assert loaded.problems == [], (asset, arc)
        assert all(file.is_file() for file in loaded.files), (asset, arc)
        assert len(loaded.files) == 2, (asset, arc)


def test_an_expression_may_name_a_file(places):
    """USD evaluates it, and the roots hold for what it gives."""
    project, _ = places
    (project / "part.usda").write_text(PART)
    for name, codes in (("part", []), ("link", ["asset-outside"])):
        path = stage(project, '`"./${NAME}.usda"`')
        variables = f'    expressionVariables = {{\n        string NAME = "{name}"\n    }}\n)'
        path.write_text(path.read_text().replace(")", variables, 1))
        assert [problem.code for problem in load(path).problems] == codes


def test_the_whole_project_of_a_stage_is_allowed(places):
    (places[0] / "part.usda").write_text(PART)
    assert load(stage(places[0] / "sub", "../part.usda")).problems == []


def test_without_a_project_only_the_folder_of_the_stage_is_allowed(tmp_path):
    (tmp_path / "deep").mkdir()
    project, library, extra = allowed_roots(tmp_path / "deep/scene.usda", [tmp_path])

    assert project == (tmp_path / "deep").resolve()
    assert library.name == "stages"
    assert extra == tmp_path.resolve()


def test_a_search_path_leads_to_the_library_and_to_what_is_allowed(places):
    project, outside = places
    assert load(stage(project, "lenses/double_gauss_100mm_tronnier.usda")).problems == []
    try:
        Ar.DefaultResolver.SetDefaultSearchPath([library_path(), str(outside)])
        assert [problem.code for problem in load(stage(project, "part.usda")).problems] == ["asset-outside"]
        assert load(stage(project, "part.usda"), [outside]).problems == []
    finally:
        register()


def test_a_file_that_is_no_layer_is_told_where_it_is_named_and_why(places):
    (places[0] / "part.usda").write_text("a lens of 1890")
    path = stage(places[0], "./part.usda")
    (problem,) = load(path).problems
    assert (problem.file, "@" in path.read_text().splitlines()[problem.line - 1]) == (str(path), True)
    assert "not a valid usda layer" in problem.message
