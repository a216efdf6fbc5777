"""Compiled kernels are kept under a digest of all sources that can change them, in a folder that is its user's alone.
While one runs, other threads go on, such as a worker's heartbeat; times of loading and of calls do not mix.
"""

import copy
import errno
import io
import itertools
import os
import shutil
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from places import ROOT
from rich.console import Console

from pipeline.app import build as building
from pipeline.app.build import compile_once, project, steps_of
from pipeline.app.progress import Bar, Lines
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.engine.events import Compiling
from pipeline.errors import EnvironmentFault, warn_once
from pipeline.jit import decorators, files
from pipeline.jit.decorators import Kernel, kernel, opaque
from pipeline.jit.files import cache_folder, make_folder, set_ready
from pipeline.jit.work import calling, loading, work
from pipeline.machine.facts import command

SOURCES = {
    "room/__init__.py": "LAST = 3",
    "room/kernels.py": "from pipeline.room.table import ROW\n@kernel\ndef f(x): ...",
    "room/table.py": "from pipeline.parts import units\nimport pipeline.room\nROW = units.MM",
    "parts/units.py": "MM = 1",
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
    reached = files._sources_of_kernels(package)
    assert {str(path.relative_to(package)): source.decode() for path, source in reached.items()} == {
        name: text for name, text in SOURCES.items() if name != "apart.py"
    }


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where kernels would be kept: nothing is there."""
    monkeypatch.setenv("PIPELINE_JIT_CACHE", str(tmp_path / "jit"))
    warn_once.cache_clear()
    return cache_folder()


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


def test_an_opaque_function_is_compiled_when_it_first_runs(monkeypatch):
    """What goes wrong then is raised by the kernel, and no trace of it is left."""
    values = np.ones(1)
    double_or_negate(values, True)
    assert values == 2.0 and len(double._addresses) == 1 and not negative._addresses
    with monkeypatch.context() as here, pytest.raises(KeyboardInterrupt):
        here.setattr(Kernel, "address", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        double_or_negate(values, False)
    values[0] = 3.0
    double_or_negate(values, False)
    assert values == -3.0 and len(negative._addresses) == 1


def test_a_changed_callee_is_compiled_again_by_the_next_process(tmp_path):
    """The kernel that calls it by its address did not change. Sizes of the texts differ: Python takes byte code of the
    same second and size for that of the other text."""
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

    assert [driven(number) for number in (1.0, 22.0)] == [1.0, 22.0]


def test_a_folder_for_kernels_is_private_and_stays(folder):
    assert make_folder() == make_folder() == folder
    assert folder.stat().st_mode & 0o777 == 0o700


FLAWS = {
    "others may write to it": lambda folder: folder.chmod(0o777),
    "a file": lambda folder: (shutil.rmtree(folder), folder.write_text("mine")),
    "a link": lambda folder: (folder.rename(folder.with_name("there")), folder.symlink_to("there")),
    "nothing, where nobody may write": lambda folder: (
        shutil.rmtree(folder.parent),
        folder.parent.touch(),
    ),
}


@pytest.mark.parametrize("flaw", FLAWS)
def test_code_that_others_may_have_put_there_is_not_used(folder, capsys, flaw):
    """It is a pickle: reading it is executing it. Processes that this one starts use the same stand-in."""
    (make_folder() / "code.nbc").touch()
    FLAWS[flaw](folder)
    stand_in = make_folder()
    assert stand_in != folder and not [*stand_in.iterdir()] and stand_in.parent.stat().st_mode & 0o777 == 0o700
    assert cache_folder() == make_folder() == stand_in and os.environ["PIPELINE_JIT_CACHE"] == str(stand_in.parent)
    assert capsys.readouterr().err.count("cannot keep compiled kernels in") == 1


def test_a_folder_of_somebody_else_is_not_used(folder, monkeypatch):
    make_folder()
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    os.chown(folder, 54321, -1) if os.getuid() == 0 else None
    assert make_folder() != folder


def test_a_folder_that_can_only_be_read_lends_a_copy(folder, monkeypatch):
    """Numba itself takes no code from such a folder."""
    (make_folder() / "code.nbc").touch()
    with monkeypatch.context() as here:
        here.setattr(os, "access", lambda path, mode: False)
        stand_in = make_folder()
    assert stand_in != folder and [path.name for path in stand_in.iterdir()] == ["code.nbc"]


def test_a_graph_compiles_what_its_tasks_call():
    """The stage of `reading` searches in position images and has a sensor; no lens here has an asphere."""

    def steps(stage):
        graph = project(ROOT / stage / "dataset.usda").graph
        return steps_of(graph[name] for name in graph)

    assert steps("tests/data/reading") == ("lens", "micro_images", "images", "search", "sensor")
    assert steps("examples/01_conventional") == ("lens", "images")
    assert steps("examples/02_plenoptic") == ("lens", "micro_images", "images")
    assert steps("examples/03_paper_evaluation") == ("lens", "micro_images", "images")


def test_a_build_compiles_nothing_twice_and_a_full_disk_is_an_error_of_the_machine(folder, monkeypatch):
    calls = []

    def fake(steps):
        calls.append(steps)
        if len(calls) == 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("pipeline.app.compile_kernels.compile_kernels", fake)
    with pytest.raises(EnvironmentFault, match=r"cannot keep compiled kernels in .*No space left"):
        compile_once()
    compile_once()
    compile_once()
    assert len(calls) == 2


def test_a_wait_is_told_with_what_is_left_by_the_speed_of_this_machine(folder, monkeypatch):
    """On a machine ten times as slow as that of the known costs these are believed at first, then what was seen."""
    told = []
    monkeypatch.setattr(building, "_KERNELS", {"lens": 20})
    monkeypatch.setattr(building, "_KERNEL_S", 0.02)

    def slowly(steps):
        for k in range(5, 20):
            time.sleep(0.2)
            (code / f"{k}.nbi").touch()

    (code := make_folder() / "room").mkdir()
    for k in range(5):  # of a process that was ended
        (code / f"{k}.nbi").touch()
    monkeypatch.setattr("pipeline.app.compile_kernels.compile_kernels", slowly)
    compile_once(told.append, ("lens",))
    shares, left = [event.share for event in told], [event.seconds_left for event in told]
    assert shares == sorted(shares) and shares[0] == 0.25 and shares[-1] > 0.9 and 0.3 <= left[0] < 1.5
    middle = min(range(len(told)), key=lambda k: abs(shares[k] - 0.5))
    assert left[middle] > 1 and left[-1] < 1
    compile_once(told.append, ("lens",))
    assert len(told) == len(shares)  # nothing is told where nothing is compiled


def test_whoever_explains_is_called_once_before_a_process_compiles_and_not_before_it_loads(folder, monkeypatch):
    calls, values = [], np.ones(1)
    monkeypatch.setattr(decorators, "before_compiling", first := [lambda: calls.append(1)])
    for _ in range(2):
        double_or_negate(values, True)
    assert len(calls) == 1
    set_ready(make_folder(), ["lens"])
    first.append(lambda: calls.append(1))
    double_or_negate(values, True)
    assert len(calls) == 1 and not first


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


def test_a_helper_ends_with_the_process_that_started_it(tmp_path):
    """As after SIGTERM, which ends that one at once: nobody waits for the kernels any more."""
    numbers, writing = os.pipe()
    os.write(writing, bytes(1))
    helper = subprocess.Popen(
        command("pipeline.app.compile_kernels:compile_apart", "lens"),
        env=os.environ | {"PIPELINE_JIT_CACHE": str(tmp_path)},
        stdin=numbers,
    )
    os.close(numbers)
    while not [*tmp_path.glob("*/*")]:
        time.sleep(0.05)
    os.close(writing)
    assert helper.wait(timeout=20.0) == 1


def test_two_processes_compile_each_kernel_once_and_a_cut_one_is_named(folder):
    """What one compiles, the other one waits for: Numba keeps a file per types, numbered from 1."""
    settings = {**os.environ, "NUMBA_DEBUG_CACHE": "1", "PYTHONUNBUFFERED": "1"}
    asked = command("pipeline.app.compile_kernels:compile_apart", "search")
    pipes = [os.pipe() for _ in "ab"]
    both = [
        subprocess.Popen(asked, env=settings, stdin=numbers, stdout=subprocess.PIPE, text=True) for numbers, _ in pipes
    ]
    for _, writing in pipes:
        os.write(writing, bytes([0, 1, 2, 99]))
    lines = [line for process in both for line in process.communicate()[0].splitlines()]
    for end in itertools.chain(*pipes):
        os.close(end)
    saved = [line for line in lines if line.startswith("[cache] data saved to")]
    assert [process.returncode for process in both] == [0, 0] and len(saved) == len(set(saved)) >= 3
    assert len(saved) == len([*folder.rglob("*.nbc")]) and files.count(folder) == len([*folder.rglob("*.nbi")])
    (code,) = folder.rglob("*.quads_that_hold-*.nbc")
    code.write_bytes(b"")
    look = "from pipeline.app import compile_kernels; compile_kernels.compile_kernels(['search'])"
    done = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=False)
    assert "quads_that_hold is damaged" in done.stderr and f"remove {folder}" in done.stderr


def busy(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def test_time_to_load_is_no_time_of_the_kernel():
    before = copy.deepcopy(work())
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
