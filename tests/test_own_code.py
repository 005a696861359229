"""A function that does with numbers something else than with intervals, at a few places only, is never proven.

Each member reads the type, an identity, an attribute or an error of others, and takes numbers another way: there the
Jacobian has the wrong sign between 0.37 and 0.4, where no point of comparison lies.
"""

from __future__ import annotations

import contextlib
import contextvars
import functools
import gc
import operator
import sys
import threading
from decimal import Decimal

import control as ct
import numpy as np
import pytest

import control_kpos as kp
from control_kpos.exact.own_code import followed
from control_kpos.exact.unreadable import UnsupportedError, watched


def shown(x):
    """K-positive on the orthant."""
    return [-x[0] + x[1], -x[1]]


def hidden(x):
    """The same but for a tooth that is not."""
    return [-x[0] + x[1] - 4 * max(0.0, 0.015 - abs(float(x[1]) - 0.385)), -x[1]]


def swallowed(look):
    with contextlib.suppress(Exception):
        return bool(look())
    return False


def by_slot(x):
    try:
        return [-x[0] - x[1].value[0], -x[1]]
    except AttributeError:
        return [-x[0] - x[1], -x[1]]


def by_foreign_error(x):
    try:
        Decimal(x[1])
    except TypeError:
        return shown(x)
    return hidden(x)


def by_error_of_an_index(x):
    try:
        return x[1][0]
    except IndexError:
        return hidden(x)
    except TypeError:
        return shown(x)


def by_method(x):
    try:
        x[1].sin()
    except AttributeError:
        return hidden(x)
    return shown(x)


def by_suppressed_error(x):
    with contextlib.suppress(AttributeError):
        x[1].sin()
        return shown(x)
    return hidden(x)


def by_thread(x):
    found = []

    def look():
        found.append(swallowed(lambda: float(x[1]) < 5))

    worker = threading.Thread(target=look)
    worker.start()
    worker.join()
    return hidden(x) if found[0] else shown(x)


def by_context(x):
    return hidden(x) if contextvars.Context().run(swallowed, lambda: float(x[1]) < 5) else shown(x)


def by_dispatch(x):
    @functools.singledispatch
    def is_number(_):
        return False

    is_number.register(float)(lambda _: True)
    return hidden(x) if swallowed(lambda: is_number(x[1])) else shown(x)


def by_finally(x):
    for _ in range(1):
        try:
            x[1].sin()
            return shown(x)
        finally:
            break  # noqa: B012 -- the error ends here
    return hidden(x)


def by_match(x):
    match x[1]:
        case float():
            return hidden(x)
        case _:
            return shown(x)


sort_of = type
WAYS = {
    "type": lambda x: type(x[1]) is np.float64,
    "type under another name": lambda x: sort_of(x[1]) in (np.float64,),
    "type in a closure": (lambda t: lambda x: t(x[1]) in (np.float64,))(type),
    "type as a default": lambda x, t=type: t(x[1]) in (np.float64,),
    "type of the array": lambda x: type(x) in (np.ndarray,),
    "class of the array": lambda x: x.__class__ in (np.ndarray,),
    "dtype": lambda x: x.dtype == float,
    "dtype of another array": lambda x: np.asarray([x[0], x[1]]).dtype == float,
    "getattr": lambda x: np.dtype(getattr(np.asarray(x), "dtype")) == float,  # noqa: B009
    "attrgetter": lambda x: str(operator.attrgetter("dtype")(np.asarray(x))) == "float64",
    "kind of number": lambda x: np.issubdtype(np.result_type(x), np.floating),
    "is": lambda x: x[1] is not x[1],
    "operator.is_": lambda x: not operator.is_(x[1], x[1]),
    "id": lambda x: id(x[1]) - id(x[1]),
    "hasattr": lambda x: not hasattr(x[1], "sin"),
    "type in a list": lambda x: type(x.tolist()[1]) in (float,),
    "array_equal": lambda x: swallowed(lambda: np.array_equal(x, x)),
    "memory": lambda x: swallowed(lambda: memoryview(x)[0] + 0.0 < 9),
    "bytes": lambda x: swallowed(lambda: len(bytes(x.data))),
    "map": lambda x: next(map(type, x)) in (np.float64,),
    "vectorize": lambda x: np.vectorize(lambda y: type(y) in (float, np.float64), otypes=[bool])(x).all(),
    "evaluated": lambda x: eval("type(x[1]) in (np.float64,)", {"x": x, "np": np}),
}
MEMBERS = [
    by_slot, by_foreign_error, by_error_of_an_index, by_method, by_suppressed_error, by_thread, by_context, by_dispatch,
    by_finally, by_match,
]  # fmt: skip


