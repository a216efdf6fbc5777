"""Streams, limits and paths as they may be: an error in words with its exit code, or a command that works."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.app.build import default_out
from pipeline.errors import UsageError
from pipeline.jit.files import cache_folder
from pipeline.machine.process import FILES, require_resources

ODD = os.fsdecode(b"b\xff")
DEEP = "/".join(["y" * 200] * 21)


@pytest.mark.parametrize("verb", ["build", "plan", "status"])
@pytest.mark.parametrize(
    ("out", "word"),
    [
        (ODD, "not UTF-8"),
        ("ä".encode().decode("ascii", "surrogateescape"), "PYTHONUTF8=1"),
        ("x" * 300, "255 bytes"),
        (DEEP, "4096 bytes"),
        (str(cache_folder().parent), "compiled kernels"),
    ],
)
def test_an_output_folder_that_cannot_be_is_refused(pipeline, stage, verb, out, word):
    code, output, log = pipeline(verb, stage(), "-o", out)
    assert (code, output) == (2, "") and word in log and "-o" in log


@pytest.mark.parametrize("verb", ["build", "plan", "status"])
def test_the_folder_of_another_stage_is_refused_by_all_verbs(pipeline, stage, verb):
    pipeline("build", stage(), "-o", "out", "-j1")
    code, _, log = pipeline(verb, stage(project={"stage": "other"}), "-o", "out")
    assert code == 2 and "another stage" in log


def test_a_user_without_a_home_is_told_what_names_a_folder(pipeline, stage, monkeypatch):
    def gone() -> Path:
        raise RuntimeError("no home")

    for name in ("PIPELINE_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", gone)
    code, _, log = pipeline("build", stage())
    assert code == 5 and "has no home" in log and "XDG_CACHE_HOME" in log


def test_a_stage_that_no_folder_can_be_named_after_needs_one(tmp_path):
    with pytest.raises(UsageError, match="-o"):
        default_out(tmp_path / "...usda")


def spoken(shell, limit=None, verb=("--version",)):
    """Exit code and stderr of the real command with other streams or limits."""
    command = ["sh", "-c", f'{limit or ":"}; exec "$@" {shell}', "sh", sys.executable, "-m", "pipeline", *verb]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


def test_streams_may_be_closed_and_what_cannot_be_written_is_told():
    for shell in ("<&- >&- 2>&-", "2>/dev/full"):
        assert spoken(shell)[0] == 0
    code, log = spoken(">/dev/full")
    assert code == 5 and log == "error: cannot write to standard output: No space left on device\n"


def test_low_limits_are_told_before_they_crash_a_library():
    for limit, word in (("ulimit -n 12", "12 open files"), ("ulimit -v 1000000", "bytes of address space")):
        code, log = spoken("", limit)
        assert code == 5 and word in log and "ulimit" in log and "Traceback" not in log


def test_a_working_directory_that_is_gone_is_told(tmp_path):
    code, log = spoken("", f"mkdir {tmp_path}/gone; cd {tmp_path}/gone; rmdir {tmp_path}/gone")
    assert code == 5 and "no working directory" in log and "cd" in log and "Traceback" not in log


def test_a_soft_limit_is_raised_as_far_as_it_may():
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (FILES - 1, before[1]))
        require_resources()
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] >= FILES
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
