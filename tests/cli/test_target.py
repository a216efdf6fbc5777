"""`pipeline target`: what a target is, as words and as a print."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT, TINY

TARGETS = ROOT / "stages/targets"


def test_the_page_says_what_a_target_is(run):
    code, page, log = run("target", TARGETS / "charuco_cylinder.usda")
    assert (code, log) == (0, "")
    assert page.startswith("CharucoCylinder: ChArUco 5x5_50, 8 x 5 squares of 6 mm, tags 0 to 19 of 4.5 mm,")
    assert "shape   cylinder" in page and "points  28 x corner" in page


def test_prints_are_written_and_the_same_twice(run, tmp_path):
    for name in ("one", "two"):
        code, _, log = run("target", TARGETS / "aprilgrid_cube.usda", "--svg", f"{name}.svg", "--pdf", f"{name}.pdf")
        assert code == 0 and log.startswith(f"wrote {name}.svg: 6 pages of up to ") and f"\nwrote {name}.pdf: " in log
    for suffix in ("svg", "pdf"):
        assert (tmp_path / f"one.{suffix}").read_bytes() == (tmp_path / f"two.{suffix}").read_bytes()
    assert (tmp_path / "one.pdf").read_bytes().startswith(b"%PDF-1.4")


@pytest.mark.parametrize("file", sorted(TARGETS.glob("*.usda")), ids=lambda path: path.stem)
def test_every_target_of_the_library_prints_but_the_mesh(run, file):
    code, page, log = run("target", file, "--svg", "print.svg")
    outcome = (2, "a mesh, which cannot be printed") if "mesh" in file.stem else (0, "wrote print.svg: ")
    assert "points" in page and code == outcome[0] and outcome[1] in log


@pytest.mark.parametrize(("square_mm", "paper"), [(6, "fits A4"), (30, "fits A3"), (200, "is larger than A0")])
def test_a_print_says_what_paper_it_needs(run, square_mm, paper):
    """Its size is that of the page in the PDF file, in points of 1/72 inch."""
    head = '(\n    defaultPrim = "B"\n    metersPerUnit = 0.001\n    upAxis = "Y"\n)'
    board = f"@targets/checkerboard_4x7.usda@)\n{{\n    uniform double plen:squareSize = {square_mm}\n}}\n"
    Path("b.usda").write_text(f'#usda 1.0\n{head}\n\ndef "B" (prepend references = {board}', encoding="utf-8")
    log = run("target", "b.usda", "--pdf", "b.pdf")[2]
    box = re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", Path("b.pdf").read_bytes())
    long, short = sorted((float(side) / 72 * 25.4 for side in box.groups()), reverse=True)
    assert f"1 page of up to {long:.0f} x {short:.0f} mm, which {paper}" in log


def test_a_target_of_a_dataset_is_found_by_its_name(run):
    assert run("target", TINY)[1] == run("target", TINY, "Board")[1]
    code, _, log = run("target", TINY, "Bord")
    assert code == 2 and 'has no target "Bord"' in log and 'did you mean "Board"?' in log


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((ROOT / "stages/sensors/michels_2019.usda",), "the stage holds no target [no-target]"),
        ((TARGETS / "lines_7x5.usda", "--pdf", "print.ps"), "print.ps is no .pdf file"),
    ],
)
def test_what_cannot_be_printed_is_refused(run, arguments, message):
    code, _, log = run("target", *arguments)
    assert code == 2 and message in log


@pytest.mark.parametrize(
    ("arguments", "file"),
    [
        (("target", TARGETS / "charuco_8x5.usda", "--pdf"), "print.pdf"),
        pytest.param(("plan", TINY, "--specs"), "specs", marks=pytest.mark.heavy),
    ],
)
def test_a_file_that_was_asked_for_is_written_although_nobody_reads_the_page(tmp_path, arguments, file):
    """As before `| head -1`: the reader has gone before the first line."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "pipeline", *map(str, arguments), file]
    places = {"PIPELINE_CACHE": str(tmp_path / "store"), "PYTHONPATH": str(ROOT)}
    subprocess.run(command, cwd=tmp_path, stdout=writer, env={**os.environ, **places}, check=False)
    os.close(writer)
    assert (tmp_path / file).exists()
