"""However a stage spells it, a file outside the allowed folders is neither opened nor quoted nor delivered.

The files outside are FIFOs: whoever opens one waits until somebody else does, and so is found out.
"""

import itertools
import os
import subprocess
import sys
import zipfile

import pytest
from pxr import Ar, Sdf

from pipeline.app.sandbox import problems_of_untrusted
from pipeline.roots import allowed_roots
from pipeline.scene.load import load
from pipeline.scene.trust.asset_roots import check_used
from pipeline.scene.usd.opening import open_stage
from pipeline.scene.usd.register import library_path, register

HEAD = '#usda 1.0\n(\n    defaultPrim = "A"\n    metersPerUnit = 0.001\n    upAxis = "Y"\n{more})\n'
PART = HEAD.format(more="") + 'def Xform "A"\n{\n}\n'
SECRET = HEAD.format(more="") + 'def Xform "A" (\n    doc = "TOPSECRET42"\n)\n{\n}\n'

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

SPELLINGS = {
    "relative": "../outside/secret.usda",
    "absolute": "{outside}/secret.usda",
    "dots": "./sub/..//../outside/./secret.usda",
    "link": "./link.usda",
    "link beside the root layer": "link.usda",
    "folder that is a link": "./folder/secret.usda",
    "folder with brackets": "./x[1]/secret.usda",
    "arguments": "../outside/secret.usda:SDF_FORMAT_ARGS:a=b",
    "link with arguments": "./link.usda:SDF_FORMAT_ARGS:a=b",
    "link with arguments beside the root layer": "link.usda:SDF_FORMAT_ARGS:a=b",
    "member": "../outside/secret.usdz[in.usda]",
    "member of a link": "./link.usdz[in.usda]",
    "member with arguments": "./link.usdz[in.usda]:SDF_FORMAT_ARGS:a=b",
}
EXPRESSIONS = {
    "expression": '`"${{P}}"`',
    "expression without variables": '`"{outside}/secret.usda"`',
    "choice": '`if(true, "{outside}/secret.usda", "")`',
}
INSIDE = (
    *("./part.usda", "part.usda", "../project/part.usda", "./y[1]/part.usda"),
    *("./p.usdz", "./p.usdz[in.usda]", "p.usdz[in.usda]", "./y[1]/p.usdz[in.usda]"),
)

# Ends the wait of whoever opens one of the FIFOs, and leaves a note.
WATCH = """
import os, stat, sys, time
note, *fifos = sys.argv[1:]
while True:
    for fifo in fifos:
        try:
            end = os.open(fifo, os.O_WRONLY | os.O_NONBLOCK)
            if stat.S_ISFIFO(os.fstat(end).st_mode):
                open(note, "w").close()
            os.close(end)
        except OSError:
            pass
    time.sleep(0.05)
"""


@pytest.fixture
def places(tmp_path):
    """A project with links that lead out, and the folder that they lead to, where nothing may be opened."""
    project, outside = tmp_path / "project", tmp_path / "outside"
    (project / "sub").mkdir(parents=True)
    (project / "pipeline.toml").touch()
    outside.mkdir()
    fifos = [outside / "secret.usda", outside / "secret.usdz"]
    for fifo in fifos:
        os.mkfifo(fifo)
    (project / "link.usda").symlink_to(outside / "secret.usda")
    (project / "link.usdz").symlink_to(outside / "secret.usdz")
    (project / "folder").symlink_to(outside)
    (project / "x[1]").symlink_to(outside)
    watch = subprocess.Popen([sys.executable, "-IS", "-c", WATCH, tmp_path / "opened", *fifos])
    yield project, outside
    watch.kill()
    watch.wait()
    assert not (tmp_path / "opened").exists()


def stage(folder, asset, arc="sublayer"):
    """A stage that names an asset."""
    more, body = ARCS[arc]
    variables = '    expressionVariables = {{\n        string P = "../outside/secret.usda"\n    }}\n'
    path = folder / "s.usda"
    path.write_text((HEAD.format(more=variables + more) + body).format(asset=f"@{asset}@"))
    return path


def codes(path):
    return [problem.code for problem in load(path).problems]


