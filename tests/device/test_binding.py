"""Claim: a kernel bound anew computes in the precision that it is bound to, with its own constants."""

import math
import types
from fractions import Fraction

import numba
import numpy as np
import pytest

from pipeline.jit.binding import Single, TypedMath, bound_anew, exact_fma
from pipeline.jit.decorators import inline
from pipeline.optics.kernels import SCRATCH, Packet, trace_packet

THIRD = 1.0 / 3.0


@inline
def third_of(x):
    """A literal, a constant and a root."""
    return math.sqrt(x) * THIRD + 0.1


coarse, fine = Single(third_of, THIRD=0.25), Single(third_of)


def both(x):
    """The same kernel with two constants, and in double precision."""
    return coarse(x), fine(x), third_of(x)


def in_python(function):
    """The function as the simulator runs it."""
    return bound_anew(function, lambda one: one, fma=exact_fma, math=TypedMath())


def test_each_single_has_its_own_constants_and_leaves_double_alone() -> None:
    x = np.float32(2.0)
    root = np.float32(math.sqrt(2.0))
    quarter, third, double = in_python(both)(x)
    assert quarter == root * np.float32(0.25) + np.float32(0.1)
    assert third == root * np.float32(THIRD) + np.float32(0.1)
    assert quarter.dtype == third.dtype == np.float32
    assert in_python(both)(2.0)[2] == math.sqrt(2.0) * THIRD + 0.1
    assert double == third  # float32 in, and literals of Python adapt


def test_a_float32_sum_of_products_is_rounded_once() -> None:
    """By way of float64 it would be rounded twice: here to a tie, and then the wrong way."""
    a, b = np.float32(1 + 2**-12), np.float32(1 + 2**-12)
    c = np.float32(2**-60)  # the product is 1 + 2^-11 + 2^-24, half-way between two float32; c lies just above
    exact = Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c))
    low, high = np.float32(1 + 2**-11), np.float32(1 + 2**-11 + 2**-23)
    assert exact - Fraction(float(low)) > Fraction(float(high)) - exact
    assert exact_fma(a, b, c) == high != np.float32(float(exact))


@pytest.mark.heavy
def test_the_trace_is_typed_in_single_precision_whatever_a_surface_is() -> None:
    """Where float64 comes in, by a constant or by an integer beside float32, the types of two branches differ."""
    single = Single(trace_packet, STILL_MM=1e-3, RESIDUAL_MM=1e-4)

    def traced(table: np.ndarray, packet: Packet) -> None:
        trace_single(table, packet, 0)

    whole = types.FunctionType(traced.__code__, {**globals(), "trace_single": single})
    compiled = numba.njit(bound_anew(whole, numba.njit, fma=numba.njit(lambda a, b, c: a * b + c)))
    rays = [np.zeros(1, np.float32) for _ in range(8)]
    compiled(np.zeros((1, 60), np.float32), Packet(*rays[:7], np.zeros((SCRATCH, 1), np.float32), rays[7]))
