"""Compiled kernels are kept under a digest of all sources that can change them, and used only if they are whole. While
one runs, other threads go on, such as a worker's heartbeat; times of loading and of calls do not mix.
"""

import errno
import io
import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from places import ROOT
from rich.console import Console

from pipeline.app import build as building
from pipeline.app.build import compile_once, project, steps_of
from pipeline.app.compile_kernels import Part, shares
from pipeline.app.progress import Bar, Lines
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.engine.events import Compiling
from pipeline.errors import EnvironmentFault
from pipeline.jit import decorators, files
from pipeline.jit.decorators import Kernel, kernel, opaque
from pipeline.jit.work import calling, loading, work
from pipeline.machine.facts import command

SOURCES = {
    "room/__init__.py": "LAST = 3",
    "room/kernels.py": "from pipeline.room.table import ROW\n@kernel\ndef f(x): ...",
    "room/table.py": "from pipeline import units\nimport pipeline.room\nROW = units.MM",
    "units.py": "MM = 1",
    "apart.py": "from pipeline.room import kernels",
}


@pytest.fixture
def package(tmp_path):
    """A package with a kernel that reads a constant which comes from another one."""
    for name, text in SOURCES.items():
        path = tmp_path / "pipeline" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return tmp_path / "pipeline"


def test_kernels_are_known_by_all_sources_that_they_reach(package):
    """Numba compiles constants in and looks at the kernel's own file alone."""
    reached = decorators._reached(package)
    assert {str(path.relative_to(package)) for path in reached} == {*SOURCES} - {"apart.py"}
    before = decorators._digest_of(reached)
    (package / "units.py").write_text("MM = 2", encoding="utf-8")
    assert decorators._digest_of(reached) != before


def twice(x):
    return 2.0 * x


@pytest.fixture
def said(monkeypatch):
    monkeypatch.setattr(files, "_warned", texts := set())
    return texts


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where the kernels of this test are kept."""
    monkeypatch.setattr(decorators, "cache_folder", lambda: tmp_path / "jit")
    return tmp_path / "jit"


def is_loaded(value=4.0):
    """Call the kernel as a fresh process would; whether its code came from the folder."""
    fresh = Kernel(twice, "kernel")
    assert fresh(value) == 2.0 * value
    return bool(fresh.compiled.stats.cache_hits)


def code_in(folder):
    """The code of the kernel, and not Numba's index."""
    (path,) = folder.rglob("*.twice-*.nbc")
    return path


def test_a_kernel_of_other_types_is_kept_beside(folder, said):
    fresh = Kernel(twice, "kernel")
    assert fresh(4.0) == fresh(4) == 8.0
    assert is_loaded() and is_loaded(4) and not said


@opaque
def double(values):
    values[0] *= 2.0


@opaque
def negative(value) -> float:
    return -value


@kernel
def double_or_negate(values, is_doubled):
    if is_doubled:
        double(values)
    else:
        values[0] = negative(values[0])


