"""The benchmarks run on tiny stages, and what they compare holds there, too; figures come from full runs."""

import importlib
import itertools
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


def output_of(script: str, folder: Path) -> str:
    """Standard output of a benchmark with --small, run in an empty folder with a store of its own."""
    command = [sys.executable, str(BENCHMARKS / script), "--small"]
    environment = {**os.environ, "PIPELINE_CACHE": str(folder / "store")}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert [entry.name for entry in folder.iterdir() if entry.name != "store"] == []
    return done.stdout


def test_lines_that_both_commits_print_become_ratios(monkeypatch: pytest.MonkeyPatch) -> None:
    """Now over before; sizes, which are the same, stay, and a line without a counterpart says nothing."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    ratios = importlib.import_module("beside").ratios
    before = ["  packets  2.0e7 rays/s (best 2.5e7)", "   100 nodes: 4 µs", "  packets 1e6 rays/s (best 4e6)", "gone 3"]
    now = ["  packets 5.0e7 rays/s (best 1.0e8)", "  100 nodes:   3 µs", "new 3", "  packets 2e6 rays/s (best 1e6)"]
    assert ratios(before, now) == [
        "  packets 2.50x rays/s (best 4.00x)",
        "  100 nodes:   0.75x µs",
        "  packets 2.00x rays/s (best 0.25x)",
    ]


@pytest.mark.heavy
def test_plain_sampling_needs_at_least_twenty_times_the_rays(tmp_path: Path) -> None:
    """For the error of any number of samples; plain sampling has no bias: four times the rays halve its error."""
    rows = [line.split("|") for line in output_of("sampling.py", tmp_path).splitlines() if line.startswith("|")][2:]
    plain = [float(row[4]) for row in rows if row[1] == " plain "]
    assert all(1.5 < before / after < 2.7 for before, after in itertools.pairwise(plain))
    assert all(float(row[6]) >= 20 for row in rows[len(plain) + 1 :]) and len(rows) == 13


@pytest.mark.heavy
def test_lit_images_have_little_noise_at_few_rays(tmp_path: Path) -> None:
    """Single lamps asked by independent wavelengths left 0.2 of the mean."""
    found = re.search(r"noise over the mean of the image ([\d.]+)", output_of("lit_noise.py", tmp_path))
    assert found and 0.0 < float(found[1]) < 0.1


@pytest.mark.heavy
def test_both_methods_agree_with_solutions_that_know_no_grid(tmp_path: Path) -> None:
    """A conventional camera loses no corner, no search finds rows that do not exist, the reference is the finer one.

    Method `direct` finds rows in the penumbra whose candidates the reference does not guess.
    """
    text = output_of("truth.py", tmp_path)
    lines = re.findall(r"^  (two-plane|image) +all +(\d+) +(\d+) +[\d.]+% +(.*)$", text, re.MULTILINE)
    assert [method for method, *_ in lines] == ["two-plane", "image"] * 2
    assert [(exist, found) for _, exist, found, _ in lines[:2]] == [("12", "12")] * 2
    for *_, figures in lines:
        _, rms, worst, *_, reference = map(float, figures.split())
        assert rms < 0.01 and worst < 0.05, "px: 64 samples scatter a few thousandths of a pixel"
        assert reference < rms / 3
    assert not re.search(r"(two-plane|image) +found \d+ rows that the reference does not know", text)
    assert re.findall(r"rays of image per frame over those of direct: (\d+)", text)


@pytest.mark.heavy
def test_direct_needs_fewer_rays_than_images(tmp_path: Path) -> None:
    """Full-sensor J at K = 2 and 1,024 samples, not yet exact to 0.001 px, takes hundreds of times the rays."""
    lines = re.findall(
        r"^ +(\d+) +(\d+) +[\d.]+% +[\d.]+ +[\d.]+ +[\d.e+]+ +(\d+)", output_of("direct.py", tmp_path), re.M
    )
    assert [(k, samples) for k, samples, _ in lines] == [("1", "1024"), ("2", "1024")]
    assert int(lines[-1][2]) > 200


@pytest.mark.heavy
def test_a_schedule_adds_up(tmp_path: Path) -> None:
    """One worker takes the sum; n take the critical path or more, at most that and an nth of the sum (Graham 1966)."""
    text = output_of("schedule.py", tmp_path)
    whole, path = map(float, re.findall(r"^sum ([\d.]+) s; critical path ([\d.]+) s", text, re.MULTILINE)[0])
    times = {int(n): float(time) for n, time in re.findall(r"(\d+) workers: +([\d.]+) s", text)}
    assert abs(times[1] - whole) < 0.1 and len(times) > 2
    assert all(path - 0.01 <= time <= path + whole / n + 0.1 for n, time in times.items())


@pytest.mark.heavy
def test_position_images_by_three_ways(tmp_path: Path) -> None:
    """Random rays err less the more they are, quadrature less than they, and squares share its rays."""
    text = output_of("positions.py", tmp_path)
    errors = [float(error) for error in re.findall(r"random rays +\S+ +\S+ +(\S+)$", text, re.M)]
    assert len(errors) == 10 and errors[4] < errors[0] / 10 and errors[9] < errors[5] / 10
    assert all(float(error) < 1e-5 for error in re.findall(r"8 x 32 nodes +\S+ +\S+ +(\S+)", text))
    (node,), (square,) = (re.findall(rf"{way} +(\S+)", text)[:1] for way in ("3 x 8 nodes", "16 x 16"))
    assert float(square) < float(node) / 4


@pytest.mark.heavy
def test_single_precision_errs_by_its_rounding(tmp_path: Path) -> None:
    """Half an ulp of a direction in float32 is 2e-5 mm at 400 mm, a thousandth of a pixel there; a dozen surfaces add
    some. The mean of 64 rays, whose roundings are independent, moves by an eighth."""
    text = output_of("single.py", tmp_path)
    pairs = r"rays move by (\S+) px rms, (\S+) px at most,\s+the mean of a pixel by (\S+) px rms, (\S+) px at most"
    moved = [tuple(map(float, figures)) for figures in re.findall(pairs, text)]
    assert len(moved) == 2
    for rms, most, mean_rms, mean_most in moved:
        assert 1e-6 < mean_rms < rms < most < 1e-2 and mean_rms < mean_most < most
    assert moved[0][0] / 16 < moved[0][2] < moved[0][0] / 4


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("script", "figures"),
    [
        ("trace.py", r"packets +[\d.e+]+ rays/s \(best"),
        ("engine.py", r"warm (?:plan|build) +[\d.]+ s, of them computing [\d.]+ s"),
        ("memory.py", r"^truth, direct {2,}\d+ "),
        ("images.py", r"a frame starts [\d.e+]+ rays"),
        ("cold.py", r"^first build of 01_conventional +[\d.]+ +[\d.]+$"),
        ("chain.py", r"^full rig, one pose +now +truth +[\d.]+ CPU s, certificate -?\d+% of that$"),
    ],
)
def test_a_benchmark_of_speed_prints_its_figures(script: str, figures: str, tmp_path: Path) -> None:
    assert re.search(figures, output_of(script, tmp_path), re.MULTILINE)
