"""Sizes are asked before anything is made; files that USD or Python would stumble over are problems with a place."""

import re
from pathlib import Path

import pytest
from stage_text import stage_in, tiny_text

from pipeline.errors import UsageError
from pipeline.limits import Limits, limits
from pipeline.scene.load import load


def stage(folder: Path, *edits: tuple[str, str], kind: str = "conventional") -> Path:
    """The tiny dataset with texts replaced; the library is found by search path."""
    return stage_in(folder, tiny_text(kind, *edits))


def only(path: Path):
    (found,) = load(path).problems
    return found


@pytest.mark.parametrize(
    ("name", "edit", "line"),
    [
        ("pixels", ("plen:truth:samples = 64", "plen:truth:supersampling = 64\n int2 userProperties:x"), "resolution"),
        ("rays", ("plen:image:samples = 64", "plen:image:samples = 16777216"), "plen:image:samples"),
        ("points", ("plen:columns = 3", "plen:columns = 9999"), "plen:columns"),
        (
            "f_numbers",
            ("uniform int plen:image:samples = 64", f"uniform double[] plen:image:fNumbers = {[9.0] * 101}"),
            "fNum",
        ),
    ],
)
def test_more_than_a_limit_is_refused_at_its_line_with_what_raises_it(name, edit, line, tmp_path):
    edits = [edit, *([("(32, 24)", "(3200, 2400)")] if "supersampling" in edit[1] else [])]
    edits += [("plen:rows = 2", "plen:rows = 1000")] if name == "points" else []
    edits += [("(32, 24)", "(3200, 2400)")] if name == "rays" else []
    path = stage(tmp_path, *edits)
    found = only(path)
    assert found.code == "over-limit"
    assert f"limit of {getattr(Limits(), name):,} {name.replace('_', ' ')}" in found.message
    assert re.search(rf'PIPELINE_LIMITS="{name}=\d+"', found.hint)
    assert line in path.read_text().split("\n")[found.line - 1]


def test_a_lattice_is_counted_before_it_is_made(tmp_path):
    """Turned by 45 degrees, a long and thin array needs a square of 1e12 candidates."""
    array = (
        'over "Microlenses"\n{\nuniform double plen:width = 100000\nuniform double plen:height = 1\n}\nover "Sensor"'
    )
    found = only(stage(tmp_path, ('over "Sensor"', array), kind="plenoptic"))
    assert (found.code, found.at) == ("over-limit", "/TinyPlenoptic/Rig/Microlenses.plen:width")


def test_the_hint_raises_the_limit(tmp_path, monkeypatch):
    path = stage(tmp_path)
    monkeypatch.setenv("PIPELINE_LIMITS", "frames=1")
    hint = only(path).hint
    monkeypatch.setenv("PIPELINE_LIMITS", re.search('"(.*)"', hint)[1])
    assert load(path).problems == []


@pytest.mark.parametrize(("text", "said"), [("frame=9", 'did you mean "frames"'), ("frames=many", "holds no number")])
def test_a_limit_that_does_not_exist_is_an_error(text, said, monkeypatch):
    monkeypatch.setenv("PIPELINE_LIMITS", text)
    with pytest.raises(UsageError, match=said):
        limits()


def test_the_rig_of_the_paper_at_full_size_is_within_all_limits():
    """6576 x 4384 pixels, K = 4, 1,024 rays a position."""
    pixels = 6576 * 4384 * 4**2
    assert pixels <= Limits().pixels and 1024 * pixels <= Limits().rays


def test_a_byte_that_is_not_utf_8_is_named_with_its_line(tmp_path):
    path = stage(tmp_path)
    count = len(path.read_bytes().split(b"\n"))
    path.write_bytes(path.read_bytes() + b"# caf\xe9\n")
    found = only(path)
    assert (found.code, found.line) == ("encoding", count)
    assert "0xe9" in found.message


@pytest.mark.parametrize("name", ["loop.usda", "n" * 300 + ".usda"])
def test_a_link_to_itself_or_a_name_too_long_is_no_traceback(name, tmp_path):
    if name == "loop.usda":
        (tmp_path / name).symlink_to(name)
        assert [one.code for one in load(tmp_path / name).problems] == ["file-kind"]
    else:
        with pytest.raises(UsageError, match="more than 255 bytes"):
            load(tmp_path / name)
    text = stage(tmp_path).read_text().replace('"Rig" (', '"Rig" (\n payload = @./' + name + "@\n")
    assert load(stage_in(tmp_path, text)).errors


def test_a_binary_layer_is_read_and_one_that_is_cut_ends_in_a_message(tmp_path):
    from pxr import Sdf

    whole, cut = tmp_path / "whole.usdc", tmp_path / "cut.usdc"
    assert Sdf.Layer.FindOrOpen(str(stage(tmp_path))).Export(str(whole))
    assert load(whole).problems == []
    cut.write_bytes(whole.read_bytes()[:500])
    assert only(cut).line == 1


def test_escape_sequences_are_never_printed(tmp_path):
    for edit in (
        ('"Board"', '"Bo\x1b[31mard"'),
        ("rigs/conventional", "rigs/\x1b[31m"),
        ('xformOp:orient"]', '\x1b]"]'),
    ):
        problems = load(stage(tmp_path, edit)).problems
        assert problems
        assert all(str(one).replace("\n", "").isprintable() for one in problems)


def test_names_that_one_file_system_takes_for_one_and_names_too_long_are_refused(tmp_path):
    twin = 'def PlenCheckerboard "Gru\u0308n" {\nuniform int plen:columns = 3\nuniform int plen:rows = 2\n'
    twin += 'uniform double plen:squareSize = 1\n}\n    def PlenCheckerboard "Gr\u00fcn" ('
    names = "[</TinyConventional/Gr\u00fcn>, </TinyConventional/Gru\u0308n>]"
    edits = [('def PlenCheckerboard "Board" (', twin), ("</TinyConventional/Board>", names)]
    assert "name-collision" in [one.code for one in load(stage(tmp_path, *edits)).problems]
    assert only(stage(tmp_path, ("Board", "B" * 250))).code == "long-name"