def answer(function):
    system = ct.nlsys(lambda t, x, u, p: function(x), inputs=0, states=2)
    return kp.differential_positivity(system, kp.orthant(2), [[-1, 1], [-1, 1]])


@pytest.mark.parametrize("way", WAYS)
def test_a_branch_that_numbers_alone_take_is_not_proven(way):
    cert = answer(lambda x: hidden(x) if WAYS[way](x) else shown(x))
    assert cert.status is not kp.Status.PROVED and cert.source == "sampled"


@pytest.mark.parametrize("function", MEMBERS, ids=lambda f: f.__name__)
def test_errors_that_are_caught_are_not_proven(function):
    cert = answer(function)
    assert cert.status is not kp.Status.PROVED and cert.source == "sampled"
    assert "could tell numbers from intervals" in cert.explain()


def test_numbers_of_a_kind_of_their_own_are_not_proven():
    class Gain(float):
        def __mul__(self, other):
            return -float(other)

    cert = answer(lambda x: [-x[0] + Gain(1) * x[1], -x[1]])
    assert cert.status is not kp.Status.PROVED


def test_harmless_code_is_enclosed():
    class Model:
        rate, shift = 2.0, None

        def flow(self, y):
            return self.rate * y if self.shift is None else y

    model = Model()

    def function(x, gain=None):
        with np.errstate(all="ignore"):
            total = sum(model.flow(y) for y in x)
        if None is gain and model.rate > 1 and True is not gain and isinstance(model, Model):
            total = np.sum(x) + np.mean(x) + np.dot(np.ones(2), x) - total
        return [-5 * x[0] + total, -5 * x[1] + total]

    assert answer(function).source == "enclosed" and answer(shown)


def test_what_watches_a_program_is_put_back():
    def tracer(*_):
        return None

    before = sys.gettrace()
    try:
        sys.settrace(tracer)
        for function in (shown, lambda _: 1 / 0):
            with contextlib.suppress(ZeroDivisionError):
                followed(functools.partial(function, [1.0, 2.0]))
            assert sys.gettrace() is tracer
    finally:
        sys.settrace(before)
    assert gc.isenabled() and followed(lambda: 3) == (3, [])
    gc.disable()
    try:
        assert followed(lambda: 3) == (3, []) and not gc.isenabled()
    finally:
        gc.enable()


def test_what_was_seen_is_named():
    other = 2.0
    with pytest.raises(UnsupportedError, match=r"can tell types apart: is, try"):
        watched(lambda x: (x is other, by_slot([1.0, 2.0])), 1.0)


@pytest.mark.parametrize("when", [1, 3, 4, 5, 6, 9])
def test_a_function_that_changes_from_call_to_call_is_not_proven(when):
    calls = []

    def counting(x):
        calls.append(1)
        return [-x[0] - x[1] if len(calls) > when else -x[0] + x[1], -x[1] + 0.1 * np.cos(3 * x[0])]

    system = ct.nlsys(lambda t, x, u, p: counting(x), inputs=0, states=2)
    cert = kp.differential_positivity(system, kp.orthant(2), [[-1, 0], [-1, 1]])
    assert cert.status is not kp.Status.PROVED or len(calls) <= when


def test_random_numbers_are_not_proven():
    rng = np.random.default_rng(0)
    cert = answer(lambda x: [-x[0] + rng.random() * x[1], -x[1]])
    assert cert.status is not kp.Status.PROVED and cert.source == "sampled"
