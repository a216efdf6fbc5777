"""A stage that multiplies its prims is refused before USD makes them."""

import pytest
from pxr import Sdf, Usd

from pipeline.scene.load import load
from pipeline.scene.trust.census import most_prims

HEAD = '#usda 1.0\n(\n    defaultPrim = "A"\n    metersPerUnit = 0.001\n    upAxis = "Y"\n)\n'
ARCS = {
    "references": "references = </L{below}>",
    "payload": "payload = </L{below}>",
    "inherits": "inherits = </L{below}>",
    "specializes": "specializes = </L{below}>",
}


def doubling(levels, arc="references"):
    """Prims each of which has two children that are made of the one before."""
    text = f'{HEAD}def "L0"\n{{\n}}\n'
    for level in range(1, levels):
        child = f'    def "{{}}" ({ARCS[arc].format(below=level - 1)})\n    {{{{\n    }}}}\n'
        text += f'def "L{level}"\n{{\n{child.format("a")}{child.format("b")}}}\n'
    return f'{text}def "A" (references = </L{levels - 1}>)\n{{\n}}\n'


@pytest.mark.parametrize("arc", ARCS)
def test_prims_that_double_forty_times_are_refused_with_what_raises_the_limit(arc, tmp_path):
    """USD would make 1e12 of them."""
    (tmp_path / "s.usda").write_text(doubling(40, arc))
    (problem,) = load(tmp_path / "s.usda").problems
    assert (problem.code, problem.line) == ("over-limit", 1)
    assert "limit of 1,000,000 prims" in problem.message and 'PIPELINE_LIMITS="prims=' in problem.hint


def test_they_are_counted_through_files_and_sublayers(tmp_path):
    (tmp_path / "a.usda").write_text(HEAD + 'def "A"\n{\n}\n')
    for number, name in enumerate("bcdefghijklmnopqrstuvwxyz"):
        below = f"@./{'abcdefghijklmnopqrstuvwxyz'[number]}.usda@"
        child = f'    def "{{}}" (references = {below})\n    {{{{\n    }}}}\n'
        (tmp_path / f"{name}.usda").write_text(f'{HEAD}def "A"\n{{\n{child.format("x")}{child.format("y")}}}\n')
    (tmp_path / "stage.usda").write_text(
        HEAD.replace("    defaultPrim", "    subLayers = [@./z.usda@]\n    defaultPrim")
    )
    assert [one.code for one in load(tmp_path / "stage.usda").problems] == ["over-limit"]


@pytest.mark.parametrize("arc", ARCS)
def test_the_bound_is_no_less_than_what_usd_makes_and_not_far_from_it(arc, tmp_path):
    (tmp_path / "s.usda").write_text(doubling(8, arc))
    stage = Usd.Stage.Open(str(tmp_path / "s.usda"))
    made = len(list(stage.TraverseAll()))
    assert made <= most_prims(Sdf.Layer.FindOrOpen(str(tmp_path / "s.usda"))) <= 4 * made


def test_arcs_that_lead_back_or_nowhere_end(tmp_path):
    text = HEAD + 'def "A" (references = [</B>, </Nowhere>])\n{\n}\ndef "B" (references = </A>)\n{\n}\n'
    (tmp_path / "s.usda").write_text(text)
    assert 2 <= most_prims(Sdf.Layer.FindOrOpen(str(tmp_path / "s.usda"))) < 10


def test_a_chain_of_many_prims_is_counted_without_a_stack(tmp_path):
    chain = "".join(f'def "L{n}" (references = </L{n - 1}>)\n{{\n}}\n' for n in range(1, 5000))
    (tmp_path / "s.usda").write_text(HEAD + 'def "L0"\n{\n}\n' + chain)
    assert most_prims(Sdf.Layer.FindOrOpen(str(tmp_path / "s.usda"))) >= 5000
