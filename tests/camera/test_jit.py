"""Compiled kernels are kept under a digest of all sources that can change them, and used only if they are whole."""

import errno
import math
import os
import pickle
import re
import threading
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.compiler_lock import global_compiler_lock
from numba.core.postproc import PostProcessor
from numba.core.types import BaseFunction

from pipeline.app.build import compile_once, project
from pipeline.app.kernel_steps import steps_of
from pipeline.engine.planning.graph import Task
from pipeline.errors import EnvironmentFault
from pipeline.jit import decorators, files
from pipeline.jit.cache import KernelCache
from pipeline.jit.compiler import remembering
from pipeline.jit.decorators import Kernel, _source_digest, inline, kernel, unit
from pipeline.optics.kernels import PACKET, new_packet

ROOT = Path(__file__).parents[2]
SOURCES = {
    "room/__init__.py": "LAST = 3",
    "room/kernels.py": "from pipeline.room.table import ROW\n@kernel\ndef f(x): ...",
    "room/table.py": "from pipeline import units\nimport pipeline.room\nROW = units.MM",
    "units.py": "MM = 1",
    "jit/compiler.py": "OPTIONS = {}",
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


@pytest.mark.parametrize(
    "name", ["room/kernels.py", "room/table.py", "units.py", "room/__init__.py", "jit/compiler.py"]
)
def test_an_edit_of_what_a_kernel_reaches_compiles_anew(package, name):
    """Numba compiles constants in and looks at the kernel's own file alone."""
    before = _source_digest(package)
    (package / name).write_text(SOURCES[name] + "\nX = 1", encoding="utf-8")
    assert _source_digest(package) != before


def test_comments_and_modules_that_no_kernel_reaches_do_not_count(package):
    before = _source_digest(package)
    (package / "apart.py").write_text("Y = 2", encoding="utf-8")
    (package / "units.py").write_text("# a remark\nMM = 1", encoding="utf-8")
    assert _source_digest(package) == before


def test_processes_that_are_started_believe_the_digest_only_of_the_same_bytes(monkeypatch):
    """It takes each of them a third of a second to find by itself."""
    monkeypatch.delenv(decorators._TOLD, raising=False)
    digest_of_this = decorators._digest_of_this.__wrapped__
    digest = digest_of_this()
    monkeypatch.setattr(decorators, "_source_digest", lambda: "found anew")
    assert digest_of_this() == digest
    monkeypatch.setattr(decorators, "_digest_of_bytes", lambda: "of other sources")
    assert digest_of_this() == "found anew"


def test_the_digest_of_bytes_counts_every_source(package):
    before = decorators._digest_of_bytes(package)
    (package / "apart.py").write_text("Y = 2", encoding="utf-8")
    assert decorators._digest_of_bytes(package) != before


def twice(x):
    """What is compiled here."""
    return 2.0 * x


@unit
def sum_of_squares(x, count):
    """Part of a kernel that is compiled once."""
    total = 0.0
    for i in range(count):
        total += square(x[i])
    return total


@inline
def square(x):
    """Part of the part."""
    return x * x


@inline
def itself(x):
    """What no inline function may do."""
    return x


@kernel
def length(x):
    """Driver of a unit."""
    return math.sqrt(sum_of_squares(x, x.size))


class Bomb:
    """Unpickling it makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_functions_that_others_compile_may_call_ours():
    """Also those that make arrays, and call code of Numba for it."""
    made = new_packet.compiled

    @numba.njit
    def rays():
        packet = made()
        return packet.x.shape[0], packet.scratch.shape[1]

    assert rays() == (PACKET, PACKET)


def test_what_others_compile_waits_for_ours_and_finds_numba_as_it_was():
    """Numba is told what we remember while our kernels are compiled, whatever becomes of them."""
    found, taken = (PostProcessor.run, BaseFunction.get_call_type), threading.Event()

    def other():
        with global_compiler_lock:
            assert (PostProcessor.run, BaseFunction.get_call_type) == found
            taken.set()

    thread = threading.Thread(target=other)
    with pytest.raises(ZeroDivisionError), remembering():
        assert PostProcessor.run != found[0] and BaseFunction.get_call_type != found[1]
        thread.start()
        assert not taken.wait(0.5)
        raise ZeroDivisionError
    thread.join(60)
    assert taken.is_set()


@pytest.fixture
def said(monkeypatch):
    """Warnings of this test."""
    monkeypatch.setattr(files, "_said", found := set())
    return found


@pytest.fixture
def folder(tmp_path):
    """Where the kernels of this test are kept."""
    return tmp_path / "jit"


def compiled(folder):
    """Call the kernel as a fresh process would; whether its code came from the folder."""
    dispatcher = numba.njit(twice)
    dispatcher._cache = KernelCache(twice, folder)
    assert dispatcher(4.0) == 8.0
    return bool(dispatcher.stats.cache_hits)


def other_types(path):
    """Leave a right file under a name that it does not belong to."""
    dispatcher = numba.njit(twice)
    dispatcher._cache = KernelCache(twice, path.parent)
    dispatcher(4)
    other = next(file for file in path.parent.iterdir() if file != path)
    other.replace(path)


@pytest.fixture
def fresh(monkeypatch, folder):
    """Gives a driver and its unit as a fresh process has them, with the folder of this test."""
    monkeypatch.setattr("pipeline.jit.decorators.cache_folder", lambda: folder)

    def load():
        unit_of_test, driver = Kernel(sum_of_squares.__wrapped__, "unit"), Kernel(length.__wrapped__, "kernel")
        monkeypatch.setitem(globals(), "sum_of_squares", unit_of_test)
        assert driver(np.array([3.0, 4.0])) == 5.0
        return driver.compiled.stats, unit_of_test.compiled.stats

    return load


def loaded(stats):
    """Whether code came from the folder."""
    return bool(stats.cache_hits) and not stats.cache_misses


def test_a_unit_is_kept_by_itself_and_loaded_before_its_driver(fresh, folder, said):
    assert not any(loaded(stats) for stats in fresh())
    names = sorted(path.name.rsplit(".", 1)[1].rpartition("-")[0] for path in folder.iterdir())
    assert names == ["length-kernel", "sum_of_squares-unit"]
    assert all(loaded(stats) for stats in fresh()) and not said


@pytest.mark.parametrize("damaged", ["length", "sum_of_squares"])
def test_a_damaged_unit_is_compiled_again_and_the_driver_calls_that(fresh, folder, said, damaged):
    fresh()
    next(path for path in folder.iterdir() if damaged in path.name).write_bytes(b"")
    assert [loaded(stats) for stats in fresh()] == [damaged != "length", damaged == "length"]
    assert len(said) == 1 and all(loaded(stats) for stats in fresh())


def test_a_driver_of_a_unit_of_another_name_is_compiled_again(fresh, folder, said, monkeypatch):
    """The linker would end the process."""
    fresh()
    next(path for path in folder.iterdir() if "sum_of_squares" in path.name).unlink()
    monkeypatch.setattr("pipeline.jit.compiler.DriverCompiler.digest", "0123456789abcdef")
    assert not any(loaded(stats) for stats in fresh())
    assert ["there is no" in text for text in said] == [True] and all(loaded(stats) for stats in fresh())


def test_the_code_of_a_unit_is_not_copied_into_its_driver(fresh):
    driver = Kernel(length.__wrapped__, "kernel")
    driver(np.array([3.0, 4.0]))
    (code,) = driver.compiled.inspect_llvm().values()
    assert re.search(r"^declare .*sum_of_squares", code, re.MULTILINE) and "define" in code
    assert not re.search(r"^define .*sum_of_squares", code, re.MULTILINE)


def test_python_may_call_parts_of_kernels():
    assert square(3.0) == 9.0 and sum_of_squares(np.array([3.0, 4.0]), 2) == 25.0


def test_a_unit_that_kernels_have_called_is_no_driver_for_python(fresh, folder):
    """The same function for the same types, in the same folder: its code as a unit has no way in from Python."""
    for _ in range(2):
        fresh()
        assert globals()["sum_of_squares"](np.array([3.0, 4.0]), 2) == 25.0
    assert len(list(folder.iterdir())) == 3


def test_an_inline_function_returns_no_array():
    """It counts no references, so the caller would free what is not its own."""

    @kernel
    def bad(x):
        return itself(x)[0]

    with pytest.raises(TypeError, match="itself is inline"):
        bad(np.zeros(1))


DAMAGE = {
    "empty": lambda path: path.write_bytes(b""),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "cut in the middle": lambda path: path.write_bytes(path.read_bytes()[:1000]),
    "zeros": lambda path: path.write_bytes(bytes(path.stat().st_size)),
    "a flipped bit": lambda path: path.write_bytes(b"\x81" + path.read_bytes()[1:]),
    "of other types": other_types,
    "a pickle": lambda path: path.write_bytes(pickle.dumps(Bomb(path.parent / "executed"))),
    "a folder": lambda path: (path.unlink(), path.mkdir(), (path / "thesis").touch()),
    "a link": lambda path: (path.rename(path.with_name("there")), path.symlink_to("there")),
    "a pipe": lambda path: (path.unlink(), os.mkfifo(path)),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_kernel_is_compiled_again_once_and_never_executed(folder, said, damage):
    assert not compiled(folder) and compiled(folder) and not said
    (path,) = folder.iterdir()
    DAMAGE[damage](path)
    assert not compiled(folder)
    assert [str(path) in text and "compiled again" in text for text in said] == [True]
    assert compiled(folder) and len(said) == 1
    assert not (folder / "executed").exists()


def test_a_kernel_that_is_whole_and_cannot_be_loaded_is_compiled_again(folder, said):
    """As after an update of a library that calls itself by the same version."""
    compiled(folder)
    (path,) = folder.iterdir()
    files.write(path, pickle.dumps(("something", "else")))
    assert not compiled(folder) and "cannot be used" in str(said) and compiled(folder)


def test_a_flipped_bit_anywhere_is_noticed(tmp_path, said):
    path = tmp_path / "k"
    files.write(path, b"kernel")
    whole = path.read_bytes()
    for number in range(8 * len(whole)):
        flipped = bytearray(whole)
        flipped[number // 8] ^= 1 << number % 8
        path.write_bytes(flipped)
        assert files.read(path) is None
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        assert files.read(path) is None
    path.write_bytes(whole)
    assert files.read(path) == b"kernel"


def test_kernels_in_a_folder_that_others_may_write_to_are_not_used(folder, said):
    """They are pickles: reading one is executing it."""
    compiled(folder)
    folder.chmod(0o777)
    assert not compiled(folder) and "was no folder for you alone" in str(said)
    assert folder.stat().st_mode & 0o777 == 0o700 and compiled(folder)


def test_kernels_in_a_folder_of_somebody_else_are_not_used(folder, said, monkeypatch):
    compiled(folder)
    if os.geteuid() == 0:
        os.chown(folder, 12345, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert not compiled(folder) and not compiled(folder)
    assert len(said) == 1 and "others than you" in str(said)
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_a_file_in_the_place_of_the_folder_gets_another_name(folder, said):
    folder.write_text("mine")
    assert not compiled(folder) and compiled(folder)
    assert [path.read_text() for path in folder.parent.glob("jit.*.damaged")] == ["mine"]


def failing(error):
    """A disk that takes nothing."""

    def fail(self, data):
        raise OSError(error, os.strerror(error))

    return fail


def test_a_full_disk_is_an_error_of_the_machine(folder, said, monkeypatch):
    monkeypatch.setattr(Path, "write_bytes", failing(errno.ENOSPC))
    with pytest.raises(EnvironmentFault, match=r"cannot keep compiled kernels in .*No space left") as caught:
        compiled(folder)
    assert "PIPELINE_JIT_CACHE" in caught.value.hint and not list(folder.iterdir())


def test_a_folder_that_cannot_be_written_is_only_slower(folder, said, monkeypatch):
    monkeypatch.setattr(Path, "write_bytes", failing(errno.EROFS))
    assert not compiled(folder) and not compiled(folder)
    assert len(said) == 1 and "every process compiles them" in str(said)


def test_processes_that_compile_at_once_do_not_disturb_one_another(tmp_path, said):
    path, bodies, stop = tmp_path / "k", [bytes([n]) * 50_000 for n in range(4)], threading.Event()

    def writing(body):
        while not stop.is_set():
            files.write(path, body)

    threads = [threading.Thread(target=writing, args=(body,)) for body in bodies]
    for thread in threads:
        thread.start()
    found = [files.read(path) for _ in range(300)]
    stop.set()
    for thread in threads:
        thread.join()
    assert {*found} - {None} <= {*bodies} and None not in found[50:] and not said
    assert [file.name for file in tmp_path.iterdir()] == ["k"]


def test_a_graph_compiles_what_its_tasks_call():
    """The tiny stage searches in position images, examples 2 and 3 have plain microlenses; no target is bent."""

    def steps(stage):
        graph = project(ROOT / stage / "dataset.usda").graph
        return steps_of(graph[name] for name in graph)

    assert steps("tests/data/tiny_conventional") == ("lens", "images", "search")
    assert steps("examples/01_conventional") == ("lens", "images")
    assert steps("examples/02_plenoptic") == ("lens", "micro_images", "images")
    assert steps("examples/03_paper_evaluation") == ("lens", "micro_images", "images")


def test_tilted_microlenses_bent_targets_and_company_have_steps_of_their_own():
    focus = task(
        "focus", {"camera": None, "request": {"microlenses": {"model": "thin", "tilt_x_deg": 0.0, "tilt_y_deg": 1.0}}}
    )
    image = task("image", {"view": {"targets": [{"target": {"kind": "mesh"}}]}})
    assert steps_of([focus]) == ("lens", "microlenses")
    assert steps_of([image, focus]) == ("lens", "microlenses", "images", "company", "shapes")
    lit = task("image", {"view": {"targets": [], "lighting": {"lamps": []}}})
    assert steps_of([lit]) == ("lens", "images", "company", "lighting")
    sheet = {"target": {"surface": {"kind": "flat"}}}
    assert steps_of([task("image_tile", {"view": {"targets": [sheet]}})]) == ("lens", "images")
    assert steps_of([task("image_pass", {"view": {"targets": [sheet, sheet]}})]) == ("lens", "images", "company")
    hidden = {"view": {"targets": [sheet], "occluders": [{}]}}
    assert steps_of([task("image_tile", hidden)]) == ("lens", "images", "company")
    assert steps_of([task("truth_tile", {**hidden, "table": {"settings": {"method": "direct"}}})]) == ("lens",)


def task(kind, params):
    """A task of a graph."""
    return Task(name="x", kind=f"pipeline.tasks.{kind}", params=params, reads={})


def test_a_build_names_the_damaged_kernel_and_compiles_once(tmp_path, monkeypatch):
    from pipeline.jit.decorators import cache_folder

    monkeypatch.setenv("PIPELINE_JIT_CACHE", str(tmp_path))
    calls, said = [], []

    def compile_kernels(steps):
        calls.append(1)
        for name in "ab":
            files.write(cache_folder() / name, name.encode())
        return {"a", "b"}

    monkeypatch.setattr("pipeline.app.compile_kernels.compile_kernels", compile_kernels)
    compile_once(said.append)
    compile_once(said.append)
    assert len(calls) == 1 and not said
    (cache_folder() / "b").write_bytes(b"")
    compile_once(said.append)
    compile_once(said.append)
    assert len(calls) == 2 and len(said) == 1 and str(cache_folder() / "b") in said[0]
    (cache_folder() / "a").unlink()
    compile_once(said.append)
    assert len(calls) == 3
