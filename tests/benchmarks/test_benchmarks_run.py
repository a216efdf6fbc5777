"""The benchmarks run on tiny stages and say what the README of benchmarks/ promises; figures come from full runs."""

import os
import re
import subprocess
import sys
from pathlib import Path

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


def output_of(script: str, folder: Path) -> str:
    """Standard output of a benchmark with --small, run in an empty folder with a store of its own."""
    command = [sys.executable, str(BENCHMARKS / script), "--small"]
    environment = {**os.environ, "PIPELINE_CACHE": str(folder / "store")}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert [entry.name for entry in folder.iterdir() if entry.name != "store"] == []
    return done.stdout


def test_the_race_reports_a_rate_per_lens_with_peers_or_without(tmp_path: Path) -> None:
    """Three races, six shapes and two cameras, each with rays per second; about three quarters of rays pass at f/2."""
    text = output_of("trace.py", tmp_path)
    assert len(re.findall(r"packets +[\d.e+]+ rays/s \(best", text)) == 3
    assert len(re.findall(r"ray-surfaces/s, costs [\d.]+ spheres, passing: 100.00%", text)) == 6
    assert len(re.findall(r"tiny_\w+, 64 samples +[\d.e+]+ rays/s", text)) == 2
    assert [round(float(share)) for share in re.findall(r"([\d.]+)% pass", text)] == [77, 75, 77]


def test_both_methods_agree_with_solutions_that_know_no_grid(tmp_path: Path) -> None:
    """A conventional camera loses no corner, no search finds rows that do not exist, the reference is the finer one."""
    text = output_of("truth.py", tmp_path)
    lines = re.findall(r"^  (two-plane|image) +all +(\d+) +(\d+) +[\d.]+% +(.*)$", text, re.MULTILINE)
    assert [method for method, *_ in lines] == ["two-plane", "image"] * 2
    assert [(exist, found) for _, exist, found, _ in lines[:2]] == [("12", "12")] * 2
    for *_, figures in lines:
        _, rms, worst, *_, reference = map(float, figures.split())
        assert rms < 0.01 and worst < 0.05, "px: 64 samples scatter a few thousandths of a pixel"
        assert reference < rms / 3
    assert "does not know" not in text