def test_no_arc_opens_a_file_outside(places):
    project, outside = places
    wrong = []
    for arc, (spelling, asset) in itertools.product(ARCS, SPELLINGS.items()):
        path = stage(project, asset.format(outside=outside), arc)
        problems = load(path).problems
        if [(one.code, one.file) for one in problems] != [("asset-outside", str(path))]:
            wrong.append((arc, spelling, problems))
            continue
        assert "@" in path.read_text().splitlines()[problems[0].line - 1], (arc, spelling)
        assert "--allow-root" in problems[0].hint, (arc, spelling)

    assert wrong == []


def test_expressions_in_asset_paths_are_not_supported(places):
    project, outside = places
    given = {
        (arc, spelling): codes(stage(project, asset.format(outside=outside), arc))
        for arc, (spelling, asset) in itertools.product(ARCS, EXPRESSIONS.items())
    }

    assert {pair: found for pair, found in given.items() if found != ["not-yet-supported"]} == {}


@pytest.mark.parametrize("name", ["link.usda", "link.usda:SDF_FORMAT_ARGS:a=b", "link.usdz[in.usda]"])
def test_names_that_usd_finds_beside_the_root_layer_are_found_there(places, name):
    """A layer in another folder names it without ./ and has no such neighbour."""
    project, _ = places
    stage(project / "sub", name)

    assert codes(stage(project, "./sub/s.usda")) == ["asset-outside"]


@pytest.mark.parametrize("name", ["{outside}/secret.usda", "{outside}/secret.usdz[in.usda]"])
def test_layers_in_a_package_are_followed_out_of_it(places, name):
    project, outside = places
    package(project / "p.usdz", stage(project, name.format(outside=outside)).read_text())

    assert codes(stage(project, "./p.usdz[in.usda]")) == ["asset-outside"]


def test_a_member_that_is_a_value_and_a_layer_is_followed(places):
    project, outside = places
    package(project / "p.usdz", stage(project, f"{outside}/secret.usda").read_text())
    path = stage(project, "./p.usdz[in.usda]")
    path.write_text(path.read_text() + 'def "A"\n{\n    custom asset x = @./p.usdz[in.usda]@\n}\n')

    assert codes(path) == ["asset-outside"]


@pytest.mark.parametrize(
    "statement",
    [
        'def "A"\n{\n    custom asset x = @OUT@\n}\n',
        'def "A"\n{\n    custom asset[] x = [@OUT@]\n}\n',
        'def "A"\n{\n    custom asset x.timeSamples = {\n        1: @OUT@,\n    }\n}\n',
        'def "A" (\n    customData = {\n        asset x = @OUT@\n    }\n)\n{\n}\n',
    ],
)
def test_asset_values_open_no_package_outside(places, statement):
    """USD looks for the member as soon as somebody asks for the value."""
    project, _ = places
    path = project / "s.usda"
    path.write_text(HEAD.format(more="") + statement.replace("OUT", "./link.usdz[x.png]"))
    assert codes(path) == ["asset-outside"]

    path.write_text(HEAD.format(more="") + statement.replace("OUT", '`"./link.usdz[x.png]"`'))
    assert codes(path) == ["not-yet-supported"]


def test_a_file_outside_is_not_quoted(places):
    """Neither as a line that does not parse, nor as units that disagree."""
    project, outside = places
    (outside / "secret.usda").unlink()
    for text in ("#usda 1.0\nTOPSECRET42 = = 1\n", SECRET.replace("0.001", "0.4242"), SECRET):
        (outside / "secret.usda").write_text(text)
        for spelling in (*SPELLINGS.values(), *EXPRESSIONS.values()):
            if "usdz" not in spelling:
                loaded = load(stage(project, spelling.format(outside=outside)))
                assert loaded.flattened == ""
                assert [one for one in map(str, loaded.problems) if "TOPSECRET" in one or "0.4242" in one] == []
    rows, _ = problems_of_untrusted(stage(project, "../outside/secret.usda"), ())
    assert [row["code"] for row in rows] == ["asset-outside"]


def test_a_composed_stage_tells_each_layer_from_outside(places):
    """Whatever the look before did not see."""
    project, outside = places
    for file in ("secret.usda", "secret.usdz"):
        (outside / file).unlink()
    (outside / "secret.usda").write_text(SECRET)
    package(outside / "secret.usdz", SECRET)
    for spelling, asset in {**SPELLINGS, **EXPRESSIONS}.items():
        path = stage(project, asset.format(outside=outside))

        composed, _ = open_stage(path)

        problems = check_used(composed, allowed_roots(path))
        assert [(one.code, one.file) for one in problems] == [("asset-outside", str(path))], spelling
        assert "--allow-root" in problems[0].hint, spelling
        assert check_used(composed, allowed_roots(path, [outside])) == [], spelling


