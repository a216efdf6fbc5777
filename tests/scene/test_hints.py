"""One mistake gives one message with a way out, and no others that only follow from it."""

import pytest
from stage_text import head, tiny_text

from pipeline.scene.load import load

HEAD = head("Mine") + 'def PlenDataset "Mine"\n{\n'
LENS = """    rel plen:cameras = </Mine/Cam>
    def Camera "Cam" (prepend apiSchemas = ["PlenCameraAPI"])
    {
        rel plen:camera:lens = </Mine/Lens>
    }
    def "Lens" (prepend references = @lenses/FILE.usda@)
    {
        over "PRIM"
        {
            uniform double plen:semiDiameter = 4
        }
    }
"""


def problems(tmp_path, body):
    (tmp_path / "s.usda").write_text(HEAD + body + "}\n")
    return load(tmp_path / "s.usda").problems


@pytest.mark.parametrize(
    ("body", "hint"),
    [
        ('    over "Stop" { uniform double plen:semiDiameter = 4 }\n', "closing brace"),
        ("    uniform double plen:background = 0,5\n", "decimals with a point"),
        ("    uniform double plen:background = 6um\n", "without a unit"),
        ("    rel plen:targets = [</Mine/A>, </Mine/A>]\n", "remove one"),
        ("    rel plen:targets = </Mine/My Board>\n", "without spaces"),
    ],
)
def test_what_usd_cannot_parse_comes_with_a_way_to_mend_it(tmp_path, body, hint):
    (problem,) = problems(tmp_path, body)
    assert (problem.code, problem.line) == ("usd-syntax", 12) and hint in problem.hint


def test_a_negative_index_is_understood_as_a_mirror(tmp_path):
    text = LENS.replace("FILE", "cooke_triplet_50mm").replace("PRIM", "Stop").replace("semiDiameter = 4", "index = -1")
    (problem,) = (problem for problem in problems(tmp_path, text) if problem.code == "out-of-range")
    assert "mirrors are not simulated" in problem.hint


def test_a_missing_file_is_one_error_with_the_nearest_name_and_the_folders_that_were_searched(tmp_path):
    listed = problems(tmp_path, LENS.replace("FILE", "double_gauss_50mm_cannon").replace("PRIM", "Stop"))
    missing = next(problem for problem in listed if problem.code == "usd-invalid-asset-path")
    assert missing.hint.startswith("did you mean @lenses/double_gauss_50mm_canon.usda@? searched: ")
    assert str(tmp_path) in missing.hint and missing.hint.endswith("stages")
    assert not {problem.code for problem in listed} & {"over-without-def", "wrong-target"}
    assert not any("Lens" in (problem.at or "") for problem in listed if problem is not missing)


@pytest.mark.parametrize(
    ("typed", "hint"),
    [
        ("boards/datset.usda", 'did you mean "boards/dataset.usda"? searched: boards, '),
        ("lenses/cooke_triplet_50.usda", 'did you mean "lenses/cooke_triplet_50mm.usda"? searched: lenses, '),
        ("boards/nothing_like_it.usda", "searched: boards, "),
    ],
)
def test_a_stage_that_is_not_there_comes_with_the_nearest_name_and_the_folders(tmp_path, monkeypatch, typed, hint):
    """Also in a folder that is not there, and by an absolute path."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "boards").mkdir()
    (tmp_path / "boards/dataset.usda").write_text(HEAD + "}\n")
    (relative,), (absolute,) = load(typed).problems, load(tmp_path / typed).problems
    assert relative.code == "file-missing" and relative.hint.startswith(hint) and relative.hint.endswith("stages")
    assert absolute == relative


def test_operations_in_no_order_are_one_problem_with_one_order_that_holds_all(tmp_path):
    body = "    double3 xformOp:translate = (0, 0, 1)\n    float3 xformOp:rotateXYZ = (0, 0, 1)\n"
    listed = problems(tmp_path, f'    def Xform "A"\n    {{\n{body}    }}\n')
    (problem,) = (problem for problem in listed if "xform" in problem.code)
    assert '["xformOp:translate", "xformOp:rotateXYZ"]' in problem.hint and "last one acts first" in problem.hint


def test_a_misspelt_value_is_not_reported_as_missing_too(tmp_path):
    size = "uniform double plen:squaresize = 1"
    listed = problems(tmp_path, f'    def PlenCheckerboard "Board"\n    {{\n        {size}\n    }}\n')
    assert [problem.code for problem in listed if "squaresize" in problem.message.lower()] == ["unknown-property"]


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("mine", "it is a folder, in which there is dataset.usda"),
        ("empty", "it is a folder without a stage"),
        ("mine/lens.ZMX", "`pipeline import lens lens.ZMX` makes a stage of a lens file"),
        ("mine/board.png", "stages are files of USD: .usd, .usda, .usdc, .usdz"),
    ],
)
def test_what_is_no_stage_is_told_what_to_give_in_its_place(tmp_path, name, hint):
    (tmp_path / "empty").mkdir()
    (tmp_path / "mine").mkdir()
    for file in ("dataset.usda", "lens.ZMX", "board.png"):
        (tmp_path / "mine" / file).write_text("nothing of USD\n")
    [problem] = load(tmp_path / name).problems
    assert problem.hint == hint


@pytest.mark.parametrize(
    ("right", "wrong", "code"),
    [
        ("metersPerUnit = 0.001", "metersPerUnit = 1", "layer-metersPerUnit"),
        ('upAxis = "Y"', 'upAxis = "Z"', "layer-upAxis"),
        ("timeCodesPerSecond = 24", "timeCodesPerSecond = 25", "layer-timeCodesPerSecond"),
    ],
)
def test_a_stage_with_other_units_than_all_that_it_uses_is_told_once_and_at_its_own_line(tmp_path, right, wrong, code):
    path = tmp_path / "mine.usda"
    path.write_text(tiny_text("conventional", (right, wrong)), encoding="utf-8")
    [problem] = load(path).errors
    assert problem.code == code and "in all 3 layers that it uses" in problem.message
    assert path.read_text(encoding="utf-8").splitlines()[problem.line - 1].strip() == wrong
    assert problem.file.endswith(path.name)


@pytest.mark.parametrize(
    ("place", "away", "hint"),
    [("437", "behind the stop", "has a negative z"), ("-0.4", "0.4 mm before the stop", "were metres meant?")],
)
def test_one_mistake_in_all_frames_is_one_message(tmp_path, place, away, hint):
    """A board on the wrong side, or in metres; distances are told by words, not by a sign of another frame."""
    head, start, rest = tiny_text("conventional").partition("xformOp:translate.timeSamples = {")
    samples = f"\n            1: (0, 0, {place}),\n            2: (0, 0, {place}),\n        }}"
    (tmp_path / "s.usda").write_text(head + start + samples + rest.partition("}")[2], encoding="utf-8")
    [problem] = load(tmp_path / "s.usda").problems
    assert "in frames 1-2; in frame 1" in problem.message and away in problem.message and hint in problem.hint
