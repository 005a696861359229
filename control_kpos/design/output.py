"""Static output feedback u = K y, and positive observers by duality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from control import StateSpace
from numpy.typing import ArrayLike

from ..cones import Cone
from ..errors import DataError
from ..exact.intake import seconds
from ..exact.matrix import Matrix
from ..progress import Target
from ..systems.system import System
from .accept import closed_loop
from .plant import read_plant, read_system
from .polyhedral.search import design_by_alternation
from .result import OBSERVER, DesignResult, dual_words
from .running import Programs, SolverChoice, within
from .simplicial.search import design_on_simplicial
from .state import read_rate


def output_feedback(
    sys: Any,
    *,
    X: Cone | ArrayLike | None = None,
    rate: float | Literal["max"] = 0.0,
    gain_bound: ArrayLike | None = None,
    structure: ArrayLike | None = None,
    vertices: Sequence[Any] | None = None,
    ports: bool = False,
    solver: SolverChoice = None,
    time_limit: float | None = None,
    progress: Target = None,
) -> DesignResult:
    """Find a static gain for u = F y + w, y = C x, that makes X invariant and the closed loop stable.

    Parameters
    ----------
    sys : ConeStateSpace or control.StateSpace
        The plant; D must be zero.
    X : Cone or array_like of rays, optional
        Default: the cone of `sys`.
    rate : float or "max"
        As in `state_feedback`.
    gain_bound : float or array_like, shape (m,), optional
        Bound on |F C x_k|, input by input, at every generator of X.
    structure : array_like of bool, shape (m, q), optional
        True where F may differ from zero: which input may use which output.
    vertices : sequence of (A_s, B_s), optional
        As in `state_feedback`.
    ports : bool
        As in `state_feedback`.
    solver, time_limit, progress
        As in `state_feedback`.

    Returns
    -------
    DesignResult
        `F` has shape (m, q), for u = F y; `K` = -F, for u = -K y.  REFUTED only if invariance alone is
        impossible; otherwise the alternation finds a gain or gives up.

    Raises
    ------
    DataError
        D is not zero.
    ShapeError, ConeMismatchError, NotProperConeError, SolverError
        As in `state_feedback`.

    Notes
    -----
    Static output feedback is bilinear in (F, v); the alternation is a local method with restarts, some dozens of
    linear programs.

    Examples
    --------
    >>> import control as ct, control_kpos as kp
    >>> plant = ct.ss([[-3, 1], [2, 1]], [[0], [1]], [[0, 1]], 0)
    >>> d = kp.output_feedback(plant)
    >>> bool(d), d.F.shape
    (True, (1, 1))
    """
    limit, target = seconds(time_limit), read_rate(rate)

    def design(lp: Programs) -> DesignResult:
        plant = read_plant(
            sys, X, gain_bound=gain_bound, structure=structure, vertices=vertices, ports=ports, output=True
        )
        if not plant.system.D.is_zero:
            raise DataError("output feedback needs D = 0; subtract D u from the measurement first (y - D u is known).")
        return design_by_alternation(plant, target, lp)

    result = within(limit, design, solver=solver, progress=progress)
    return replace(result, objective=result.objective.replace("F x_k", "F C x_k"), law="u = F y")


def observer_gain(
    sys: Any,
    *,
    X: Cone | ArrayLike | None = None,
    rate: float | Literal["max"] = 0.0,
    gain_bound: ArrayLike | None = None,
    solver: SolverChoice = None,
    time_limit: float | None = None,
    progress: Target = None,
) -> DesignResult:
    """Find L for which the error e' = (A + L C) e of an observer keeps X invariant and decays.

    The observer is z' = A z + B u + L (C z - y).  If z - x starts in X it stays there: z bounds x in the order of X;
    a second copy started on the other side gives an interval for x.

    Parameters
    ----------
    sys : ConeStateSpace or control.StateSpace
    X : Cone or array_like of rays, optional
        Default: the cone of `sys`.
    rate : float or "max"
        As in `state_feedback`.
    gain_bound : float or array_like, shape (q,), optional
        |L'h_k| <= gain_bound, output by output, at every facet h_k of X.
    solver, time_limit, progress
        As in `state_feedback`.

    Returns
    -------
    DesignResult
        `F` is L, shape (n, q); `closed_loop` is the observer from (u, y) to z; the certificate is about the dual
        system A' + C'L' on X*, which is invariant and stable exactly when A + L C is on X.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError, NotProperConeError, SolverError
        As in `state_feedback`.

    Notes
    -----
    A + L C is K-positive and stable on X if and only if its transpose is on X*: the linear programs of
    `state_feedback` for (A', C') and X*, exact if X is simplicial.

    Examples
    --------
    >>> import control as ct, control_kpos as kp
    >>> plant = ct.ss([[1, 1], [0.5, -2]], [[1], [0]], [[1, 0]], 0)
    >>> d = kp.observer_gain(plant, rate=1)
    >>> bool(d), d.F.shape
    (True, (2, 1))
    """
    limit, target = seconds(time_limit), read_rate(rate)

    def design(lp: Programs) -> DesignResult:
        system = read_system(sys, X)
        A, B, C, D = (M.T for M in system.matrices)
        plant = read_plant(System.read((A, C, B, D), X=system.X.dual, dt=system.dt), None, gain_bound=gain_bound)
        by = design_on_simplicial if plant.X.is_simplicial else design_by_alternation
        result = by(plant, target, lp)
        return _as_observer(result, sys, system, result.F.T) if result else result

    return replace(within(limit, design, solver=solver, progress=progress), law=OBSERVER)


def _as_observer(result: DesignResult, sys: StateSpace, system: System, L: Any) -> DesignResult:
    A, B, C, D = system.matrices
    gain, (n, m, q) = Matrix(np.ascontiguousarray(L)), system.sizes
    inputs = Matrix.join([closed_loop(B, gain, D), -gain], axis=-1).values
    observer = StateSpace(
        closed_loop(A, gain, C).values,
        inputs,
        np.eye(n),
        np.zeros((n, m + q)),
        system.dt,
        remove_useless_states=False,
        inputs=[*sys.input_labels, *sys.output_labels],
        states=sys.state_labels,
    )
    objective = dual_words(result.objective.replace("F x_k", "F'h_k"))
    return replace(result, F=L, closed_loop=observer, objective=objective, law=OBSERVER)
