"""Feedback gains that make a cone invariant and the loop stable: of the state, of the output, and of an observer.

State feedback u = F x + w is section V.A of the paper; output feedback u = F y + w is the same with a gain on C x; the
gain of an observer is the state feedback of the dual system.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np
from control import StateSpace
from numpy.typing import ArrayLike

from ..cards import Signals
from ..cones import Cone
from ..errors import DataError
from ..exact.intake import choice, exact_number, flag, found, is_number
from ..exact.matrix import Matrix
from ..progress import Target
from ..proof.certificate import Status, named
from ..systems.signals import signals_of
from ..systems.system import System
from ..theorems.positivity import PositivityCertificate
from .accept import beyond_feedback
from .bounded.gains import design_in_interval, read_interval
from .disturbance import leaves_at_once, objective_of, read_disturbance, reject_disturbance
from .modelling import design_with_constraints, reject_with_constraints
from .modes import by_mode, signals_by_mode, taken_apart
from .plant import Plant, closed_loop, read_plant, read_system, require_simplicial
from .polyhedral.rejection import reject_by_alternation
from .polyhedral.search import by_common_v, design_by_alternation, design_in_two_steps
from .result import OBSERVER, DesignResult, changed, dual_words
from .running import Programs, SolverChoice, within
from .simplicial.search import design_on_simplicial, first_gain

Method = Literal["auto", "one-shot", "first", "alternation", "two-step"]
_METHODS = ("auto", "one-shot", "first", "alternation", "two-step")


def state_feedback(
    sys: Any,
    *,
    X: Cone | ArrayLike | None = None,
    rate: float | Literal["max"] = 0.0,
    gain_bound: ArrayLike | None = None,
    structure: ArrayLike | None = None,
    vertices: Sequence[Any] | None = None,
    per_mode: bool = False,
    disturbance: Sequence[ArrayLike] | None = None,
    ports: bool = False,
    state_bounds: ArrayLike | None = None,
    input_bounds: ArrayLike | None = None,
    disturbance_bounds: ArrayLike | None = None,
    constraints: Callable[[Any], Sequence[Any]] | None = None,
    objective: Callable[[Any], Any] | None = None,
    gap: float = 1e-3,
    method: Method = "auto",
    solver: SolverChoice = None,
    time_limit: float | None = None,
    progress: Target = None,
) -> DesignResult:
    """Find the smallest gain F for which u = F x + w makes X invariant and x' = (A + B F) x stable.

    Parameters
    ----------
    sys : ConeStateSpace or control.StateSpace
        The plant; discrete time if its timebase says so.
    X : Cone or array_like of rays, optional
        Default: the cone of `sys` (the orthant for a plain system).
    rate : float or "max"
        Decay rate to be reached, per unit of time; in discrete time V(x[k+1]) <= (1 - rate) V(x[k]).  "max": as
        fast as possible.  0: any.  A gain that is only just large enough leaves little decay: ask for what you need.
        A rate such as "1/3" is proven as it is written; equality will do.
    gain_bound : float or array_like, shape (m,), optional
        |F x_k| <= gain_bound, input by input, at every generator x_k of X: the input that the state x_k may use.  The
        length of a generator has no meaning, so x_k is scaled to a leading entry of 1 (or -1), that is the first entry
        of at least an eighth of the size of the largest: equal cones give equal answers.
    structure : array_like of bool, shape (m, n), optional
        True where F may differ from zero.
    vertices : sequence of (A_s, B_s), or of systems, optional
        One F for all of them, and for their convex hull, with one common vector as proof: an x inside X that all map
        inwards, or where there is none a v inside X* with v'x falling.  They replace A and B of `sys`, whose own A and
        B are served only if they are among them; `closed_loop` is that of the first.
    per_mode : bool
        True: the vertices are modes of a switched system, and each has a gain F_s of its own, u = F_s x in mode s: the
        controller knows the mode.  One common vector proves stability for any switching.
    disturbance : (E, G), (E, G, H) or (E, G, H, D), optional
        Minimise the L-infinity gain from w to z in x' = (A + B F) x + E w, z = (G + H F) x + D w instead of the gain
        F; w and z in orthants, and positivity from w to z is part of the design.
    ports : bool
        True: the closed loop must also be positive from w in U to y in Y: B U in X and (C + D F) X in Y.
    state_bounds : array_like, shape (n,), optional
        x_max inside X: from every x in [0, x_max], in the order of X, the state stays there.  The smallest such F.
    input_bounds : float or array_like, shape (m,), optional
        |u_i| <= input_bounds[i] for all u = F x with x in [0, x_max].  Without state_bounds x_max is found too.
    disturbance_bounds : array_like, shape (n,), optional
        w_max in X: all this for x' = (A + B F) x + w with w(t) in [0, w_max] (x[k+1] in discrete time).
    constraints : callable, optional
        Of a cvxpy variable F, shape (m, n): a list of further linear constraints.  With per_mode the gains of the modes
        are below each other in F, shape (S m, n).
    objective : callable, optional
        Of the same variable: a convex expression to minimise instead of the gain.
    gap : float
        The gain (with `disturbance` that from w to z) may exceed the smallest one by this part of it: what is won goes
        into decay, margins and few digits.  `limit` is what is proven of the smallest one, within the gap as far as
        programs in doubles allow.
    method : {"auto", "one-shot", "first", "alternation", "two-step"}
        "one-shot": necessary and sufficient on simplicial cones.  "first": the same without a search for the
        smallest gain, for many states.  "alternation": any cone and any pattern.
        "two-step": the linear programs of the paper, for reference.  "auto" chooses between the first two.
    solver : str, callable or None
        None: HiGHS directly.  The name of any installed solver that cvxpy knows; or
        f(c, A_ub, b_ub, A_eq, b_eq, bounds) that returns x.  No solver is trusted.
    time_limit : float, optional
        Seconds; what is not settled by then is UNDECIDED, and the message says so.  None: the search gives up after
        a fixed number of operations, about a minute's, so that the answer is the same on every machine.
    progress : callable or bool, optional
        Called with a line about long work.  By default work of more than two seconds shows one line, overwritten, in a
        terminal or a notebook; False: never; True: even if the output is not a terminal.

    Returns
    -------
    DesignResult
        PROVED with the gain and its certificate; REFUTED with a proof that there is no such gain for this cone
        (one-shot method; or invariance alone is impossible; or, on a simplicial cone, not even without the
        `structure`; or that none keeps [0, state_bounds] within the other bounds); UNDECIDED otherwise.  Never a gain
        without proof.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError, NotProperConeError, SolverError
        Arguments that do not fit together; a solver that is not installed.

    Notes
    -----
    With T = (x_1 ... x_n) and z_k = xi_k F x_k, invariance and stability are linear in xi > 0 and z: see
    `control_kpos.design.simplicial.inequalities`.  A handful of programs with n + n m variables and n^2 rows: 20 ms for
    two states, 0.1 s for ten states and five inputs, proof included.  On other cones the alternation of
    `control_kpos.design.polyhedral.program` solves some dozens of programs.

    The paper's section V.A is `method="two-step"`; the default finds gains whenever there are any.

    Examples
    --------
    >>> import control as ct, control_kpos as kp, numpy as np
    >>> plant = ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)
    >>> d = kp.state_feedback(plant, X=[[0, 1], [1, -2]], rate=1)
    >>> bool(d), d.decay_rate >= 1, round(d.limit, 3)
    (True, True, 5.0)
    >>> d.closed_loop.is_cone_positive()
    True

    python-control takes it from there, with its own sign convention u = -K x:

    >>> controller, closed = ct.create_statefbk_iosystem(ct.ss(plant.A, plant.B, np.eye(2), 0), d.K)
    >>> same = ct.ss(plant.A + plant.B @ d.F, plant.B, plant.C, plant.D)
    >>> np.allclose(same.poles(), d.closed_loop.poles())
    True

    A demand that no gain meets:

    >>> kp.state_feedback(plant, X=kp.orthant(2)).status.name
    'REFUTED'
    """
    method, target = choice(method, "method", _METHODS), read_rate(rate)

    def design(lp: Programs) -> DesignResult:
        plant = read_plant(sys, X, gain_bound=gain_bound, structure=structure, vertices=vertices, ports=ports, gap=gap)
        own = constraints is not None or objective is not None
        if own and (target == "max" or (disturbance is not None and objective is not None)):
            raise DataError("constraints and objective go with a number as rate, and objective not with disturbance.")
        message = "B U is not inside X, and no feedback changes that; choose another X or U, or ports=False."
        blocked = beyond_feedback(plant, message, U=plant.system.U) if ports else None
        if blocked is not None:
            return _named(blocked, sys, plant.system)
        bounds = (state_bounds, input_bounds, disturbance_bounds)
        interval = read_interval(plant, *bounds) if any(part is not None for part in bounds) else None
        modes = per_mode is not False and flag(per_mode, "per_mode")
        if modes and isinstance(disturbance, (tuple, list)) and len(disturbance) > 2:
            raise DataError("per_mode goes with disturbance=(E, G), without H: z is the same in all modes.")
        if interval is not None and (own or disturbance is not None or target == "max"):
            raise DataError(
                "bounds on states, inputs or disturbances go with a number as rate, and not with disturbance, "
                "constraints or objective."
            )
        if interval is not None:
            plant = replace(plant, interval=interval)

        def designed(plant: Plant) -> DesignResult:
            if interval is not None:
                return design_in_interval(plant, target, lp, lambda free: _design(free, target, method, lp))
            if disturbance is not None:
                return _rejecting(plant, target, disturbance, constraints, method, lp)
            if own:
                return design_with_constraints(plant, target, constraints, objective, lp)
            return _design(plant, target, method, lp)

        result = taken_apart(designed(by_mode(plant)), plant) if modes else designed(plant)
        turned = partial(signals_by_mode, plant=plant) if modes else None
        if disturbance is not None and isinstance(result.certificate, PositivityCertificate):
            turned = Signals.of_states  # it is about w and z
        return _named(result, sys, plant.system, turned)

    return within(time_limit, design, solver=solver, progress=progress)


def _design(plant: Plant, target: Any, method: str, lp: Programs) -> DesignResult:
    if method == "two-step":
        return design_in_two_steps(plant, target if target != "max" else 0.0, lp)
    if method in ("one-shot", "first"):
        require_simplicial(plant.X, "the one-shot program")
    elif method == "alternation" or not plant.X.is_simplicial or plant.free is None:
        return design_by_alternation(plant, target, lp)
    if method == "first" and target != "max":
        return first_gain(plant, target, lp)
    result = design_on_simplicial(plant, target, lp)
    if len(plant.vertices) == 1 or result:
        return result
    return by_common_v(plant, target, lp) or result


def _rejecting(
    plant: Plant, target: Any, disturbance: Any, constraints: Any, method: str, lp: Programs
) -> DesignResult:
    if target == "max":
        raise DataError("disturbance goes with a fixed rate.")
    noisy = replace(plant, disturbance=read_disturbance(disturbance, plant))
    blocked = leaves_at_once(noisy)
    if blocked is not None:
        return blocked
    name = objective_of(noisy)
    if constraints is not None:
        free = partial(_rejecting, plant, target, disturbance, None, method, lp.on_highs())
        return reject_with_constraints(noisy, target, constraints, lp, name, free)
    if plant.X.is_simplicial and plant.free is not None and method != "alternation":
        return reject_disturbance(noisy, target, lp)
    return reject_by_alternation(noisy, target, lp, _design(plant, target, method, lp), name)


def read_rate(rate: Any) -> Any:
    """The number, as a fraction if it is no double; or "max"."""
    if isinstance(rate, str) and not is_number(rate):
        if rate != "max":
            raise DataError(f'rate is {found(rate)}; give a number, or "max".')
        return rate
    asked = exact_number(rate, "rate", nonnegative=True)
    return float(asked) if float(asked) == asked else asked


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
        Bound on |F C x_k|, input by input, at every generator of X, scaled as in `state_feedback`.
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
        `F` has shape (m, q), for u = F y; `K` = -F, for u = -K y.  REFUTED if invariance alone is impossible, or, on
        simplicial cones, if not even u = F x meets the demands; otherwise the alternation finds a gain or gives up.

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
    target = read_rate(rate)

    def design(lp: Programs) -> DesignResult:
        plant = read_plant(
            sys, X, gain_bound=gain_bound, structure=structure, vertices=vertices, ports=ports, output=True
        )
        if not plant.system.D.is_zero:
            raise DataError("output feedback needs D = 0; subtract D u from the measurement first (y - D u is known).")
        return _named(design_by_alternation(plant, target, lp), sys, plant.system)

    result = within(time_limit, design, solver=solver, progress=progress)
    return changed(result, objective=result.objective.replace("F x_k", "F C x_k"), law="u = F y")


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
        |L'h_k| <= gain_bound, output by output, at every facet h_k of X, scaled as in `state_feedback`.
    solver, time_limit, progress
        As in `state_feedback`.

    Returns
    -------
    DesignResult
        `L` (and `F`), shape (n, q); `closed_loop` is the observer from (u, y) to z; the certificate is about the dual
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
    >>> bool(d), d.L.shape
    (True, (2, 1))
    """
    target = read_rate(rate)

    def design(lp: Programs) -> DesignResult:
        system = read_system(sys, X)
        A, B, C, D = (M.T for M in system.matrices)
        plant = read_plant(System.read((A, C, B, D), X=system.X.dual, dt=system.dt), None, gain_bound=gain_bound)
        by = design_on_simplicial if plant.X.is_simplicial else design_by_alternation
        result = _named(by(plant, target, lp), sys, system, Signals.dual)
        return _as_observer(result, sys, system, result.F.T) if result else result

    return changed(within(time_limit, design, solver=solver, progress=progress), law=OBSERVER)


def _named(
    result: DesignResult, sys: Any, system: System, turned: Callable[[Signals], Signals] | None = None
) -> DesignResult:
    """The result, whose certificate knows the signals of sys by name; `turned` makes them those that it is about."""
    if result.status is Status.REFUTED and isinstance(sys, StateSpace) and result.certificate is not None:
        own = signals_of(sys, system.X, system.U, system.Y)
        named(result.certificate, own if turned is None else turned(own))
    return result


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
    return changed(result, F=L, closed_loop=observer, objective=objective, law=OBSERVER)