def test_an_opaque_function_is_compiled_when_it_first_runs(folder, monkeypatch):
    """Until then it is not in the cache. What goes wrong then is raised by the kernel, and no trace of it is left."""
    values = np.ones(1)
    double_or_negate(values, True)
    assert values == 2.0 and not [*folder.glob("*.negative-*")]
    with monkeypatch.context() as here, pytest.raises(KeyboardInterrupt):
        here.setattr(Kernel, "address", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        double_or_negate(values, False)
    values[0] = 3.0
    double_or_negate(values, False)
    assert values == -3.0 and len([*folder.glob("*.negative-opaque/*/*.nbc")]) == 1


def test_a_changed_callee_is_compiled_again_by_the_next_process(tmp_path):
    """The kernel that calls it by its address did not change."""
    package = shutil.copytree(ROOT / "pipeline", tmp_path / "pipeline", ignore=shutil.ignore_patterns("__pycache__"))
    (package / "driver.py").write_text(
        "from pipeline.callee import put\nfrom pipeline.jit.decorators import kernel\n\n\n"
        "@kernel\ndef drive(values):\n    put(values)\n"
    )

    def driven(number):
        (package / "callee.py").write_text(
            f"from pipeline.jit.decorators import opaque\n\n\n@opaque\ndef put(values):\n    values[0] = {number}\n"
        )
        code = "import numpy, pipeline.driver as d; v = numpy.zeros(1); d.drive(v); print(v[0], d.__file__)"
        environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PIPELINE_JIT_CACHE": str(tmp_path / "jit")}
        said = subprocess.check_output([sys.executable, "-c", code], env=environment, cwd=tmp_path, text=True)
        number, path = said.split()
        assert path.startswith(str(tmp_path))
        return float(number)

    assert [driven(number) for number in (1.0, 2.0)] == [1.0, 2.0]


def test_two_processes_share_parts_by_their_cost():
    both = shares([Part("", seconds, list) for seconds in (1.0, 5.0, 2.0, 3.0)])
    assert [[part.seconds for part in some] for some in both] == [[5.0, 1.0], [3.0, 2.0]]


DAMAGE = {
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "a flipped bit": lambda path: path.write_bytes(b"\x81" + path.read_bytes()[1:]),
    "another": lambda path: path.with_name("another.nbc").write_bytes(path.read_bytes()),
    "none": lambda path: path.unlink(),
    "a folder": lambda path: (path.unlink(), path.mkdir()),
    "a link": lambda path: (path.rename(path.with_name("there")), path.symlink_to("there")),
    "a pipe": lambda path: (path.unlink(), os.mkfifo(path)),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_kernel_is_compiled_again_once_and_never_executed(folder, said, damage):
    assert not is_loaded() and is_loaded() and not said
    DAMAGE[damage](code_in(folder))
    assert not is_loaded()
    assert ["is damaged" in text and str(folder) in text for text in said] == [True]
    assert is_loaded() and len(said) == 1


def test_code_of_a_process_that_was_killed_before_it_closed_the_folder_is_not_used(folder, said):
    is_loaded()
    next(folder.rglob("SHA256SUMS")).unlink()
    assert not is_loaded() and is_loaded() and not said


def test_kernels_in_a_folder_that_others_may_write_to_are_not_used(folder, said):
    """They are pickles: reading one is executing it."""
    is_loaded()
    folder.chmod(0o777)
    assert not is_loaded() and "was no folder for you alone" in str(said)
    assert folder.stat().st_mode & 0o777 == 0o700 and is_loaded()


def test_kernels_in_a_folder_of_somebody_else_are_not_used(folder, said, monkeypatch):
    is_loaded()
    if os.geteuid() == 0:
        os.chown(folder, 12345, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert not is_loaded() and len(said) == 1 and "every process compiles them" in str(said)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_a_folder_that_can_only_be_read_lends_a_copy(folder, said, monkeypatch):
    """Numba itself takes no code from such a folder."""
    is_loaded()
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert is_loaded() and not said
    assert not is_loaded(4) and {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_a_file_in_the_place_of_the_folder_gets_another_name(folder, said):
    folder.write_text("mine")
    assert not is_loaded() and is_loaded()
    assert [path.read_text() for path in folder.parent.glob("jit.*.damaged")] == ["mine"]


def test_a_full_disk_is_an_error_of_the_machine(folder, said, monkeypatch):
    def fail(path, *arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_text", fail)
    with pytest.raises(EnvironmentFault, match=r"cannot keep compiled kernels in .*No space left") as caught:
        is_loaded()
    assert "PIPELINE_JIT_CACHE" in caught.value.hint


def test_a_graph_compiles_what_its_tasks_call():
    """The stage of `reading` searches in position images and has a sensor; no lens here has an asphere."""

    def steps(stage):
        graph = project(ROOT / stage / "dataset.usda").graph
        return steps_of(graph[name] for name in graph)

    assert steps("tests/data/reading") == ("lens", "micro_images", "images", "search", "sensor")
    assert steps("examples/01_conventional") == ("lens", "images")
    assert steps("examples/02_plenoptic") == ("lens", "micro_images", "images")
    assert steps("examples/03_paper_evaluation") == ("lens", "micro_images", "images")


def test_a_build_compiles_what_is_damaged_and_nothing_twice(folder, said, monkeypatch):
    calls = []

    def fake(steps):
        calls.append(1)
        is_loaded()
        return {path.name for path in folder.glob("*-kernel")}

    monkeypatch.setattr("pipeline.app.build.cache_folder", lambda: folder)
    monkeypatch.setattr("pipeline.app.compile_kernels.compile_kernels", fake)
    compile_once()
    compile_once()
    assert len(calls) == 1 and not said
    code_in(folder).write_bytes(b"")
    compile_once()
    compile_once()
    assert len(calls) == 2 and len(said) == 1
    (listed,) = folder.glob("*.txt")
    listed.write_text("")
    compile_once()
    assert len(calls) == 3


def test_a_wait_is_told_with_what_is_left_by_the_speed_of_this_machine(folder, monkeypatch):
    """On a machine ten times as slow as that of the known costs these are believed at first, then what was seen."""
    told = []
    monkeypatch.setattr(building, "cache_folder", lambda: folder)
    monkeypatch.setattr(building, "_KERNELS", {"lens": 20})
    monkeypatch.setattr(building, "_KERNEL_S", 0.02)

    def slowly(steps):
        for k in range(5, 20):
            time.sleep(0.2)
            (folder / str(k)).mkdir()
            (folder / str(k) / "SHA256SUMS").touch()
        return []

    for k in range(5):  # of a process that was ended
        (folder / str(k)).mkdir(parents=True)
        (folder / str(k) / "SHA256SUMS").touch()
    folder.chmod(0o700)
    monkeypatch.setattr("pipeline.app.compile_kernels.compile_kernels", slowly)
    compile_once(told.append, ("lens",))
    shares, left = [event.share for event in told], [event.seconds_left for event in told]
    assert shares == sorted(shares) and shares[0] == 0.25 and shares[-1] > 0.9 and 0.3 <= left[0] < 1.5
    middle = min(range(len(told)), key=lambda k: abs(shares[k] - 0.5))
    assert left[middle] > 1 and left[-1] < 1
    compile_once(told.append, ("lens",))
    assert len(told) == len(shares)  # nothing is told where nothing is compiled


def test_whoever_explains_is_called_once_before_a_process_compiles_and_not_before_it_loads(folder, monkeypatch):
    calls = []
    monkeypatch.setattr(decorators, "before_compiling", first := [lambda: calls.append(1)])
    assert not is_loaded() and len(calls) == 1
    first.append(lambda: calls.append(1))
    assert is_loaded() and len(calls) == 1


def test_a_log_has_one_plain_line_of_a_wait_and_a_narrow_terminal_bar_and_time(capsys, monkeypatch):
    for verbosity, line in ((0, "compiling kernels, once per version: about 40 s\n"), (-1, "")):
        lines = Lines(verbosity)
        for left_s in (40, 39):
            lines(Compiling(share=0.5, seconds_left=left_s))
        assert capsys.readouterr().err == line
    monkeypatch.setenv("COLUMNS", "40")
    with Bar() as bar:
        bar(Compiling(share=0.5, seconds_left=83))
        drawn = Console(file=io.StringIO(), width=40)
        drawn.print(bar._progress.get_renderable())
    (text,) = drawn.file.getvalue().splitlines()
    assert "━━━━━" in text and "83 s left" in text and "0:00:0" in text and len(text) <= 40


def test_two_processes_compile_each_kernel_once_and_name_the_folders_that_they_opened(tmp_path):
    """What one compiles, the other one waits for: Numba keeps a file per types, numbered from 1."""
    environment = {**os.environ, "PIPELINE_JIT_CACHE": str(tmp_path / "jit"), "NUMBA_DEBUG_CACHE": "1"}
    environment.pop("PYTHONUNBUFFERED", None)  # what is said last must arrive all the same
    both = [
        subprocess.Popen(
            command("pipeline.app.compile_kernels:compile_apart", share, "search", "sensor"),
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        for share in ("0", "1")
    ]
    lines = [line for process in both for line in process.communicate()[0].splitlines()]
    saved = [line for line in lines if line.startswith("[cache] data saved to")]
    names = {line for line in lines if not line.startswith("[cache]")}
    assert [process.returncode for process in both] == [0, 0] and len(saved) == len(set(saved)) > len(names) / 2
    assert names == {path.name for path in tmp_path.glob("jit/*/*")}
    assert {"quads_that_hold-kernel", "solve_quads-kernel"} <= {name.rpartition(".")[2] for name in names}
    assert all(files.is_whole(path) for path in tmp_path.glob("jit/*/*"))


def busy(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def test_time_to_load_is_no_time_of_the_kernel():
    before = work().copy()
    with calling("k"):
        with loading():
            busy(0.04)
        busy(0.01)
    done = work().since(before)
    assert 0.01 <= done.kernels["k"].seconds < 0.03 and done.kernels["k"].calls == 1
    assert 0.04 <= done.loading_s < 0.06


def test_a_thread_ticks_while_a_bundle_is_traced(conventional):
    """Ten ticks or more; a held lock would give one or two in all, however busy the machine."""
    tracer = Tracer(conventional)
    n = 2000
    arguments = (np.zeros((n, 2)), np.full(n, -1), parallel_planes(300.0, 600.0), 4096, np.zeros((n, 2), np.int64))
    tracer.moments(*(argument[:1] if isinstance(argument, np.ndarray) and len(argument) == n else argument
                     for argument in arguments))  # fmt: skip
    ticks, stop = [], threading.Event()

    def tick() -> None:
        while not stop.wait(0.01):
            ticks.append(time.perf_counter())

    thread = threading.Thread(target=tick)
    thread.start()
    start = time.perf_counter()
    tracer.moments(*arguments)
    seconds = time.perf_counter() - start
    stop.set()
    thread.join()
    inside = [at for at in ticks if start < at < start + seconds]
    assert seconds > 0.2 and len(inside) >= 10
