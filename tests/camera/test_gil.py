"""Kernels release the interpreter's lock: another thread, such as a worker's heartbeat, goes on while they run."""

import importlib
import pkgutil
import threading
import time

import numpy as np

import pipeline
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.jit.decorators import Kernel


def test_every_kernel_is_compiled_without_the_lock():
    found = []
    for room in ("optics", "camera", "targets", "truth", "render"):
        package = importlib.import_module(f"pipeline.{room}")
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            for name, value in vars(importlib.import_module(info.name)).items():
                if isinstance(value, Kernel):
                    assert value.compiled.targetoptions.get("nogil") is True, f"{info.name}.{name}"
                    found.append(name)
    assert len(found) > 10 and pipeline.__version__


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
