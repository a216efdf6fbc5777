"""From a path on the stage to a line of text."""

import pytest
from pxr import Sdf, Tf

from pipeline.scene.usd.usda_lines import line_of, sample_key, text_map

TEXT = '''#usda 1.0
(
    doc = """def Xform "NotAPrim"
    { double x = 1 }"""
    customLayerData = {
        string x = "{"
    }
)

def Xform "A" (
    variants = {
        string look = "red"
    }
    prepend variantSets = "look"
)
{
    # double comment = 2
    double3 xformOp:translate.timeSamples = {
        1: (0, 0, -1),
        2.5: (0, 0, -2),
    }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    rel plen:lens = </A/B>

    def "B" (
        prepend references = @./b.usda@
    )
    {
        double y = 1 (
            doc = "y"
        )
    }
    variantSet "look" = {
        "red" {
            double inside = 3
        }
    }
}
'''


@pytest.fixture
def file(tmp_path):
    """A layer with everything that could confuse a scanner."""
    path = tmp_path / "a.usda"
    path.write_text(TEXT)
    return path


@pytest.mark.parametrize(
    ("path", "starts"),
    [
        ("/A", 'def Xform "A"'),
        ("/A.xformOp:translate", "double3"),
        ("/A.xformOp:translate" + sample_key(1), "1: "),
        ("/A.xformOp:translate" + sample_key(2.5), "2.5: "),
        ("/A.xformOp:translate" + sample_key(9), "double3"),
        ("/A.plen:lens", "rel"),
        ("/A/B", 'def "B"'),
        ("/A/B.y", "double y"),
        ("/A/B.missing", 'def "B"'),
        ("/A{look=red}.inside", "double inside"),
    ],
)
def test_a_path_leads_to_its_line(file, path, starts):
    assert TEXT.splitlines()[line_of(file, path) - 1].strip().startswith(starts)


def test_what_stands_in_strings_and_comments_is_no_prim(file):
    assert line_of(file, "/NotAPrim") is None
    assert line_of(file, "/A.comment") == line_of(file, "/A")


def test_assets_are_found(file):
    assert TEXT.splitlines()[text_map(file).assets["./b.usda"] - 1].strip().startswith("prepend references")


def test_a_file_that_is_not_text_has_no_lines(tmp_path):
    path = tmp_path / "a.usdc"
    path.write_bytes(b"PXR-USDC\x00\x00")

    assert line_of(path, "/A") is None
    assert line_of(tmp_path / "nowhere.usda", "/A") is None


LITERALS = ("7", "-7", "7.5", "-0.5", "7.0", "7.", "1e3", "2.5e-1", "0", "1", "2", "0.5", "1.0")


@pytest.mark.parametrize(
    "spelling", ["{} x = {}", "{}[] x = [{}]", "{} [] x = [{}]", "{} x.timeSamples = {{ 0.5: {} }}"]
)
@pytest.mark.parametrize("kind", ["int", "uint", "int64", "bool"])
def test_a_number_is_cut_where_usd_reads_another_one(tmp_path, kind, spelling):
    """Sdf itself is asked what it makes of each literal; uint takes no sign, and USD says so itself."""
    changed = []
    for number, literal in enumerate(LITERALS):
        path = tmp_path / f"a{number}.usda"
        path.write_text(f'#usda 1.0\ndef "A"\n{{\n    {spelling.format(kind, literal)}\n}}\n')
        try:
            layer = Sdf.Layer.FindOrOpen(path.as_posix())
        except Tf.ErrorException:
            assert (kind, literal[0]) == ("uint", "-")
            continue
        value = layer.QueryTimeSample("/A.x", 0.5) if "timeS" in spelling else layer.GetAttributeAtPath("/A.x").default
        read = float(value[0] if "[" in spelling else value)
        changed.append(read != float(literal))
        assert [flaw.line for flaw in text_map(path).flaws] == ([4] if read != float(literal) else [])
    assert True in changed and False in changed


def test_cut_numbers_are_found_on_their_own_lines_of_an_array(tmp_path):
    """Arrays of digits alone, with brackets inside, in time samples, and with words among the numbers."""
    path = tmp_path / "a.usda"
    path.write_text("""#usda 1.0
def "A"
{
    int[] a = [1,
        2.5, -3,
        4e-1]
    int2[] b = [(1, 2),
        (3, 4.5)]
    bool[] c = [0, 1,
        2]
    int[] d.timeSamples = {
        1: [1, 2],
        2: [3, 0.5],
    }
    int[] e = []
    int[] f = [1, 1.5, inf]
    double[] g = [1.5, 2.5]
    int h = 7
}
""")
    cut = [(flaw.path, flaw.line) for flaw in text_map(path).flaws]
    assert cut == [("/A.a", 5), ("/A.a", 6), ("/A.b", 8), ("/A.c", 10), ("/A.d", 13), ("/A.f", 16)]
    lines = text_map(path).lines
    assert (lines["/A.d[2.0]"], lines["/A.e"], lines["/A.h"]) == (13, 15, 18)
