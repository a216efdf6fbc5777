"""What a person sees: nothing in a file or a name steers the terminal, and a full disk leaves nothing, by name."""

import functools
import resource
import subprocess
import sys

import pytest

LENS, SENSOR = "lenses/double_gauss_100mm_tronnier.usda", "sensors/bayer_640x480_10um.usda"
RIG = ("new", "rig", "r.usda", "--lens", LENS, "--sensor", SENSOR)


@pytest.mark.parametrize("name", ["a\nb", "a\x1b\nb", "n" * 300])
def test_a_name_that_no_file_should_have_is_refused(name, run):
    code, output, log = run("verify", name)
    assert (code, output) == (2, "") and "an argument h" in log
    assert "\x1b" not in log and len(log.splitlines()) == 2


def test_a_full_disk_leaves_nothing_and_names_the_file(tmp_path):
    folder = tmp_path / "own"
    folder.mkdir()
    command = [sys.executable, "-m", "pipeline", *RIG, "--focus", "400"]
    limit = functools.partial(resource.setrlimit, resource.RLIMIT_FSIZE, (100, 100))
    ended = subprocess.run(command, cwd=folder, capture_output=True, preexec_fn=limit, check=False)
    assert ended.returncode == 5 and b"r.usda" in ended.stderr and not any(folder.iterdir())
