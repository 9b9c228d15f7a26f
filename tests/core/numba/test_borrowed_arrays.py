"""References to arrays are counted where functions make arrays, and nowhere else."""

import gc
import sys
import weakref
from typing import NamedTuple

import numpy as np
import pytest

from plenoptic.core.numba.jit import device, kernel


class Pair(NamedTuple):
    numbers: np.ndarray
    out: np.ndarray


@device
def first_of(part):
    return part[0]


@device
def later(numbers, start):
    return numbers[start:]


@device
def pair_of(numbers, out):
    return Pair(numbers[1:], out)


@kernel
def fill_borrowed(numbers, out):
    for i in range(out.size):
        part = numbers[i:]
        out[i] = first_of(part) + part[-1]


@kernel
def fill_returned(numbers, out):
    for i in range(out.size):
        out[i] = first_of(later(later(numbers, i), 0)) + numbers[-1]


@kernel
def fill_made(numbers, out):
    for i in range(out.size):
        room = np.empty(numbers.size)
        room[:] = numbers
        out[i] = first_of(room[i:]) + room[-1]


@kernel
def fill_recorded(numbers, out):
    shifted = pair_of(numbers, out)
    for i in range(out.size):
        shifted.out[i] = (first_of(shifted.numbers[i - 1 :]) if i else numbers[0]) + shifted.numbers[-1]


@kernel
def fill_copied(numbers, out):
    out[:] = numbers
    for i in range(out.size):
        out[i] += numbers[-1]


KERNELS = [fill_borrowed, fill_returned, fill_made, fill_recorded, fill_copied]


def counts_references(function):
    """True if a newly compiled function counts references."""
    fresh = device(function.py_func)
    fresh.compile(function.signatures[0])
    (code,) = fresh.inspect_asm().values()
    return "NRT_incref" in code or "NRT_decref" in code


@pytest.mark.parametrize("function", KERNELS, ids=lambda function: function.__name__)
def test_no_reference_is_lost_or_left(function):
    numbers, out = np.arange(5.0), np.empty(5)
    function(numbers, out)
    before = sys.getrefcount(numbers), sys.getrefcount(out)
    for _ in range(100):
        function(numbers, out)
    assert out.tolist() == [4.0, 5.0, 6.0, 7.0, 8.0]
    assert (sys.getrefcount(numbers), sys.getrefcount(out)) == before
    gone = weakref.ref(numbers)
    del numbers
    gc.collect()
    assert gone() is None


def test_only_what_makes_arrays_counts():
    numbers, out = np.arange(5.0), np.empty(5)
    for function in KERNELS:
        function(numbers, out)
    assert [counts_references(function) for function in KERNELS] == [False, True, True, True, True]


def test_records_of_arrays_that_are_handed_in_are_not_counted_either():
    @kernel
    def fill(pair):
        for i in range(pair.out.size):
            pair.out[i] = first_of(pair.numbers[i:])

    numbers, out = np.arange(5.0), np.empty(5)
    fill(Pair(numbers, out))
    assert out.tolist() == numbers.tolist() and not counts_references(fill)
