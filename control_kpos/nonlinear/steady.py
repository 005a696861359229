"""Functions of a nonlinear network that do the same at every call, as far as calls show.

What is proven of a function rests on a few calls with intervals.  All of them have to take the same steps, and at one
point numbers have to come out where intervals say; what does something else is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError, KposError
from ..exact.intervals import IntervalDual, steps_to
from ..exact.unreadable import UnsupportedError
from .enclosed import Blocks, Coordinates, vectors
from .network import NonlinearNetwork
from .nodes import Links, NonlinearNodes

Array = NDArray[np.float64]

# A value beside its enclosure by more than this, relative, is no rounding.
_DIFFERENCE = 1e-6


class Steady:
    """A function that is refused if it comes by its values in another way than at an earlier call with intervals.

    Parameters
    ----------
    function : callable
    params : mapping, optional
        What is its last argument at the calls that are compared; None: at all.
    """

    def __init__(self, function: Callable[..., Any], params: Any = None) -> None:
        self._function, self._params = function, params
        self._steps: list[int] | None = None

    def __call__(self, *arguments: Any) -> Any:
        value = self._function(*arguments)
        if self._params is None or arguments[-1] is self._params:
            steps = _came_about(value)
            if self._steps is None:
                self._steps = steps
            elif steps is not None and steps != self._steps:
                raise UnsupportedError("the function does something else than at an earlier call")
        return value


def _came_about(value: Any) -> list[int] | None:
    """The steps to what a call with intervals returns; None if it returns numbers alone."""
    items = list(value) if type(value) in (list, tuple) else [value]
    if not any(type(item) is IntervalDual or _holds_objects(item) for item in items):
        return None
    return [steps_to(item) for item in np.asarray(value, dtype=object).ravel()]


def _holds_objects(item: Any) -> bool:
    return issubclass(type(item), np.ndarray) and item.dtype == object


def steady(net: NonlinearNetwork) -> NonlinearNetwork:
    """The same network, with functions that are compared from call to call."""
    kinds = tuple(_steady_nodes(kind) for kind in net.kinds)
    links = tuple(_steady_links(each) for each in net.links)
    return NonlinearNetwork(kinds, net.model, (net.upper, net.lower), links, net.has_ranges)


def _steady_nodes(kind: NonlinearNodes) -> NonlinearNodes:
    g = None if kind.g is None else Steady(kind.g, kind.params)
    return replace(kind, f=Steady(kind.f, kind.params), g=g)


def _steady_links(each: Links) -> Links:
    return replace(each, function=Steady(each.function)) if callable(each.function) else each


def rates_at(net: NonlinearNetwork, x: Array, w: Array) -> Array:
    """x' in numbers; an exception of the user's functions becomes one of ours."""
    try:
        return net.dynamics(x, w)
    except KposError:
        raise
    except Exception as error:
        raise DataError(
            f"a function of the nodes or links fails with numbers: {type(error).__name__}: {error}. Arrays that it is "
            "given are not to be changed."
        ) from error


def require_agreement(net: NonlinearNetwork, x: Array, w: Array, blocks: Blocks) -> None:
    """Refuse functions that do with numbers something else than with intervals, as far as one point shows."""
    if net.is_ranged:
        return
    rates = net.model.split(rates_at(net, x, w), 0)
    for k, (kind, seen) in enumerate(zip(net.kinds, rates, strict=True)):
        T = Coordinates.of(kind)
        near, far = (seen, seen) if T is None else vectors(T.inverse, (seen, seen))
        low, high = blocks.rates[k]
        room = (high - low) + _DIFFERENCE * (1 + np.abs(low) + np.abs(high))
        apart = (far < low - room) | (high + room < near)
        if apart.any() or not np.isfinite(seen).all():
            j = int(net.model.members[k][int(np.argmax(apart.any(axis=1)))])
            raise DataError(
                f"f or g of {net.model.name_of(j)} returns numbers that are not in their enclosure; give functions "
                "that do the same at every call."
            )
