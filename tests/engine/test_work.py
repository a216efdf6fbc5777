"""Tally of the work of kernels: times of loading and of calls do not mix; threads are apart."""

import time

from pipeline.jit.work import calling, loading, work


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
