"""The closed loop of a network as one cone system: its cones, Theorems 1 to 3, connections and selections.

Positivity and stability follow from the nodes (Theorem 4) in any number.  Where they do not, and for supply rates and
gains of the whole, the theorems for one system decide on the closed loop.  Connections of networks only add links:

    append             W = diag(W1, W2)
    series  s1 s2      W = diag(W2, W1) and the outputs of s2 on the inputs of s1
    feedback           W = diag(W1, W2), y1 on the inputs of s2 and sign y2 on those of s1
    gain    K          W1 and sign K from the outputs to the inputs
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from functools import cached_property, partial
from typing import Any, Literal, TypeVar

import numpy as np
from control import InputOutputSystem, StateSpace
from numpy.typing import ArrayLike

from ..cones import Cone
from ..errors import NotProperConeError, TooLargeError, UndecidedError
from ..exact.intake import exact_matrix, exact_number, seconds
from ..exact.matrix import Matrix
from ..progress import Reporter, Target
from ..proof.certificate import Status, exactly
from ..proof.in_time import in_time, kept
from ..systems.cones_of_connections import lies_in, opposite
from ..systems.operations import as_gain
from ..systems.reading import read_operand
from ..systems.rounding import maps_into
from ..systems.system import System
from ..theorems.blocks import Blocks
from ..theorems.dissipativity import DissipativityCertificate
from ..theorems.gains import Norm
from ..theorems.positivity import PositivityCertificate, state_positivity
from ..theorems.stability import LyapunovCertificate, by_vector
from ..theorems.structured_gain import StructuredGainCertificate
from .blocks import Index
from .certificate import NetworkCertificate
from .certify import certify, loop_weights, positive_form
from .dense_on_demand import DENSE_STATES
from .files import product_cone
from .gains import network_gain, upper_gain
from .model import NetworkModel
from .ports import Ports, beside, is_system_with_states, port_cone, with_gain
from .responses import NetworkResponses
from .witnesses import NetworkInstability

_SIDES = ("inputs", "outputs")
C = TypeVar("C")


class ClosedLoopSystem(NetworkResponses):
    """Verdicts on a network as one system, and its connections with others; see `ConeNetwork`."""

    def __init__(
        self,
        model: NetworkModel,
        *,
        external: tuple[Index, Index] | None = None,
        name: str | None = None,
        certificate: NetworkCertificate | None = None,
        find: Callable[[NetworkModel], NetworkCertificate] | None = None,
        progress: Target = None,
        time_limit: float | None = None,
    ) -> None:
        super().__init__(model, external=external, name=name, progress=progress)
        self.time_limit = seconds(time_limit)
        self._find = certify if find is None else find
        if certificate is not None:
            self.__dict__["certificate"] = certificate

    # -- cones and data

    @cached_property
    def X(self) -> Cone:  # type: ignore[override]
        """State cone: the product of the nodes' state cones, in their order."""
        return product_cone(self.model, 0)

    @cached_property
    def U(self) -> Cone:  # type: ignore[override]
        """Input cone: the product of what the external inputs keep of the nodes' input cones."""
        return port_cone(Ports.of(self), 1)

    @cached_property
    def Y(self) -> Cone:  # type: ignore[override]
        """Output cone: the product of what the outputs show of the nodes' output cones."""
        return port_cone(Ports.of(self), 2)

    @property
    def _cones(self) -> tuple[Cone, Cone, Cone]:  # type: ignore[override]
        return self.X, self.U, self.Y

    @property
    def exact(self) -> System:
        """The closed loop: exact up to `EXACT_STATES` = 300 states, above that its sparse matrices of doubles."""
        A, B, C, D = self.loop.matrices
        inputs, outputs = self.external
        if self._external is not None:
            B, C, D = B[:, inputs], C[outputs], D[outputs][:, inputs]
        return System(A, B, C, D, self.X, self.U, self.Y, self.dt)

    @property
    def certificate(self) -> NetworkCertificate:
        """Theorem 4 for this network: PROVED, or REFUTED with what breaks it; UNDECIDED if a time limit ends it."""
        return kept(self, "certificate", self._certificate)

    def _certificate(self) -> NetworkCertificate:
        with Reporter(self._progress) as report:
            find = partial(certify, progress=report) if self._find is certify else self._find
            return self._in_time(None, partial(find, self.model), lambda: NetworkCertificate.settle(model=self.model))

    def _in_time(self, time_limit: Any, find: Callable[[], C], nothing: Callable[[], C]) -> C:
        """What is found within the limit, or that of the network if none is given; else what proves nothing."""
        return in_time(self.time_limit if time_limit is None else time_limit, find, nothing)

    # -- verdicts on the closed loop as one system

    @cached_property
    def _positive_by_parts(self) -> bool:
        """True if every node is positive, W maps Y into U, and algebraic loops contract: (I) and (II) of Theorem 4."""
        known = vars(self).get("certificate")
        if known is not None and (known.status is Status.PROVED or isinstance(known.witness, NetworkInstability)):
            return known.status is not Status.UNDECIDED
        return positive_form(self.model) is not None

    def is_cone_positive(self, *, time_limit: float | None = None) -> bool:
        """Decide whether x stays in X and y in Y for all x(0) in X and w(t) in U.

        Parameters
        ----------
        time_limit : float, optional
            Seconds.  Default: that of the network.

        Returns
        -------
        bool

        Raises
        ------
        UndecidedError
            A network of more than `EXACT_STATES` states whose parts do not prove it, and rounding hides it; or the time
            limit ended the search.

        Notes
        -----
        Positive nodes, W Y in U and contracting algebraic loops suffice, in any number; otherwise Theorem 1 decides
        on the closed loop.  Supply rates play no role.
        """
        if self._in_time(time_limit, lambda: self._positive_by_parts, lambda: False):
            return True
        found = self.cone_positivity(time_limit=time_limit)
        if found.status is Status.UNDECIDED:
            raise UndecidedError(f"{self.name}: {found.explain()}")
        return bool(found)

    def cone_positivity(self, *, time_limit: float | None = None) -> PositivityCertificate:
        """Theorem 1 for the closed loop from w to y, on the products X, U and Y.

        Parameters
        ----------
        time_limit : float, optional
            Seconds; what is not settled by then is UNDECIDED.  Default: that of the network.

        Returns
        -------
        PositivityCertificate
            About the exact closed loop up to `EXACT_STATES` = 300 states, above that about its sparse matrices of
            doubles; UNDECIDED where only their rounding breaks what the parts of the network prove.
        """
        return self._in_time(
            time_limit, self._positivity, lambda: _without_witness(super(ClosedLoopSystem, self).cone_positivity())
        )

    def _positivity(self) -> PositivityCertificate:
        found = super().cone_positivity()
        if found.witness is None or self.loop.is_exact or not self._positive_by_parts:
            return found
        return _without_witness(found)

    def linear_lyapunov(
        self,
        rate: Literal["max"] | float | Fraction | str | None = None,
        *,
        time_limit: float | None = None,
    ) -> LyapunovCertificate:
        """Theorem 2 for the closed loop, as one system.

        Parameters
        ----------
        rate : "max" or number, optional
            A positive number: this decay rate is claimed too.  "max": the fastest decay rate that can be proven.
            Both factor A, so not for millions of states.
        time_limit : float, optional
            Seconds; what is not settled by then is UNDECIDED.  Default: that of the network.

        Returns
        -------
        LyapunovCertificate
            About the matrix that `cone_positivity` is about.  Above `EXACT_STATES` states v is that of `certificate`,
            sum sigma_j v_j'x_j, if that proves it.
        """
        return self._in_time(
            time_limit,
            lambda: self._lyapunov(rate),
            lambda: LyapunovCertificate.settle(positivity=self._positivity_of_states()),
        )

    def _lyapunov(self, rate: Any = None) -> LyapunovCertificate:
        known = None if rate is not None or self.loop.is_exact else self.certificate
        if not known or known.v is None or known.sigma is None:
            return super().linear_lyapunov(rate)
        positivity = self._positivity_of_states()
        v = known.sigma[self.model.owners(0)] * exactly(known, "v").values
        draft = by_vector(positivity, Matrix(v))
        return draft if draft else super().linear_lyapunov(rate)

    def _positivity_of_states(self) -> PositivityCertificate:
        return state_positivity(self.exact.A, self.X, discrete=self.model.discrete)

    def dissipativity(
        self, q: ArrayLike | None = None, r: ArrayLike | None = None, *, time_limit: float | None = None
    ) -> DissipativityCertificate:
        """Theorem 3 for the closed loop from w to y, as one system.

        Parameters
        ----------
        q : array_like, shape (noutputs,), optional
        r : array_like, shape (ninputs,), optional
            What is not given is found.
        time_limit : float, optional
            Seconds; what is not settled by then is UNDECIDED.  Default: that of the network.

        Returns
        -------
        DissipativityCertificate

        Raises
        ------
        TooLargeError
            More than `DENSE_STATES` = 5000 states: the search factors dense matrices.
        """
        self._require_moderate("dissipativity")
        return self._in_time(
            time_limit,
            lambda: super(ClosedLoopSystem, self).dissipativity(q, r),
            lambda: DissipativityCertificate.settle(
                positivity=super(ClosedLoopSystem, self).cone_positivity(), q=self._supply(q)
            ),
        )

    def _supply(self, q: Any) -> Any:
        return -np.asarray(self.Y.dual.interior_point) if q is None else exact_matrix(q, "q", ndim=1)

    def gain(
        self,
        norm: Norm = "L1",
        e: ArrayLike | None = None,
        f: ArrayLike | None = None,
        *,
        time_limit: float | None = None,
    ) -> float:
        """Induced gain of the closed loop from w in U to y in Y; inf if it is not stable.

        Above `DENSE_STATES` = 5000 states "L2" is the upper bound that `control_kpos.structured_gain` proves.

        Parameters
        ----------
        norm : {"L1", "L2", "Linf"}
        e : array_like, shape (ninputs,), optional
        f : array_like, shape (noutputs,), optional
            Weights for general cones, see `control_kpos.gains.induced_gain`.
        time_limit : float, optional
            Seconds.  Default: that of the network.

        Returns
        -------
        float

        Raises
        ------
        TooLargeError
            More than `DENSE_STATES` states, and another norm than "L2": the DC gain takes a dense matrix.
        UndecidedError
            Nothing was proven, or not within the time limit.
        """
        found = self._in_time(time_limit, lambda: self._gain(norm, e, f), lambda: None)
        if found is None:
            raise UndecidedError(f"{self.name}: the gain is not known: the time limit ended the search; more may help.")
        return found

    def _gain(self, norm: Norm, e: Any, f: Any) -> float:
        if self.nstates > DENSE_STATES and norm == "L2" and e is None and f is None:
            return upper_gain(self._gain_at_scale("full"))
        self._require_moderate("gain")
        return super().gain(norm, e, f)

    def _gain_at_scale(self, structure: Any) -> StructuredGainCertificate | None:
        """What `structured_gain` finds by sparse solves; None where dense matrices are at hand, or are needed."""
        self.require_certain()
        blocks = Blocks.read(structure, self.ninputs, self.noutputs)
        if self.loop.is_exact or not (blocks.count == 1 or blocks.is_diagonal):
            return None
        stable = None if self.certificate else self.linear_lyapunov()
        return network_gain(self.cone_positivity(), stable, blocks, self.model, self.external)

    def require_certain(self) -> None:
        """Nothing here; networks that are known within sets raise DataError where one system is needed."""

    def _require_moderate(self, what: str) -> None:
        if self.nstates > DENSE_STATES:
            raise TooLargeError(
                f"{what} of this network with {self.nstates} states as one system is refused (limit {DENSE_STATES}); "
                "its certificate has a supply rate for every node."
            )

    # -- connections

    def append(self, other: Any) -> StateSpace:
        """Systems side by side: a network if the other one has cones and states.

        Parameters
        ----------
        other : StateSpace or what python-control converts into one

        Returns
        -------
        ConeNetwork or StateSpace
        """
        if not is_system_with_states(other):
            return super().append(other)
        self._require_operand(other)
        first = Ports.of(self)
        both, second = beside(first, Ports.of(other))
        inputs, outputs = (np.concatenate([getattr(part, kind) for part in (first, second)]) for kind in _SIDES)
        return self._joined(Ports(both, inputs, outputs))

    def feedback(self, other: Any = 1, sign: float = -1) -> Any:
        """The loop u = r + sign * y2, where `other` maps y to y2: a network again where cones follow.

        Parameters
        ----------
        other : StateSpace, number, array_like, or what python-control accepts
        sign : float
            +1 for positive feedback; the default is python-control's.

        Returns
        -------
        ConeNetwork or StateSpace
            A `ConeNetwork` if Y1 lies in U2, sign * Y2 in U1 (sign * K maps Y1 into U1) and the direct terms
            allow it; otherwise what python-control makes of it.  `feedback_interconnect` and `with_links` close
            any loop as a network.

        Examples
        --------
        >>> import control_kpos as kp
        >>> node = kp.ConeStateSpace([[-2]], [[1]], [[1]], 0)
        >>> net = kp.feedback_interconnect([node] * 2, [[0, 1], [1, 0]], inputs=[0], outputs=[1])
        >>> type(net.feedback(node, sign=1)).__name__, type(net.feedback(node)).__name__
        ('ConeNetwork', 'StateSpace')
        """
        ports = self._closed_by(other, sign)
        if ports is not None:
            contracts = not ports.model.has_feedthrough or loop_weights(ports.model) is not None
            if contracts:
                return self._joined(ports)
        return super().feedback(other, sign)

    def _closed_by(self, other: Any, sign: Any) -> Ports | None:
        """The loop as a network, or None if cones do not follow or the arguments are for python-control to judge."""
        read_operand(other)
        k = exact_number(sign, "sign")
        if is_system_with_states(other):
            self._require_operand(other)
            returned = other.Y if k >= 0 else opposite(other.Y)
            fits = (self.noutputs, self.ninputs) == (other.ninputs, other.noutputs)
            if fits and lies_in(self.Y, other.U) and (k == 0 or lies_in(returned, self.U)):
                own, back = Ports.of(self), Matrix.from_fractions(np.full(other.noutputs, k, dtype=object))
                there = False, True, Matrix(np.ones(self.noutputs))
                both, _ = beside(own, Ports.of(other), there, (True, False, back))
                return replace(own, model=both)
            return None
        K = None if isinstance(other, InputOutputSystem) else as_gain(other)
        if K is None or K.shape != (self.ninputs, self.noutputs):
            return None
        signed = Matrix.from_fractions(K.fractions() * k)
        return with_gain(Ports.of(self), signed) if maps_into(signed, self.Y, self.U) else None

    def __mul__(self, other: Any) -> Any:
        if not is_system_with_states(other) or self.ninputs != other.noutputs or not lies_in(other.Y, self.U):
            return super().__mul__(other)
        self._require_operand(other)
        inner, one = Ports.of(other), Matrix(np.ones(other.noutputs))
        both, outer = beside(inner, Ports.of(self), (False, True, one))  # states in python-control's order
        return self._joined(Ports(both, inner.inputs, outer.outputs))

    def __getitem__(self, key: Any) -> StateSpace:
        try:
            outputs, inputs = key
            chosen = _places(outputs, self.output_index), _places(inputs, self.input_index)
        except (TypeError, ValueError, KeyError):
            return super().__getitem__(key)
        own = Ports.of(self)
        part = Ports(own.model, own.inputs[chosen[1]], own.outputs[chosen[0]])
        if not all(_has_cone(part, kind) for kind in (1, 2)):
            return super().__getitem__(key)
        return self._joined(part, f"{self.name}$indexed", vars(self).get("certificate"))

    def _joined(self, ports: Ports, name: str | None = None, certificate: NetworkCertificate | None = None) -> Any:
        external = ports.inputs, ports.outputs
        more = {"name": name, "certificate": certificate, "progress": self._progress, "time_limit": self.time_limit}
        return type(self)(ports.model, external=external, **more)


def _without_witness(found: PositivityCertificate) -> PositivityCertificate:
    """What is left of a verdict if its witness is not trusted."""
    return PositivityCertificate.settle(**{**found.data(), "witness": None})


def _places(key: Any, labels: Mapping[str, int]) -> Index:
    """Places of signals by number, name, slice, or a list of numbers and names."""
    if isinstance(key, slice):
        return np.arange(len(labels))[key]
    places = [labels[item] if isinstance(item, str) else item for item in (key if isinstance(key, list) else [key])]
    if any(isinstance(place, bool) or not isinstance(place, (int, np.integer)) for place in places):
        raise TypeError
    if any(not -len(labels) <= place < len(labels) for place in places):
        raise ValueError
    return np.array(places, dtype=np.intp) % len(labels)


def _has_cone(part: Ports, kind: int) -> bool:
    """True if something proper is left of the cones of the nodes."""
    try:
        return port_cone(part, kind).is_proper
    except NotProperConeError:
        return False
