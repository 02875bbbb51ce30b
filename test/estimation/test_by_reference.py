"""Kernels take named tuples as one address: the same numbers, nothing copied, nothing counted."""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numpy as np
import pytest

from msls_ros.estimation import compiled as room

pytestmark = pytest.mark.skipif(not room.HAVE_NUMBA, reason="nothing is passed by reference without numba")

Made = Any


@room.passed_by_reference
class Inner(NamedTuple):
    """Part of another one."""

    gain: float
    row: Made


@room.passed_by_reference
class Outer(NamedTuple):
    """Fields of every kind that the room's have."""

    active: bool
    number: int
    matrix: Made
    turned: Made
    cube: Made
    flags: Made
    inner: Inner


def outer() -> Outer:
    random = np.random.default_rng(3)
    matrix = random.normal(size=(3, 4))
    turned = np.asfortranarray(random.normal(size=(3, 4)))[::2]
    return Outer(
        True, 3, matrix, turned, random.normal(size=(2, 3, 4)), np.arange(5), Inner(0.5, random.normal(size=4))
    )


def add(row: Made, gain: float, to: Made) -> None:
    for k in range(len(to)):
        to[k] += gain * row[k]


def walk(x: Outer, other: Inner, n: int) -> float:
    """Write through what is loaded, by element and by slice, and read what was written."""
    total = 0.0
    for k in range(n):
        for i in range(x.matrix.shape[0]):
            x.matrix[i, k % 4] += x.turned[i % 2, k % 4] * other.gain
            add(x.inner.row, other.gain, x.cube[k % 2, i])
            total += x.cube[k % 2, i, 3] + x.matrix[i, 0]
        x.flags[k % len(x.flags)] += 1 if x.active else x.number
        x.inner.row[k % 4] = total
    return total


def compiled(function: Any) -> Any:
    return room.Kernel(function, {**room.OPTIONS, "cache": False})


def compiled_walk() -> Any:
    global add
    add = compiled(add)
    return compiled(walk)


WALK: Any = compiled_walk() if room.HAVE_NUMBA else None


def test_what_a_kernel_writes_and_returns_has_the_bits_of_the_interpreted_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    interpreted, fast = outer(), outer()
    with monkeypatch.context() as patch:
        patch.setitem(globals(), "add", getattr(add, "__wrapped__", add))
        expected = walk(interpreted, interpreted.inner, 40)
    assert WALK(fast, fast.inner, 40) == expected
    for one, other in zip(interpreted[2:6], fast[2:6], strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(interpreted.inner.row, fast.inner.row)


def test_the_type_is_one_address_and_differs_by_what_is_in_the_tuple() -> None:
    numba: Any = pytest.importorskip("numba")
    WALK(outer(), outer().inner, 1)
    kind = numba.typeof(outer())
    assert kind is numba.typeof(outer()) or kind == numba.typeof(outer())
    assert type(kind).__name__ == "Reference" and len(kind.mangling_args[0]) < 40
    other = numba.typeof(outer()._replace(flags=np.arange(5.0)))
    assert other != kind and other.mangling_args != kind.mangling_args
    assert numba.typeof((1.0, 2)) == numba.types.Tuple((numba.float64, numba.int64)), "tuples of others as they were"


def test_a_tuple_may_be_another_one_at_the_next_call_and_none_is_held() -> None:
    first, second = outer(), outer()
    second.matrix[...] *= 2.0
    held = [sys.getrefcount(one) for one in first[2:6]]
    results = [WALK(one, one.inner, 3) for one in (first, second, outer())]
    assert results[0] == results[2] != results[1]
    assert [sys.getrefcount(one) for one in first[2:6]] == held


def test_a_field_that_there_is_not_is_named_when_it_is_compiled() -> None:
    numba: Any = pytest.importorskip("numba")

    def wrong(x: Any) -> Any:
        return x.missing

    with pytest.raises(numba.TypingError, match="missing"):
        compiled(wrong)(outer())