def test_a_file_with_the_name_of_a_member_is_not_read_for_it(places):
    """Lines are looked up in the text of a layer, and statements that stand there twice."""
    project, outside = places
    (outside / "twice.usda").write_text(PART.replace("{\n}", "{\n    double a = 1\n    double a = 1\n}"))
    (project / "p.usdz[in.usda]").symlink_to(outside / "twice.usda")
    package(project / "p.usdz", PART)

    assert load(stage(project, "./p.usdz[in.usda]")).problems == []


def test_an_asset_path_does_not_pass_for_a_place_in_a_message(places):
    project, outside = places
    name = f"@@./nowhere introduced by @{outside}/other.usda@</A>@@"

    (problem,) = load(stage(project, name, "reference")).problems

    assert problem.file == str(project / "s.usda")


def test_files_inside_may_be_named_in_every_way(places):
    names_inside(places[0], zip(INSIDE, itertools.cycle(ARCS), strict=False))


@pytest.mark.heavy
def test_files_inside_may_be_named_in_every_way_by_every_arc(places):
    names_inside(places[0], itertools.product(INSIDE, ARCS))


def names_inside(project, pairs):
    """Stages that name a part inside by an asset path and an arc are read without a problem, and the part with them."""
    (project / "part.usda").write_text(PART)
    (project / "y[1]").symlink_to(project)
    package(project / "p.usdz", PART)
    for asset, arc in pairs:
        loaded = load(stage(project, asset, arc))

        assert loaded.problems == [], (asset, arc)
        assert all(file.is_file() for file in loaded.files), (asset, arc)
        assert len(loaded.files) == 2, (asset, arc)


def test_arguments_for_the_format_of_a_file_are_refused(places):
    """USD makes more identifiers of them than are written, each of which is a layer of its own."""
    project, _ = places
    (project / "part.usda").write_text(PART)
    given = {arc: codes(stage(project, "./part.usda:SDF_FORMAT_ARGS:a=b", arc)) for arc in ARCS}

    assert given == {arc: ["not-yet-supported"] for arc in ARCS}


def test_headers_of_the_package_around_a_member_are_looked_at(places):
    project, asset = places[0], "./p.usdz[in.usda]"
    with zipfile.ZipFile(project / "p.usdz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("in.usda", PART)
    assert codes(stage(project, asset)) == ["package"]

    (project / "p.usdz").write_bytes(b"PK")
    os.truncate(project / "p.usdz", 2**40)  # sparse
    assert codes(stage(project, asset)) == ["file-size"]

    (project / "p.usdz").unlink()
    os.mkfifo(project / "p.usdz")
    assert codes(stage(project, asset)) == ["file-kind"]


def test_a_search_path_leads_to_the_library_and_to_what_is_allowed(places):
    project, outside = places
    assert codes(stage(project, "lenses/double_gauss_100mm_tronnier.usda")) == []
    try:
        Ar.DefaultResolver.SetDefaultSearchPath([library_path(), str(outside)])
        for name in ("secret.usda", "secret.usda:SDF_FORMAT_ARGS:a=b", "secret.usdz[in.usda]"):
            assert codes(stage(project, name)) == ["asset-outside"]
        (outside / "part.usda").write_text(PART)
        assert load(stage(project, "part.usda"), [outside]).problems == []
    finally:
        register()


def test_every_file_outside_is_told_at_once(places):
    project, _ = places
    path = project / "s.usda"
    more = "    subLayers = [\n        @./link.usda@,\n        @../outside/secret.usdz@\n    ]\n"
    path.write_text(HEAD.format(more=more))

    problems = load(path).problems

    assert sorted((problem.code, problem.line) for problem in problems) == [("asset-outside", 7), ("asset-outside", 8)]


def package(path, text):
    """A package with one layer, in.usda."""
    member = path.parent / "in.usda"
    member.write_text(text)
    path.unlink(missing_ok=True)
    with Sdf.ZipFileWriter.CreateNew(str(path)) as archive:
        archive.AddFile(str(member), "in.usda")
    member.unlink()
