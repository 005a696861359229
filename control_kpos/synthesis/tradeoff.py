"""How much gain a decay rate costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import vector
from ..cones import Cone
from ..errors import DataError
from .backend import backend
from .plant import column_freedom, read_plant, require_simplicial
from .result import DesignResult
from .simplicial import Failure, SimplicialProgram
from .state import state_feedback

_POINTS = 12


@dataclass(frozen=True)
class Tradeoff:
    """Smallest gain for each decay rate.

    Attributes
    ----------
    rates : ndarray, shape (k,)
    gains : ndarray, shape (k,)
        Smallest max |F x_k| by the linear programs; NaN where the rate is out of reach.
    largest_rate : float
        Supremum of the decay rates; inf if nothing limits it.
    designs : tuple of DesignResult
        Certified gains at the rates asked for, if `certify` was set.
    """

    rates: NDArray[np.float64]
    gains: NDArray[np.float64]
    largest_rate: float
    designs: Sequence[DesignResult] = ()


def gain_rate_tradeoff(
    sys: Any,
    rates: ArrayLike | None = None,
    *,
    X: Cone | ArrayLike | None = None,
    certify: bool = False,
    **demands: Any,
) -> Tradeoff:
    """Smallest gain against decay rate on a simplicial cone: the data of `plot_tradeoff`.

    Parameters
    ----------
    sys, X
        As in `state_feedback`.
    rates : array_like, shape (k,), optional
        Default: a dozen rates up to just below the largest one.
    certify : bool
        True: design and prove a gain at each rate; False: linear programs only.
    **demands
        `gain_bound`, `structure`, `vertices`, `ports` of `state_feedback`.

    Returns
    -------
    Tradeoff

    Raises
    ------
    NotProperConeError
        X is not simplicial.
    DataError
        `structure` does not follow the blocks of X, or `rates` are missing where nothing limits the rate.

    Examples
    --------
    >>> import control as ct, control_kpos as kp
    >>> plant = ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)
    >>> curve = kp.gain_rate_tradeoff(plant, [0.5, 1.9], X=[[0, 1], [1, -2]])
    >>> curve.gains.round(2), round(curve.largest_rate, 2)
    (array([5., 5.]), 2.0)
    """
    plant = read_plant(sys, X, **demands)
    require_simplicial(plant.X, "the trade-off curve")
    free = column_freedom(plant)
    if free is None:
        raise DataError("structure does not follow the blocks of X, which the trade-off curve needs.")
    program = SimplicialProgram(plant, free, backend(None, 600.0))
    best = program.supremum_of_rates()
    largest = -np.inf if isinstance(best, Failure) else best[1]
    if rates is None:
        if not 0 < largest < np.inf:
            raise DataError("rates is missing, and no finite positive largest rate suggests any; give rates.")
        values = np.linspace(0.0, 0.99 * largest, _POINTS)
    else:
        values = vector(rates, "rates")
    gains = np.full(len(values), np.nan)
    for place, rate in enumerate(values.tolist()):
        point = program.start(rate)
        if not isinstance(point, Failure):
            gains[place] = program.smallest_gain(rate, point)[1]
    designs = tuple(state_feedback(sys, X=X, rate=rate, **demands) for rate in values.tolist()) if certify else ()
    return Tradeoff(values, gains, float(largest), designs)
