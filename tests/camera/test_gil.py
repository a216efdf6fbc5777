"""Kernels release the interpreter's lock: another thread, such as a worker's heartbeat, goes on while they run."""

import threading
import time

import numpy as np

from pipeline.camera.tracer import Tracer, parallel_planes


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
