"""What a key says about the machine: libraries are told which code to choose, or state which they have chosen."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from engine import toy

from pipeline.engine.planning.plan import Specs, plan
from pipeline.engine.running.driver import run
from pipeline.engine.running.execute import perform
from pipeline.machine import facts, processor

TELL = "from pipeline.machine import facts; facts.print_facts()"
OTHER_KERNELS = {"OPENBLAS_CORETYPE": "Nehalem"}
ON_X86 = pytest.mark.skipif(not processor.settings().get("OPENBLAS_CORETYPE"), reason="no levels of processors here")


def told_by(code, **environment):
    """Facts that a process prints which starts in this environment."""
    settings = {**os.environ, **environment}
    done = subprocess.run([sys.executable, "-c", code], env=settings, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def here():
    """Facts of a process that nobody told anything."""
    return told_by(TELL)


def test_tests_compute_as_the_command_does(here):
    assert processor.pin()
    assert facts.facts({"numpy"}) == here
    assert here.keys() == {"level", "libc", "numpy"}


@ON_X86
def test_kernels_that_the_environment_asks_for_are_not_taken(here):
    others = {"OPENBLAS_CORETYPE": "SkylakeX", "NUMBA_CPU_NAME": "generic", "OPENBLAS_NUM_THREADS": "8"}
    assert told_by(TELL, NPY_DISABLE_CPU_FEATURES="X86_V4", **others) == here


@ON_X86
def test_numba_compiles_as_ever_whatever_lies_in_the_working_directory(tmp_path):
    """It reads .numba_config.yaml from there; without compiling, a build takes days."""
    pytest.importorskip("yaml")
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1\nopt: 0\nloop_vectorize: 0\nboundscheck: 1\n")
    code = "from pipeline.jit.decorators import _numba; from numba.core import config as c; _numba(); "
    code += "print(c.DISABLE_JIT, int(c.OPT), c.LOOP_VECTORIZE, c.SLP_VECTORIZE, c.BOUNDSCHECK)"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["0", "1", "1", "0", "0"]


def test_the_library_of_colours_is_as_exact_as_ever_whatever_it_is_told():
    """It takes its precision from the environment; in single precision, spectra would be others."""
    code = "import json, numpy as np; from colour.models import eotf_inverse_sRGB; "
    code += "print(json.dumps(np.asarray(eotf_inverse_sRGB(np.linspace(0.0, 1.0, 999))).tolist()))"
    right = [12.92 * x if x <= 0.0031308 else 1.055 * x ** (1 / 2.4) - 0.055 for x in np.linspace(0.0, 1.0, 999)]
    pinned = f"from pipeline.machine.processor import pin; pin(); {code}"
    found = told_by(pinned, COLOUR_SCIENCE__DEFAULT_FLOAT_DTYPE="float32")
    assert np.abs(np.subtract(found, right)).max() < 1e-15


def test_a_program_that_loaded_numpy_first_knows_what_it_computes_itself_and_what_its_workers_do(here):
    code = """
import numpy, json
from pipeline.machine import facts
print(json.dumps([facts.facts({"numpy"}), facts.facts_of_workers({"numpy"})]))
"""
    own, of_workers = told_by(code, **OTHER_KERNELS)
    assert of_workers == here
    assert own == {**here, "numpy": "OpenBLAS Nehalem"}


def test_code_that_the_environment_forbids_shows_where_it_cannot_be_overridden(here):
    tunables = "glibc.cpu.hwcaps=-AVX2_Usable"
    assert told_by(TELL, GLIBC_TUNABLES=tunables) == {**here, "libc": f"{here['libc']}, GLIBC_TUNABLES={tunables}"}
    code = f"import numpy; {TELL}"
    assert told_by(code, NPY_DISABLE_CPU_FEATURES="X86_V4")["numpy"].endswith("NPY_DISABLE_CPU_FEATURES=X86_V4")


def test_what_reaches_no_numpy_does_not_depend_on_it():
    assert facts.facts({"python", "networkx"}).keys() == {"level", "libc"}


@pytest.mark.parametrize(
    ("flags", "level", "kernels"),
    [
        ("avx512f avx512bw avx512cd avx512dq avx512vl avx2 bmi2 fma sse4_2 popcnt", "x86_64-v4", "Haswell"),
        ("avx2 bmi2 fma sse4_2 popcnt avx512f", "x86_64-v3", "Haswell"),
        ("sse4_2 popcnt avx", "x86_64-v2", "Nehalem"),
        ("asimd", "x86_64", None),
    ],
)
def test_processors_of_a_level_get_the_same_settings(flags, level, kernels, monkeypatch):
    monkeypatch.setattr(processor.os, "uname", lambda: SimpleNamespace(machine="x86_64"))
    monkeypatch.setattr(processor, "_flags", lambda: set(flags.split()))
    monkeypatch.setattr(processor, "level", processor.level.__wrapped__)
    assert processor.level() == level
    settings = processor.settings()
    assert settings.get("OPENBLAS_CORETYPE") == kernels
    assert settings.get("NUMBA_CPU_NAME") == (level.replace("_", "-") if kernels else None)


@pytest.fixture
def moved(monkeypatch, store):
    """A task that was built before the C library changed."""
    graph = toy.graph_of(("lens", "lens", {"power": 1.0}))
    spec = Specs(store).of(graph["lens"], {})
    run(graph, store)
    monkeypatch.setattr(facts.platform, "libc_ver", lambda: ("glibc", "9.99"))
    return graph, spec


def test_explain_names_the_fact_that_changed(moved, store, kit):
    graph, spec = moved
    reasons = plan(graph, store, {"lens": spec.key})[0].reasons
    assert [(reason.field, reason.new) for reason in reasons] == [("machine.libc", "glibc 9.99")]


def test_a_worker_that_computes_otherwise_refuses(moved, store, kit):
    graph, spec = moved
    (reply,) = perform([replace(spec, force=True)], store, graph.packages)
    assert reply.state == "failed" and reply.machine
    assert "machine is libc glibc 9.99, not" in reply.error
    assert "last digits" in reply.error
