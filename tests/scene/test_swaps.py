"""A file that is exchanged while a stage is read: USD gets what was looked at, or nothing."""

import zipfile

import pytest

from pipeline.confine.process import Guards
from pipeline.scene import load
from pipeline.scene.check import stage
from pipeline.scene.load import Look
from pipeline.scene.trust import judged_layers, prescan
from pipeline.scene.usd import layer_files

HEAD = '#usda 1.0\n(\n    defaultPrim = "A"\n    metersPerUnit = 0.001\n    upAxis = "Y"\n)\n'
PART = HEAD + 'def Xform "A"\n{\n    custom string said = "PUBLIC"\n}\n'
SECRET = PART.replace("PUBLIC", "TOPSECRET42")
STAGE = HEAD + 'def Xform "A" (\n    prepend references = @./folder/part.usda@\n)\n{\n}\n'


@pytest.fixture
def places(tmp_path):
    """A project with a folder that is a link, and a folder outside of it with a file of the same name."""
    for name, text in (("project/own", PART), ("outside", SECRET)):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "part.usda").write_text(text)
    (tmp_path / "project/pipeline.toml").touch()
    (tmp_path / "project/folder").symlink_to("own")
    (tmp_path / "project/s.usda").write_text(STAGE)
    return tmp_path / "project"


def swap(project):
    """The link leads out from now on."""
    (project / "new").symlink_to("../outside")
    (project / "new").rename(project / "folder")


def told(loaded):
    """All that a load says."""
    return loaded.flattened + "\n".join(map(str, loaded.problems))


@pytest.mark.parametrize("guards", [None, Guards()])
@pytest.mark.parametrize(
    ("module", "step"),
    [(layer_files, "limits"), (layer_files, "map_of"), (prescan, "read_layer_file"), (load, "open_stage")],
)
def test_a_link_that_is_turned_outside_while_a_stage_is_read_changes_nothing(places, module, step, guards, monkeypatch):
    """At four moments: after the look at the place, after reading, before USD gets the bytes, before it composes."""
    original, calls = getattr(module, step), []

    def turned(*arguments):
        calls.append(arguments)
        if step == "open_stage" or len(calls) == 2:  # the first is the stage itself
            found = original(*arguments) if step == "read_layer_file" else None
            swap(places)
            return found or original(*arguments)
        return original(*arguments)

    monkeypatch.setattr(module, step, turned)
    monkeypatch.setattr(stage, "check_used", lambda *_: [])  # off: it notices the link, too
    loaded = load.load(places / "s.usda", guards=guards)

    assert (places / "folder/part.usda").read_text() == SECRET
    assert loaded.errors == []
    assert "PUBLIC" in loaded.flattened
    assert "TOPSECRET42" not in told(loaded)


def test_a_link_that_leads_out_when_it_is_looked_at_is_refused(places):
    swap(places)
    (problem,) = load.load(places / "s.usda").problems
    assert (problem.code, problem.line) == ("asset-outside", 8)


@pytest.mark.parametrize("text", [SECRET, "#usda 1.0\nTOPSECRET42 = = 1\n"])
def test_a_file_that_appears_after_the_look_is_not_told(places, text, monkeypatch):
    (places.parent / "outside/part.usda").write_text(text)
    (places / "folder").unlink()
    run = Look.run

    def then_appears(self):
        run(self)
        swap(places)

    monkeypatch.setattr(Look, "run", then_appears)
    loaded = load.load(places / "s.usda")

    assert [one.code for one in loaded.problems] == ["changed"]
    assert "TOPSECRET42" not in told(loaded)


def test_a_stage_is_read_as_it_was_although_it_is_overwritten_in_place(places, monkeypatch):
    """The same file with other bytes: those that were judged are used, and lines are theirs."""
    original = load.open_stage

    def overwritten(path):
        (places / "own/part.usda").write_text(SECRET)
        return original(path)

    monkeypatch.setattr(load, "open_stage", overwritten)
    assert "PUBLIC" in load.load(places / "s.usda").flattened


def test_an_unreadable_layer_is_a_problem_at_the_line_that_names_it(places, monkeypatch):
    def refused(path, roots):
        if path.endswith("part.usda"):
            raise PermissionError(13, "Permission denied")
        return layer_files.read_layer_file(path, roots)

    monkeypatch.setattr(prescan, "read_layer_file", refused)
    (problem,) = load.load(places / "s.usda").problems
    assert (problem.code, problem.line) == ("unreadable", 8)
    assert "Permission denied" in problem.message


def package(path, text):
    """A usdz whose first member references its second."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("first.usda", STAGE.replace("folder/", ""))
        archive.writestr("part.usda", text)


@pytest.fixture
def packages(places):
    """The same places with packages of one name in them."""
    package(places / "own/part.usdz", PART)
    package(places.parent / "outside/part.usdz", SECRET)
    (places / "s.usda").write_text(STAGE.replace(".usda@", ".usdz@"))
    return places


def test_a_package_that_nobody_touches_is_read(packages):
    loaded = load.load(packages / "s.usda")
    assert loaded.errors == [] and "PUBLIC" in loaded.flattened


@pytest.mark.parametrize(
    ("nth", "secret"),
    [
        (1, SECRET),
        (2, "#usda 1.0\nTOPSECRET42 = = 1\n"),
        pytest.param(2, SECRET, marks=pytest.mark.heavy),
        pytest.param(1, "#usda 1.0\nTOPSECRET42 = = 1\n", marks=pytest.mark.heavy),
    ],
)
def test_a_package_that_is_exchanged_before_usd_opens_it_is_refused(packages, nth, secret, monkeypatch):
    """USD opens packages by name: what it got is compared with the bytes that were judged, layer by layer."""
    package(packages.parent / "outside/part.usdz", secret)
    original, calls = judged_layers.layer_of, []

    def turned(identifier, *arguments, **options):
        calls.append(identifier)
        if sum("usdz" in one for one in calls) == nth:
            swap(packages)
        return original(identifier, *arguments, **options)

    monkeypatch.setattr(prescan, "layer_of", turned)
    monkeypatch.setattr(stage, "check_used", lambda *_: [])
    loaded = load.load(packages / "s.usda")

    assert (packages / "folder/part.usdz").read_bytes() == (packages.parent / "outside/part.usdz").read_bytes()
    assert [one.code for one in loaded.problems] == ["changed"]
    assert "TOPSECRET42" not in told(loaded)


def test_a_syntax_error_in_a_package_is_told_by_its_own_name(packages):
    package(packages / "own/part.usdz", "#usda 1.0\nnonsense = = 1\n")
    (problem,) = load.load(packages / "s.usda").problems
    assert problem.code == "usd-syntax"
    assert problem.file.endswith("folder/part.usdz[part.usda]")
    assert "judged" not in str(problem)
