"""The smallest gain for each decay rate: the trade-off curve of a plant."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..cones import Cone
from ..errors import DataError
from ..exact.budget import OutOfBudgetError, affords, budget, seconds_left
from ..exact.intake import exact_matrix, flag, seconds, vector
from ..progress import Reporter, Target
from .feedback import state_feedback
from .plant import Plant, read_plant, require_simplicial
from .result import DesignResult
from .running import Programs, operations
from .simplicial.program import Failure, SimplicialProgram

_POINTS = 12


@dataclass(frozen=True)
class Tradeoff:
    """Smallest gain for each decay rate.

    Attributes
    ----------
    rates : ndarray, shape (k,)
        Empty if none were given, and the limit was reached before the largest one was known.
    gains : ndarray, shape (k,)
        Smallest max |F x_k| by the linear programs, computed and not proven; NaN where they find no gain for the rate.
    largest_rate : float
        Supremum of the decay rates, computed and not proven; inf if no limit was found.
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
    time_limit: float | None = None,
    progress: Target = None,
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
        True: design and prove a gain at each rate, exactly as it is written; False: linear programs only.
    time_limit : float, optional
        Seconds for everything; gains not found by then are NaN, and designs UNDECIDED.  None: a fixed number of
        operations, as in `state_feedback`.
    progress : callable or bool, optional
        As in `state_feedback`.
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
    limit, certify = seconds(time_limit), flag(certify, "certify")
    values, gains, largest = _rates(rates, -np.inf, late=True), None, -np.inf
    designs = []
    with (
        budget(operations("trade-off", limit), time_limit=limit),
        suppress(OutOfBudgetError),
        Reporter(progress) as report,
        np.errstate(all="ignore"),
    ):
        plant = read_plant(sys, X, **demands)
        require_simplicial(plant.X, "the trade-off curve")
        values, gains, largest = _curve(plant, rates, Programs(None, report))
        asked = values if rates is None else exact_matrix(rates, "rates", ndim=1).fractions()
        for place, rate in enumerate(asked.tolist() if certify else []):
            report(f"design {place + 1} of {len(values)}")
            each = None if limit is None else max(seconds_left(), 1e-3) / (len(values) - place)
            designs.append(state_feedback(sys, X=X, rate=rate, time_limit=each, progress=False, **demands))
    return Tradeoff(values, np.full(len(values), np.nan) if gains is None else gains, largest, tuple(designs))


def _curve(
    plant: Plant, rates: ArrayLike | None, lp: Programs
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Rates, gains, and the largest rate, as far as the limit allows."""
    values, gains, largest = None, np.empty(0), -np.inf
    try:
        program = SimplicialProgram(plant, lp)
        lp.stage("largest decay rate")
        best = program.supremum_of_rates()
        largest = -np.inf if isinstance(best, Failure) else float(best[1])
        values = _rates(rates, largest, late=not affords())
        gains = np.full(len(values), np.nan)
        for place, rate in enumerate(values.tolist()):
            lp.stage(f"rate {place + 1} of {len(values)}")
            point = program.start(rate)
            if not isinstance(point, Failure) and affords():
                gains[place] = program.smallest_gain(rate, point)[1]
    except OutOfBudgetError:
        values = _rates(rates, largest, late=True) if values is None else values
        gains = np.append(gains, np.full(len(values) - len(gains), np.nan))
    return values, gains, largest


def _rates(rates: ArrayLike | None, largest: float, *, late: bool) -> NDArray[np.float64]:
    """The rates given, or a dozen up to the largest; none if it is too late to know that."""
    if rates is not None:
        values = vector(rates, "rates")
        if not (values >= 0).all():
            raise DataError(f"rates holds {values.min():g}; decay rates are not negative.")
        return values
    if not 0 < largest < np.inf:
        if late:
            return np.empty(0)
        raise DataError("rates is missing, and no finite positive largest rate suggests any; give rates.")
    return np.linspace(0.0, 0.99 * largest, _POINTS)
