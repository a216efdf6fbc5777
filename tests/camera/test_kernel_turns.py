"""A kernel is compiled by one process at a time; the others wait for its file, also for that of one that was killed."""

import os
import subprocess
import sys
import threading

import pytest

from pipeline.jit import files, turns
from pipeline.machine.another_python import command

HOLD = """
import sys
from pathlib import Path
from pipeline.jit import files, turns
path = Path(sys.argv[1])
turns.take(path)
print("mine", flush=True)
sys.stdin.readline()
files.write(path, b"code")
turns.end(path)
sys.stdin.readline()
"""


@pytest.fixture
def path(tmp_path):
    """File of a kernel in a folder of kernels."""
    files.make_folder(tmp_path / "jit")
    return tmp_path / "jit" / "kernel"


@pytest.fixture
def other(path):
    """A process that compiles the kernel."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "mine\n"
        yield process
        process.kill()


def waiting_for(path, read):
    """A thread that waits for its turn and then reads the kernel."""

    def wait():
        turns.take(path)
        read.append(files.read(path))

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    thread.join(0.2)
    return thread


def test_who_waits_finds_the_code(path, other):
    read = []
    thread = waiting_for(path, read)
    assert thread.is_alive()
    other.stdin.write("\n")
    other.stdin.flush()
    thread.join(10)
    assert read == [b"code"]


def test_the_turn_of_a_process_that_is_killed_ends(path, other):
    read = []
    thread = waiting_for(path, read)
    assert thread.is_alive()
    other.kill()
    thread.join(10)
    assert read == [None]


def test_other_kernels_do_not_wait(path, other):
    turns.take(path.with_name("another"))
    turns.end_all(path.parent)


def test_a_folder_where_nothing_can_be_written_has_no_turns(tmp_path):
    (tmp_path / "file").touch()
    turns.take(tmp_path / "file" / "jit" / "kernel")
    turns.end_all(tmp_path / "file" / "jit")


PARTS = """
import os, sys, time
from pipeline.app import compile_kernels
notes = sys.argv[1]
def part(name):
    def note():
        with open(notes, "a") as file:
            print(name, os.getpid(), file=file, flush=True)
        time.sleep(2.0)
    return note
compile_kernels._RUN = {"lens": [part(name) for name in "abcd"]}
sys.argv[1:] = ["lens"]
compile_kernels.compile_apart()
"""


def test_two_processes_compile_from_both_ends_what_follows_the_first_part(tmp_path):
    """Errors of the second are silent: without it a build would be slower, and nobody would see why."""
    notes = tmp_path / "notes"
    subprocess.run([sys.executable, "-c", PARTS, str(notes)], check=True)
    first, *others = [line.split() for line in notes.read_text().splitlines()]
    one = first[1]
    assert [name for name, process in (first, *others) if process == one] == ["a", "b", "c", "d"]
    assert [name for name, process in others if process != one][:2] == ["d", "c"]
    assert len({process for _, process in others}) == 2


def test_a_process_apart_names_the_files_that_it_compiled(tmp_path):
    apart = command("pipeline.app.compile_kernels:compile_apart", "search")
    environment = {**os.environ, "PIPELINE_JIT_CACHE": str(tmp_path)}
    environment.pop("PYTHONUNBUFFERED", None)  # what is said last must arrive all the same
    said = subprocess.run(apart, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout.split()
    names = {path.name for path in tmp_path.glob("*/*")}
    assert set(said) == names
    assert {"quads_that_hold-kernel", "solve_quads-kernel", "nearest_positions-kernel"} <= {
        name.rsplit(".", 1)[1].rpartition("-")[0] for name in names
    }
