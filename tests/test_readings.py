"""Thirty more ways in which a function may read its arguments or branch: none gives a proof for another Jacobian.

Each member takes one path with numbers and may take another one with intervals.  Where numbers go, the Jacobian has the
wrong sign on a tooth between 0.37 and 0.4, which no point of comparison meets.
"""

from __future__ import annotations

import builtins
import ctypes
import functools
import heapq
import inspect
import io
import itertools
import json
import math
import operator
import pickle
import statistics
import warnings
import weakref
from collections import Counter
from fractions import Fraction

import control as ct
import numpy as np
import pytest
from test_own_code import hidden, shown

import control_kpos as kp
from control_kpos.exact.intervals import IntervalDual


def answer(function, region=((-1, 1), (-1, 1))):
    system = ct.nlsys(lambda t, x, u, p: function(x), inputs=0, states=2)
    return kp.differential_positivity(system, kp.orthant(2), [list(side) for side in region])


class Caught:
    """A context that swallows errors by its own exit."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return True


def by_warning(x):
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        np.float64(1) * x[1]
        np.log(x[1] - 5)
    return bool(seen)


def by_own_context(x):
    seen = []
    with Caught():
        seen.append(float(x[1]))
    return bool(seen)


def by_generator(x):
    def steps():
        yield x[1] > 5
        yield True

    return next(itertools.dropwhile(operator.not_, steps()))


def by_equality_of_lists(x):
    return [x[1]] == [x[1]] and [x[1]] != [x[0]] and [x[0], x[1]] > [5.0, 5.0]


def by_cache(x):
    @functools.lru_cache
    def seen(_):
        return True

    return seen(x[1])


def by_subclass_hook(x):
    class Meta(builtins.type):
        def __instancecheck__(cls, item):
            return hasattr(item, "dtype")

    return isinstance(x[1], Meta("Number", (), {}))


def by_error_state(x):
    seen = []
    with np.errstate(all="call", call=lambda *_: seen.append(1)):
        np.divide(x[1] - x[1], x[1] - x[1])
    return bool(seen)


def by_reduction(x):
    return np.logical_or.reduce(x > -9)


READINGS = {
    "sorted": lambda x: sorted([x[1], 9.0])[0] < 9,
    "max": lambda x: max(x[1], -9.0) > -9,
    "min with key": lambda x: min([x[1]], key=lambda y: y * y) > -9,
    "any": lambda x: any(y > -9 for y in x),
    "filter": lambda x: len(list(filter(lambda y: y > -9, x))) == 2,
    "chained comparison": lambda x: -9 < x[1] < 9,
    "not": lambda x: not x[1] > 9,
    "while": lambda x: next(itertools.takewhile(lambda y: y > -9, iter(x)), None) is not None,
    "choice and": lambda x: (x[1] > -9) and (x[1] < 9),
    "bool of choice": lambda x: bool((x[1] > -9) & (x[1] < 9)),
    "choice as an index": lambda x: [False, True][(x[1] > -9) * 1],
    "choice in text": lambda x: f"{x[1] > -9}" == "True",
    "choice compared": lambda x: (x[1] > -9) == True,  # noqa: E712
    "choice in a set": lambda x: (x[1] > -9) in {True},
    "sum of choices": lambda x: sum(y > -9 for y in x) == 2,
    "any of an array": lambda x: np.any(x > -9),
    "all by method": lambda x: (x > -9).all(),
    "count": lambda x: np.count_nonzero(x > -9) == 2,
    "mask": lambda x: len(x[x > -9]) == 2,
    "nonzero": lambda x: len(np.nonzero(x > -9)[0]) == 2,
    "searchsorted": lambda x: np.searchsorted([-9.0, 9.0], x[1]) == 1,
    "digitize": lambda x: np.digitize(x[1], [-9.0, 9.0]) == 1,
    "isfinite": lambda x: np.isfinite(x[1]),
    "signbit": lambda x: not np.signbit(x[1] + 9),
    "isclose": lambda x: np.isclose(x[1], x[1]),
    "math": lambda x: math.isfinite(x[1]),
    "fsum": lambda x: math.fsum(x) < 99,
    "statistics": lambda x: statistics.mean(list(x)) < 99,
    "json": lambda x: json.dumps(list(x)).startswith("["),
    "pickle": lambda x: len(pickle.dumps(x)) < 10**6,
    "print": lambda x: print(x[1], file=io.StringIO()) is None,
    "percent": lambda x: len("%.3f" % x[1]) > 0,  # noqa: UP031
    "fraction": lambda x: Fraction(x[1]) < 99,
    "counter": lambda x: len(Counter([x[1]])) == 1,
    "heap": lambda x: heapq.nsmallest(1, [x[1], 9.0])[0] < 9,
    "weak reference": lambda x: weakref.ref(x[1])() is None,
    "signature": lambda x: inspect.isclass(x[1].__class__) or True,
    "struct": lambda x: ctypes.c_double(x[1]).value < 99,
    "mro": lambda x: float in x[1].__class__.__mro__,
    "attribute of numbers": lambda x: x[1].real < 99,
    "method of numbers": lambda x: not x[1].is_integer(),
    "dunder": lambda x: x[1].__float__() < 99,
    "dunder comparison": lambda x: x[1].__lt__(9.0) is np.True_,
    "object's comparison": lambda x: object.__eq__(x[1], 0.5) is not NotImplemented,
    "slot of the class": lambda x: IntervalDual.__init__ is not x[1].__init__,
    "length": lambda x: len(np.atleast_1d(x[1]).tobytes()) == 8,
    "shape of text": lambda x: np.array2string(x).startswith("["),
    "vectorized branch": lambda x: np.vectorize(lambda y: y > -9)(x).all(),
    "partition": lambda x: np.partition(x, 0)[0] < 9,
    "argmax": lambda x: np.argmax(x) >= 0,
    "unique": lambda x: len(np.unique(x)) > 0,
    "ptp": lambda x: np.ptp(x) < 9,
    "floor": lambda x: np.floor(x[1]) < 9,
    "rint": lambda x: np.rint(x)[1] < 9,
    "fmod": lambda x: np.fmod(x[1], 1.0) < 9,
    "by another name": lambda x: np.frompyfunc(lambda y: y > -9, 1, 1)(x)[1],
    "truth by pattern": lambda x: operator.truth(x[1] > -9),
    "warning": by_warning,
    "own context": by_own_context,
    "generator": by_generator,
    "lists": by_equality_of_lists,
    "cache": by_cache,
    "subclass hook": by_subclass_hook,
    "error state": by_error_state,
    "reduction": by_reduction,
}


@pytest.mark.parametrize("name", READINGS)
def test_a_reading_is_never_proven(name):
    def quietly(x):
        result = READINGS[name](x)
        return bool(result)

    for read in (READINGS[name], quietly):
        for wanted in (hidden, shown):
            other = shown if wanted is hidden else hidden
            cert = _answered(lambda x, r=read, w=wanted, o=other: w(x) if r(x) else o(x))
            assert cert is None or cert.status is not kp.Status.PROVED, (name, wanted.__name__)


def _answered(function):
    """The certificate; None if the function is refused by an error of ours."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return answer(function)
        except kp.KposError:
            return None
