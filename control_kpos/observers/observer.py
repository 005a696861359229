"""`interval_observer`: two copies of an observer that enclose the state of a plant for all time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from control import StateSpace, forced_response
from numpy.typing import ArrayLike

from ..cards import raised
from ..cones import Cone
from ..design.feedback import state_feedback
from ..design.network.search import by_node
from ..design.plant import Floats, read_system
from ..design.running import Programs, within
from ..errors import DataError, ShapeError
from ..exact.matrix import Matrix
from ..find import design_cone_and_feedback
from ..networks.blocks import Index
from ..networks.network import ConeNetwork
from ..proof.answer import Answer, first_proven
from ..proof.certificate import Status
from ..proof.portable_cones import portable_rows
from ..systems.statespace import ConeStateSpace
from ..systems.system import System
from .bounds import entry_rows, least_above, proven_observer
from .certificate import IntervalObserverCertificate
from .network import copy_of, proven_local, read_network, refused, simulated, spread_noise
from .network_certificate import NetworkObserverCertificate, blocks_of
from .program import Measured, shifted, unshifted
from .reading import distinct, finite, read_noise, read_pair, read_signal, read_times

# States up to which observers are designed: their bounds are proven in fractions.
_STATES = 60
# Final widths that a card shows one by one.
_SHOWN = 8
_NONE = (
    "no gains L and N were proven to keep this cone; other cones may do: leave X out, with a plain system, and one is "
    "looked for."
)
_NOWHERE = (
    "no cone with gains L and N was proven, and none was excluded: the plant may be hard to observe, or not observable "
    "at all. Give X, or measure more."
)
_IMPOSSIBLE = (
    "no gains L and N make (I - N C) A + L C keep this cone and decay; the proof is about the transposed plant."
)
_NO_LOCAL = (
    "no local gains L_j were proven to make the network of the A_j + L_j C_j positive on these cones and stable, and "
    "none were excluded. Measure at more nodes, weaken links, choose other cones of the nodes, or give X for one "
    "observer of the whole, with up to 60 states."
)
_IMPOSSIBLE_LOCALLY = (
    "no local gains L_j make the network of the A_j + L_j C_j positive on these cones and stable; the proof is about "
    "the transposed network."
)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class IntervalObserver(Answer):
    """Outcome of `interval_observer`.  `bool(answer)` is True only for PROVED; otherwise there is no observer.

    Attributes
    ----------
    L, N : ndarray, shape (n, q), or None
        Gains: z = (I - N C) x, and F = (I - N C) A + L C keeps `cone`.  python-control's observer gain is -L.  Of a
        network L holds the gains L_j of all nodes, (N, n, q) or a tuple if nodes differ in size, and N is None.
    cone : Cone or None
        In whose order the two copies enclose z.
    width : ndarray, shape (n,), or None
        Proven: the distance of the bounds on each state tends to at most this.
    system : control.StateSpace or None
        Both copies, from (y, u, one) to (upper, lower); the last input is 1 at all times.  Of a network one
        copy, a `ConeNetwork` from (u_j, y_j, upper_j or lower_j) of every node to its outputs.
    certificate : IntervalObserverCertificate, NetworkObserverCertificate or None
        Proof of the enclosure; or that no gains exist for the cone.
    ports : tuple of two ndarrays of int, or None
        Of a network: places of the known inputs and of the measurements among the inputs and outputs of all nodes.
    """

    L: Floats | None = None
    N: Floats | None = None
    cone: Cone | None = None
    width: Floats | None = None
    system: StateSpace | None = None
    ports: tuple[Index, Index] | None = None

    def facts(self) -> list[tuple[str, str]]:
        """Final widths, for the card that a notebook shows.

        Returns
        -------
        list of (str, str)
        """
        if self.width is None:
            return []
        if len(self.width) > _SHOWN:
            return [("largest final width", raised(self.width.max(), 4))]
        return [("final width", ", ".join(raised(x, 4) for x in self.width))]

    def simulate(self, T: ArrayLike, y: ArrayLike, u: ArrayLike | None = None, *, x0: Any) -> tuple[Floats, Floats]:
        """Bounds on the states from measurements.

        Parameters
        ----------
        T : array_like, shape (k,)
            Times, evenly spaced, from the first measurement on.
        y : array_like, shape (q, k), or (k,) for one output
            Measurements.
        u : array_like, shape (m, k), or (k,) for one input, optional
            Known inputs; default: 0.
        x0 : (lo, hi), shapes (n,)
            Bounds on the first state, entry by entry.

        Returns
        -------
        lower, upper : ndarray, shape (n, k)

        Raises
        ------
        DataError, ShapeError
            Nothing was proven; times that are not evenly spaced; signals of other sizes; lo > hi; bounds beyond the
            range of doubles.

        Notes
        -----
        In floating point.  In continuous time y and u are taken as linear between their samples: what they differ
        from that in between counts as noise of y and as disturbance.

        Examples
        --------
        >>> import control as ct, control_kpos as kp, numpy as np
        >>> o = kp.interval_observer(ct.ss(-1, 1, 1, 0), disturbance=([-1], [1]), noise=[0.1])
        >>> lower, upper = o.simulate([0, 1, 2], [0, 0, 0], x0=([-1], [1]))
        >>> bool((lower <= 0).all() and (upper >= 0).all())
        True
        """
        proof, system = self.certificate, self.system
        if not isinstance(proof, IntervalObserverCertificate | NetworkObserverCertificate) or system is None:
            raise DataError(f"the observer is {self.status.name}, and encloses nothing; see explain().")
        times, n = read_times(T, system.dt), proof.X.dim
        m, q = self._counts(proof, system)
        known = np.zeros((m, len(times))) if u is None else u
        signals = read_signal(y, "y", q, len(times)), read_signal(known, "u", m, len(times))
        if isinstance(proof, NetworkObserverCertificate) and self.ports is not None:
            with np.errstate(all="ignore"):
                return finite(*simulated(proof, system, self.ports, times, signals, read_pair(x0, "x0", n)))
        inputs, first = np.concatenate([*signals, np.ones((1, len(times)))]), self.start(x0)
        with np.errstate(all="ignore"):
            bounds = np.asarray(forced_response(system, times, inputs, first, squeeze=False).outputs)
        return finite(bounds[n:], bounds[:n])

    def start(self, x0: Any) -> Floats:
        """First states of `system`, so that its outputs enclose every state of the plant from here on.

        Parameters
        ----------
        x0 : (lo, hi), shapes (n,)
            Bounds on the first state, entry by entry.

        Returns
        -------
        ndarray, shape (2 n,)
            For `control.forced_response` and the like.

        Raises
        ------
        DataError, ShapeError
            Nothing was proven, or this is about a network; bounds of other sizes; lo > hi.

        Examples
        --------
        >>> import control as ct, control_kpos as kp
        >>> plant = ct.ss(-1, 1, 1, 0, inputs="u", outputs="y", states="x", name="plant")
        >>> o = kp.interval_observer(plant, disturbance=([-1], [1]), noise=[0.1])
        >>> both = ct.interconnect([plant, o.system], inputs=["u", "one"], outputs=["x_upper", "x_lower"])
        >>> x0 = [0, *o.start(([-1], [1]))]
        >>> response = ct.forced_response(both, [0, 1, 2], [[0, 0, 0], [1, 1, 1]], x0)
        >>> bool((response.outputs[0] >= 0).all() and (response.outputs[1] <= 0).all())
        True
        """
        proof = self.certificate
        if not isinstance(proof, IntervalObserverCertificate):
            raise DataError("start is about the observer of one plant; `simulate` takes x0 for networks.")
        return np.concatenate([_first(proof, x0, 1), -_first(proof, x0, -1)])

    def _counts(self, proof: Any, system: StateSpace) -> tuple[int, int]:
        """Numbers of known inputs and of measurements."""
        if self.ports is not None:
            return len(self.ports[0]), len(self.ports[1])
        return system.ninputs - len(proof.noise) - 1, len(proof.noise)


def _first(proof: IntervalObserverCertificate, x0: Any, sign: int) -> Floats:
    """A vector above z(0) = T x(0) in the order of X; with the other sign one above -z(0)."""
    lo, hi = (part.fractions() for part in read_pair(x0, "x0", proof.X.dim))
    H = portable_rows(proof.X.exact_facets) @ proof.equation.T
    try:
        d = least_above(proof.X, np.maximum(sign * H * hi, sign * H * lo).sum(axis=1))
    except OverflowError:  # beyond all doubles
        d = None
    if d is None:
        raise DataError("x0 could not be enclosed in the order of the cone; scale the states.")
    return np.array(d, dtype=float)


def interval_observer(
    sys: Any,
    *,
    disturbance: Any = None,
    noise: ArrayLike = 0,
    X: Cone | ArrayLike | None = None,
    time_limit: float | None = None,
) -> IntervalObserver:
    """Find two copies of an observer that enclose the state for all time, with a small final width.

    The plant is x' = A x + B u + w, y = C x + D u + n with w in [w_lo, w_hi] and |n| <= noise, entry by entry.  The
    observer is z' = F z + K (y - D u) + T B u + constants for z = T x, T = I - N C; see `IntervalObserverCertificate`.

    A network of any size gets local observers: each node two copies of itself, with a gain L_j for those of its own
    outputs that are outputs of `sys`; copies of neighbours exchange outputs through the links of the network, and
    nothing is measured elsewhere.  See `NetworkObserverCertificate`.

    Parameters
    ----------
    sys : ConeStateSpace, control.StateSpace or network
        In continuous or discrete time.  Of a network: its inputs are known, its outputs measured.
    disturbance : (w_lo, w_hi), shapes (n,), optional
        Bounds on what adds to x' (to x[k+1]), entry by entry, in the units of x' (of x); default: 0.
    noise : float or array_like, shape (q,)
        Bounds on |n|, in the units of y, for all outputs or for each; default: 0.
    X : Cone or array_like of rays, optional
        The cone in whose order z is enclosed.  Default: that of a ConeStateSpace; of a plain system the orthant, and
        where that does not work one that is found for the transposed plant.  For a network, which has the cones of its
        nodes: one observer for the whole instead of local ones.
    time_limit : float, optional
        Seconds; what is not settled by then is UNDECIDED.

    Returns
    -------
    IntervalObserver
        PROVED with gains, cone, final width and both copies as one system.  REFUTED, on simplicial cones only:
        no gains L and N make F keep the cone and decay; of a network, no local gains do.  UNDECIDED: none was found,
        or none could be proven.

    Raises
    ------
    DataError, ShapeError, ConeMismatchError, NotProperConeError
        Arguments that do not fit together; more than 60 states, but for networks; nodes of a network with feedthrough,
        or with state cones that are not simplicial.

    Notes
    -----
    On simplicial cones the sum of the final widths is minimised by a linear program for N = 0 and for an N of another
    program, and the narrower of the two is taken; without noise the gains are kept small, and smaller gains are taken
    where they cost less than 0.1 % of that sum.  On other cones the narrowest of a few is taken, among them those of
    the largest decay rate.  Proofs take n^3 operations in fractions.

    For networks, with N = 0, one sparse program minimises that sum, and proofs are linear in nodes and links: some
    seconds for 10 000 nodes of two states.

    Examples
    --------
    The double integrator, for which no A + L C keeps the orthant and decays:

    >>> import control as ct, control_kpos as kp
    >>> plant = ct.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0)
    >>> o = kp.interval_observer(plant, disturbance=([0, -1], [0, 1]), noise=[0.1])
    >>> bool(o), o.L.shape, bool(o.width.max() < 5)
    (True, (2, 1), True)

    Three nodes in a ring, of which only the first is measured:

    >>> nodes = kp.stack([[[-2, 1], [1, -2]]] * 3, [[0], [1]], [[1, 0]])
    >>> net = kp.feedback_interconnect(nodes, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], outputs=[0])
    >>> o = kp.interval_observer(net, disturbance=([-1] * 6, [1] * 6), noise=0.1)
    >>> bool(o), o.L.shape, bool(o.width[0] < o.width[2])
    (True, (3, 2, 1), True)
    """
    if isinstance(sys, ConeNetwork) and X is None:
        return _of_network(sys, disturbance, noise, time_limit)
    system = read_system(sys, X)
    system.X.require_proper("X")
    n, _, q = system.sizes
    if n > _STATES:
        raise DataError(
            f"sys has {n} states; observers are designed for at most {_STATES}. Take its parts one by one; "
            "a network of any size gets local observers without X."
        )
    if not q:
        raise ShapeError("sys has no outputs; an observer needs a measurement.")
    box = (*_disturbance(disturbance, n), read_noise(noise, q))
    free = X is None and not isinstance(sys, ConeStateSpace)
    return within(time_limit, lambda lp: _designed(sys, system, box, free, lp), answer=IntervalObserver)


Box = tuple[Matrix, Matrix, Matrix]


def _disturbance(given: Any, n: int) -> tuple[Matrix, Matrix]:
    return read_pair([np.zeros(n)] * 2 if given is None else given, "disturbance", n)


def _of_network(net: ConeNetwork, disturbance: Any, noise: Any, time_limit: float | None) -> IntervalObserver:
    """Local observers."""
    plant, ports = read_network(net), net.external
    w_lo, w_hi = _disturbance(disturbance, net.nstates)
    box = w_lo, w_hi, spread_noise(net, read_noise(noise, net.noutputs))

    def design(lp: Programs) -> IntervalObserver:
        proof = proven_local(plant, ports[1], box, lp)
        if proof is None:
            found = refused(plant, ports[1])
            return IntervalObserver(
                status=Status.UNDECIDED if found is None else Status.REFUTED,
                certificate=None if found is None else found.certificate,
                message=_NO_LOCAL if found is None else _IMPOSSIBLE_LOCALLY,
            )
        return IntervalObserver(
            status=Status.PROVED,
            certificate=proof,
            L=by_node(plant, [np.asarray(L.values) for L in blocks_of(plant, proof.gain, 0, 2)]),
            cone=proof.X,
            width=proof.width,
            system=copy_of(proof, net),
            ports=ports,
        )

    return within(time_limit, design, "network", answer=IntervalObserver)


def _designed(sys: StateSpace, system: System, box: Box, free: bool, lp: Programs) -> IntervalObserver:
    best = _narrowest(system, system.X, box, lp)
    if best is None:
        dual = state_feedback(_dual(system, system.X, moved=True))
        if not dual and not free:
            refuted = dual.status is Status.REFUTED and system.X.is_simplicial
            return IntervalObserver(
                status=Status.REFUTED if refuted else Status.UNDECIDED,
                certificate=dual.certificate if refuted else None,
                message=_IMPOSSIBLE if refuted else _NONE,
            )
        best = _fast(system, system.X, box, _split(dual.F.T, system)) if dual else None
    if best is None and free:
        best = _elsewhere(system, box, lp)
    if best is None:
        return IntervalObserver(status=Status.UNDECIDED, message=_NOWHERE if free else _NONE)
    return _answer(sys, system, best)


def _narrowest(system: System, X: Cone, box: Box, lp: Programs) -> IntervalObserverCertificate | None:
    """The narrowest observer of those proven first with N = 0 and with another N; None without a simplicial cone."""
    if not X.is_simplicial:
        return None
    A, C, w_lo, w_hi, noise = (np.asarray(M.dense().values, dtype=float) for M in (system.A, system.C, *box))
    plant = Measured(A, C, np.asarray(X.rays, dtype=float).T, w_hi - w_lo, noise, system.discrete)
    proofs = [
        first_proven(proposals(plant, lp), lambda p: proven_observer(system, X, box, (p.L, p.N)))
        for proposals in (unshifted, shifted)
    ]
    return min((p for p in proofs if p is not None), key=_total, default=None)


def _fast(system: System, X: Cone, box: Box, first: tuple[Floats, Floats]) -> IntervalObserverCertificate | None:
    """The narrowest of the observer with these gains and of those that decay fastest, with N = 0 and with another N."""
    tried = [first]
    for moved in (False, True):
        dual = state_feedback(_dual(system, X, moved=moved), rate="max")
        if dual:
            L = np.asarray(dual.F.T)
            tried.append(_split(L, system) if moved else (L, np.zeros_like(L)))
    proofs = (proven_observer(system, X, box, gains) for gains in tried)
    return min((p for p in proofs if p is not None), key=_total, default=None)


def _total(proof: IntervalObserverCertificate) -> float:
    return float(np.sum(proof.width))


def _dual(system: System, X: Cone, *, moved: bool) -> ConeStateSpace:
    """x' = A'x + C'u on the dual cone, with the inputs -(C A)' besides: its gains are those of an observer."""
    A, C = (M.plain().fractions() for M in (system.A, system.C))
    outputs = np.concatenate([C, -(C @ A)]) if moved else C
    n = len(A)
    return ConeStateSpace(A.T, outputs.T, np.eye(n), np.zeros((n, len(outputs))), system.dt, X=X.dual)


def _split(both: Floats, system: System) -> tuple[Floats, Floats]:
    """L and N of the gain for C x and -C A x."""
    q = system.sizes[2]
    return both[:, :q], both[:, q:]


def _elsewhere(system: System, box: Box, lp: Programs) -> IntervalObserverCertificate | None:
    """An observer for a cone that is found together with a gain of the transposed plant."""
    dual = StateSpace(system.A.dense().values.T, system.C.dense().values.T, np.eye(system.sizes[0]), 0, system.dt)
    found_cone = design_cone_and_feedback(dual)
    if not found_cone or found_cone.cone is None or found_cone.F is None:
        return None
    X = found_cone.cone.dual
    narrow = _narrowest(system, X, box, lp)
    L = np.asarray(found_cone.F).T
    return _fast(system, X, box, (L, np.zeros_like(L))) if narrow is None else narrow


def _answer(sys: StateSpace, system: System, proof: IntervalObserverCertificate) -> IntervalObserver:
    return IntervalObserver(
        status=Status.PROVED,
        certificate=proof,
        L=np.asarray(proof.gain.values),
        N=np.asarray(proof.shift.values),
        cone=proof.X,
        width=proof.width,
        system=_copies(sys, system, proof),
    )


def _copies(sys: StateSpace, system: System, proof: IntervalObserverCertificate) -> StateSpace:
    """Both copies, from (y, u, one) to bounds on the states, entry by entry."""
    equation = proof.equation
    T, F, K = (np.array(M, dtype=float) for M in (equation.T, equation.F, equation.K))
    B, D, N = (np.asarray(M.dense().values, dtype=float) for M in (system.B, system.D, proof.shift))
    driven = np.hstack([K, T @ B - K @ D])
    inputs = np.block([[driven, proof.upper[:, None]], [driven, proof.lower[:, None]]])
    a, b = entry_rows(proof)
    around = (np.abs(N) @ proof.noise)[:, None]
    through = np.hstack([N, -N @ D])
    return StateSpace(
        np.kron(np.eye(2), F),
        inputs,
        np.block([[a, -b], [-b, a]]),
        np.block([[through, around], [through, -around]]),
        system.dt,
        remove_useless_states=False,
        inputs=distinct([*sys.output_labels, *sys.input_labels, "one"]),
        outputs=[f"{label.replace('.', '_')}_{end}" for end in ("upper", "lower") for label in sys.state_labels],
        states=[f"{label}_{end}" for end in ("hi", "lo") for label in sys.state_labels],
        name=f"{sys.name}$observer",
    )
