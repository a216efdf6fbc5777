"""Claim: what a device runs gives the bits of processors, shown in CUDA's simulator, which is part of Numba."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
ROUNDING_MM = 1e-9
"""Rows on a device and on processors may differ by this, where the order of sums is another one."""


def simulated(*arguments: str) -> list[list[str]]:
    """Lines of `simulated.py`: rig, samples, square, bundles with light, whether all bits are equal, difference."""
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": str(TESTS)}
    command = [sys.executable, str(TESTS / "device" / "simulated.py"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return [line.split() for line in done.stdout.splitlines()]


def test_moments_in_the_simulator_have_the_bits_of_processors() -> None:
    """With microlenses of every model, too, with squares, and where rays are weighed."""
    rows = simulated()
    assert len(rows) == 8
    for name, _, _, lit, same, difference in rows:
        assert int(lit) > 0, name
        assert same == "True", f"{name} differs by {difference}"


@pytest.mark.heavy
def test_more_samples_than_a_packet_holds_differ_by_rounding_alone() -> None:
    name, samples, _, lit, _, difference = simulated("--long")[-1]
    assert (name, samples, lit) == ("conventional", "1024", "3")
    assert float(difference) < ROUNDING_MM
