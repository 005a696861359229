"""ConeNetwork: the closed loop of a network as a python-control StateSpace that stays sparse."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from control import StateSpace, TimeResponseData
from numpy.typing import ArrayLike, NDArray

from ..arrays import exact_matrix, vector
from ..cards import card
from ..certificates.result import Status
from ..cones import Cone, product
from ..errors import DataError, ShapeError, TooLargeError, UndecidedError
from ..statespace import ConeStateSpace
from .abscissa import descend
from .blocks import Floats, Index
from .bracket import AbscissaCertificate, bracket
from .certificate import NetworkCertificate
from .certify import certify
from .closedloop import ClosedLoop
from .coupling import read_coupling
from .edits import LocalCertificate, Overlay, check_timebase, inherit
from .model import READABLE, NetworkModel, NodeStack, gather
from .simulate import delayed, respond, sample_times
from .solvers import PortSystem

# States above which dense matrices are refused (200 MB for A).
DENSE_STATES = 5_000
# Numbers a response may hold before it has to be narrowed down.
RESPONSE_LIMIT = 200_000_000


class ConeNetwork(StateSpace):
    """The closed loop u = W y + w of many nodes; made by `feedback_interconnect`.

    ::

        w --->(+)---> [ nodes x' = A x + B u ] ---> y
               ^                                |
               +--------- coupling W <----------+

    A `control.StateSpace` from the external inputs w to the outputs y.  Its A, B, C, D are dense arrays
    made on demand for up to `DENSE_STATES` = 5000 states, so that python-control's functions work; above
    that they raise `TooLargeError` and name the sparse attributes, which have no such limit.

    Attributes
    ----------
    model : NetworkModel
        Nodes in stacks and the coupling.
    certificate : NetworkCertificate
        Theorem 4: proof of positivity and stability, or what breaks them.  Found when first asked for.
    sparse_A, sparse_B, sparse_C, sparse_D : csr_array
        The closed loop from w to y.
    X, U, Y : Cone
        Products of the nodes' cones, restricted to the external signals for U and Y where that is a product.
    """

    def __init__(
        self,
        model: NetworkModel | None = None,
        *,
        overlay: Overlay | None = None,
        external: tuple[Index, Index] | None = None,
        name: str | None = None,
        certificate: NetworkCertificate | LocalCertificate | None = None,
        find: Callable[[NetworkModel], NetworkCertificate] | None = None,
        progress: Callable[[str], None] | bool | None = None,
    ) -> None:
        # StateSpace.__init__ would ask for dense matrices; set up what the classes above it need.
        self.name = self._name_or_default(name)
        self._overlay = overlay
        if model is not None:
            self.__dict__["model"] = model
            self.__dict__["loop"] = ClosedLoop(model)  # refuses networks that are not well posed
        self._external = external
        self.dt = model.dt if model is not None else overlay.base.model.dt if overlay is not None else None
        self._repr_format = None
        self.params: dict[str, Any] = {}
        self._current_params: dict[str, Any] = {}
        self._progress = progress
        self._find = certify if find is None else find
        if certificate is not None:
            self.__dict__["certificate"] = certificate

    @cached_property
    def model(self) -> NetworkModel:
        """Nodes in stacks and the coupling."""
        if self._overlay is None:
            raise DataError("a network needs a model.")
        return self._overlay.build()

    @cached_property
    def loop(self) -> ClosedLoop:
        """The closed loop as sparse matrices and as an operator."""
        return ClosedLoop(self.model)

    @cached_property
    def _inputs(self) -> Index:
        return np.arange(self.model.totals[1]) if self._external is None else self._external[0]

    @cached_property
    def _outputs(self) -> Index:
        return np.arange(self.model.totals[2]) if self._external is None else self._external[1]

    # -- what StateSpace stores, made on demand

    @cached_property
    def nstates(self) -> int:  # type: ignore[override]
        """Number of states."""
        return self.model.totals[0]

    @cached_property
    def ninputs(self) -> int:  # type: ignore[override]
        """Number of external inputs."""
        return len(self._inputs)

    @cached_property
    def noutputs(self) -> int:  # type: ignore[override]
        """Number of outputs."""
        return len(self._outputs)

    @property
    def A(self) -> NDArray[np.float64]:  # type: ignore[override]
        """Dense closed-loop matrix, shape (nstates, nstates)."""
        return self._dense("A")

    @property
    def B(self) -> NDArray[np.float64]:  # type: ignore[override]
        """Dense input matrix, shape (nstates, ninputs)."""
        return self._dense("B")

    @property
    def C(self) -> NDArray[np.float64]:  # type: ignore[override]
        """Dense output matrix, shape (noutputs, nstates)."""
        return self._dense("C")

    @property
    def D(self) -> NDArray[np.float64]:  # type: ignore[override]
        """Dense feedthrough, shape (noutputs, ninputs)."""
        return self._dense("D")

    def _dense(self, name: str) -> NDArray[np.float64]:
        if self.nstates > DENSE_STATES:
            raise TooLargeError(
                f"a dense {name} of this network with {self.nstates} states is refused (limit {DENSE_STATES}); use "
                f"sparse_{name}, poles(k), spectral_abscissa(), initial_response() or forced_response(), which stay sparse."
            )
        return getattr(self, f"sparse_{name}").toarray()

    @property
    def sparse_A(self) -> sp.csr_array:
        """Closed-loop matrix, shape (nstates, nstates)."""
        return self.loop.A

    @cached_property
    def sparse_B(self) -> sp.csr_array:
        """Input matrix, shape (nstates, ninputs)."""
        return sp.csr_array(self.loop.B[:, self._inputs])

    @cached_property
    def sparse_C(self) -> sp.csr_array:
        """Output matrix, shape (noutputs, nstates)."""
        return sp.csr_array(self.loop.C[self._outputs])

    @cached_property
    def sparse_D(self) -> sp.csr_array:
        """Feedthrough, shape (noutputs, ninputs)."""
        return sp.csr_array(self.loop.D[self._outputs][:, self._inputs])

    def updfcn(self, t: float, x: Any, u: Any, params: Any) -> Any:
        """x' (or x[k+1]) for python-control's nonlinear simulations."""
        return self.sparse_A @ np.atleast_1d(x) + self.sparse_B @ np.atleast_1d(u)

    def outfcn(self, t: float, x: Any, u: Any, params: Any) -> Any:
        """y for python-control's nonlinear simulations."""
        return self.sparse_C @ np.atleast_1d(x) + self.sparse_D @ np.atleast_1d(u)

    # -- names

    @cached_property
    def input_index(self) -> dict[str, int]:  # type: ignore[override]
        """Names of the external inputs and their places."""
        return self._index(1, self._inputs, "u")

    @cached_property
    def output_index(self) -> dict[str, int]:  # type: ignore[override]
        """Names of the outputs and their places."""
        return self._index(2, self._outputs, "y")

    @cached_property
    def state_index(self) -> dict[str, int]:  # type: ignore[override]
        """Names of the states and their places."""
        return self._index(0, None, "x")

    def _index(self, kind: int, chosen: Index | None, prefix: str) -> dict[str, int]:
        if self.model.n_nodes > READABLE:
            count = self.model.totals[kind] if chosen is None else len(chosen)
            return {f"{prefix}[{i}]": i for i in range(count)}
        names = self.model.signal_names(kind)
        kept = names if chosen is None else [names[i] for i in chosen]
        return {name: i for i, name in enumerate(kept)}

    # -- cones and verdicts

    @cached_property
    def X(self) -> Cone:
        """State cone: the product of the nodes' state cones, in their order."""
        cones: list[Any] = [None] * self.model.n_nodes
        for s, index in zip(self.model.stacks, self.model.members, strict=True):
            for j in index.tolist():
                cones[j] = s.X
        return product(cones)

    @cached_property
    def certificate(self) -> NetworkCertificate | LocalCertificate:
        """Theorem 4 for this network: PROVED, or REFUTED with what breaks it."""
        with Reporter(self._progress) as report:
            if self._find is certify:
                return certify(self.model, report)
            return self._find(self.model)

    def is_cone_positive(self) -> bool:
        """Decide whether every node is positive, W maps Y into U, and algebraic loops contract.

        Returns
        -------
        bool
            True if the closed loop is then positive on the product of the X_j by Theorem 4.

        Raises
        ------
        UndecidedError
            The certificate is UNDECIDED.
        """
        certificate = self.certificate
        if certificate.status is Status.UNDECIDED:
            raise UndecidedError(f"{self.name}: {certificate.explain()}")
        return certificate.status is Status.PROVED or type(certificate.witness).__name__ == "NetworkInstability"

    def abscissa_certificate(self, relative: float = 1e-6) -> AbscissaCertificate:
        """Proof of both sides of a bracket of the spectral abscissa; see `spectral_abscissa`.

        Parameters
        ----------
        relative : float
            Width of the bracket sought, relative to the abscissa.

        Returns
        -------
        AbscissaCertificate
        """
        with Reporter(self._progress) as report:
            return bracket(self.model, relative, report)

    def spectral_abscissa(self, relative: float = 1e-6) -> tuple[float, float]:
        """Bracket of the largest real part of the poles, both sides proven.

        Parameters
        ----------
        relative : float
            Width sought, relative to the abscissa.

        Returns
        -------
        lower, upper : float
            In discrete time of the spectral radius, which is the rightmost pole of a positive network.

        Raises
        ------
        UndecidedError
            A side could not be proven; in particular if the network is not positive.

        Notes
        -----
        Some ten pairs of solves with shifts that fall towards the abscissa; see `abscissa`.
        """
        certificate = self.abscissa_certificate(relative)
        if not certificate:
            raise UndecidedError(f"{self.name}: {certificate.explain()}")
        return certificate.lower, certificate.upper

    def poles(self, k: int | None = None) -> NDArray[np.complex128]:
        """Poles: all of a network of moderate size, or the k rightmost ones.

        Parameters
        ----------
        k : int, optional
            How many; all if not given, which needs a dense matrix.

        Returns
        -------
        ndarray of complex, sorted by falling real part if k is given

        Raises
        ------
        TooLargeError
            All poles of a network with more than `DENSE_STATES` states.

        Notes
        -----
        With k: ARPACK on the closed loop, shifted to the proven upper end of the abscissa; the eigenvalues
        next to it are found, to about 1e-8, not proven.
        """
        if k is None:
            return np.linalg.eigvals(self.A).astype(complex) if self.nstates else np.zeros(0, dtype=complex)
        if not 0 < k <= self.nstates:
            raise ShapeError(f"k is {k}; it must be between 1 and the number of states, {self.nstates}.")
        if self.nstates <= max(400, 2 * k + 2):
            values = np.linalg.eigvals(self.sparse_A.toarray()).astype(complex)
        else:
            values = rightmost(self, k)
        order = np.lexsort((np.abs(values.imag), -values.real))
        return values[order][:k]

    # -- responses

    def initial_response(
        self,
        T: ArrayLike | float,
        X0: ArrayLike,
        *,
        outputs: Sequence[int | str] | None = None,
        states: bool | None = None,
    ) -> TimeResponseData:
        """Response to an initial state.

        Parameters
        ----------
        T : array_like or float
            Evenly spaced sample times, or the final time (200 samples).
        X0 : array_like, shape (nstates,), (N, n) for nodes of one size, or a number
        outputs : sequence of int or str, optional
            Outputs to keep, by place or name; all if not given.
        states : bool, optional
            Keep the states too.  Default: if they are fewer than 2 10^7 numbers.

        Returns
        -------
        control.TimeResponseData

        Notes
        -----
        Error below 1e-10 of the largest state.  About T |A| * 5 products with the sparse A.
        """
        return self.forced_response(T, None, X0, outputs=outputs, states=states)

    def forced_response(
        self,
        T: ArrayLike | float,
        U: ArrayLike | None = None,
        X0: ArrayLike = 0.0,
        *,
        outputs: Sequence[int | str] | None = None,
        states: bool | None = None,
    ) -> TimeResponseData:
        """Response to external inputs, linear between samples, and an initial state.

        Parameters
        ----------
        T : array_like or float
            Evenly spaced sample times, or the final time (200 samples).
        U : array_like, shape (ninputs, len(T)) or (len(T),) for a single input, optional
        X0 : array_like, shape (nstates,), (N, n) for nodes of one size, or a number
        outputs, states
            See `initial_response`.

        Returns
        -------
        control.TimeResponseData
        """
        times = sample_times(T, self.dt)
        x0 = self._initial_state(X0)
        rows = self._chosen_outputs(outputs)
        keep = self.nstates * len(times) <= 20_000_000 if states is None else bool(states)
        if (len(rows) + keep * self.nstates) * len(times) > RESPONSE_LIMIT:
            raise TooLargeError(
                f"a response of {len(rows)} outputs{' and all states' if keep else ''} at {len(times)} times is refused "
                f"(limit {RESPONSE_LIMIT} numbers); choose outputs=, states=False or fewer times."
            )
        samples = self._input_samples(U, len(times))
        inputs = None if samples is None else (self.sparse_B, samples)
        with Reporter(self._progress) as report:
            y, x = respond(self.loop, times, x0, inputs, self._outputs[rows], keep, report)
        if samples is not None and self.model.has_feedthrough:
            y = y + self.sparse_D[rows] @ samples
        return self._response(times, y, x, samples, rows)

    def delayed_response(
        self,
        T: ArrayLike | float,
        X0: ArrayLike,
        delays: ArrayLike | Any,
        *,
        outputs: Sequence[int | str] | None = None,
        refine: int = 8,
    ) -> TimeResponseData:
        """Response to an initial state when the links pass outputs on late: u_j(t) = sum W_jk y_k(t - tau_jk).

        Parameters
        ----------
        T : array_like or float
            Evenly spaced sample times, or the final time (200 samples).
        X0 : array_like, shape (nstates,), (N, n) or a number
            Before t = 0 the outputs are those at t = 0.
        delays : float or matrix like the coupling
            tau_jk >= 0, one for all links or one per link; zeros mean no delay.
        outputs : sequence of int or str, optional
        refine : int
            Steps per sample; the error falls with its square.

        Returns
        -------
        control.TimeResponseData
        """
        if self.model.discrete:
            raise DataError("delays are simulated in continuous time; in discrete time add delay states to the nodes.")
        times = sample_times(T, self.dt)
        rows = self._chosen_outputs(outputs)
        coo = sp.coo_array(self.model.W)
        if np.ndim(delays) == 0 and not sp.issparse(delays):
            tau = np.full(coo.nnz, float(vector([delays], "delays")[0]))
        else:
            table = delays if sp.issparse(delays) else exact_matrix(delays, "delays").values
            if table.shape != coo.shape:
                raise ShapeError(
                    f"delays is {table.shape[0]} x {table.shape[1]}; it must be a number or {coo.shape[0]} x {coo.shape[1]} like the coupling."
                )
            tau = np.asarray(sp.csr_array(table)[coo.coords[0], coo.coords[1]], dtype=float).ravel()
        if not (tau >= 0).all() or not np.isfinite(tau).all():
            raise DataError("delays must be finite and not negative.")
        with Reporter(self._progress) as report:
            y = delayed(
                self.model, times, self._initial_state(X0), tau, max(1, int(refine)), self._outputs[rows], report
            )
        return self._response(times, y, None, None, rows)

    def _initial_state(self, X0: ArrayLike) -> Floats:
        if np.ndim(X0) == 0:
            return np.full(self.nstates, float(vector([X0], "X0")[0]))
        values = np.asarray(exact_matrix(np.ravel(np.asarray(X0)), "X0", ndim=1).values)
        return vector(values, "X0", self.nstates)

    def _input_samples(self, U: ArrayLike | None, count: int) -> Floats | None:
        if U is None:
            return None
        samples = np.asarray(exact_matrix(U, "U").values)
        if np.ndim(U) == 0:
            samples = np.full((self.ninputs, count), float(samples[0, 0]))
        if samples.shape != (self.ninputs, count):
            raise ShapeError(
                f"U is {samples.shape[0]} x {samples.shape[1]}; it must be {self.ninputs} x {count}: inputs by sample times."
            )
        return samples if np.any(samples) else None

    def _chosen_outputs(self, outputs: Sequence[int | str] | int | str | None) -> Index:
        if outputs is None:
            return np.arange(self.noutputs)
        chosen = [outputs] if isinstance(outputs, (str, int, np.integer)) else list(outputs)
        places = []
        for item in chosen:
            place = self.output_index.get(item) if isinstance(item, str) else int(item)
            if place is None or not -self.noutputs <= place < self.noutputs:
                raise ShapeError(f"outputs names {item!r}, which is none of the {self.noutputs} outputs.")
            places.append(place % self.noutputs)
        return np.array(places, dtype=np.intp)

    def _response(self, times: Floats, y: Floats, x: Floats | None, u: Floats | None, rows: Index) -> TimeResponseData:
        named = self.model.n_nodes <= READABLE
        labels = list(self.output_index) if named else None
        return TimeResponseData(
            times,
            y,
            x,
            u,
            issiso=False,
            output_labels=[labels[i] if labels else f"y[{i}]" for i in rows.tolist()],
            state_labels=list(self.state_index) if named and x is not None else None,
            input_labels=list(self.input_index) if named and u is not None else None,
            sysname=self.name,
            plot_inputs=False,
        )

    # -- variations

    def with_links(self, coupling: Any) -> ConeNetwork:
        """The same nodes under other links; inherits the certificate where it covers them.

        Parameters
        ----------
        coupling : as for `feedback_interconnect`

        Returns
        -------
        ConeNetwork
            Its certificate holds the same v, r, q and is proven for the new links without a solve if what
            is left of every link and what is taken away both map Y into U, or if (III') still holds.
            Otherwise it is found anew when first asked for.
        """
        model = self.model.with_coupling(read_coupling(coupling, self.model))
        return ConeNetwork(
            model,
            external=self._external,
            certificate=inherit(getattr(self.certificate, "whole", self.certificate), model),
            progress=self._progress,
        )

    def with_node(
        self,
        system: ConeStateSpace | NodeStack,
        *,
        incoming: Mapping[int, Any] | None = None,
        outgoing: Mapping[int, Any] | None = None,
    ) -> ConeNetwork:
        """The network with one more node, which gets the last number.

        Parameters
        ----------
        system : ConeStateSpace
        incoming : dict of int to float or array_like, optional
            Weights (blocks) of links into the new node, by the number of the node they come from.
        outgoing : dict of int to float or array_like, optional
            Weights (blocks) of links out of the new node, by the number of the node they lead to.

        Returns
        -------
        ConeNetwork
            With all external signals.  If this network is certified and its certificate leaves room, the
            new one is proven by looking at the new node and its neighbours only, whatever the size of the
            network; otherwise its certificate is found anew when first asked for.
        """
        overlay = self._changes()
        stack = self._single(system)
        return self._changed(overlay.place(overlay.count, stack, *self._identified(overlay, incoming, outgoing)))

    def replace_node(
        self,
        node: int,
        system: ConeStateSpace | NodeStack,
        *,
        incoming: Mapping[int, Any] | None = None,
        outgoing: Mapping[int, Any] | None = None,
    ) -> ConeNetwork:
        """The network with another system as one of its nodes.

        Parameters
        ----------
        node : int
        system : ConeStateSpace
        incoming, outgoing : dict, optional
            New links, see `with_node`; the old ones stay if not given.

        Returns
        -------
        ConeNetwork
            Certified like that of `with_node`.
        """
        overlay = self._changes()
        identity = overlay.identity(node)
        into, out_of = self._identified(overlay, incoming, outgoing)
        into = overlay.links(identity, True) if incoming is None else into
        out_of = overlay.links(identity, False) if outgoing is None else out_of
        return self._changed(overlay.place(identity, self._single(system), into, out_of))

    def without_node(self, node: int) -> ConeNetwork:
        """The network without a node and its links; later nodes move up.

        Parameters
        ----------
        node : int

        Returns
        -------
        ConeNetwork
            Certified if this one is, without looking at more than the neighbours.
        """
        overlay = self._changes()
        if overlay.n_nodes == 1:
            raise ShapeError("the only node of a network cannot be removed.")
        return self._changed(overlay.remove(overlay.identity(node)))

    def room_for(self, system: ConeStateSpace, sources: Sequence[int], targets: Sequence[int]) -> float:
        """Which links of a new node stay certified: the largest product of the weights in and out.

        Parameters
        ----------
        system : ConeStateSpace
            A node with one input and one output.
        sources, targets : sequence of int
            Nodes with one output (input) that the new node listens to (feeds), each with one weight.

        Returns
        -------
        float
            Every pair of link weights a (from each source) and b (to each target) with a * b below this
            number is covered by the certificate: the new node then needs no solve.  inf without a loop
            through the network, 0 if the certificate does not hold.
        """
        overlay = self._changes()
        return overlay.room_for(
            self._single(system), [overlay.identity(k) for k in sources], [overlay.identity(j) for j in targets]
        )

    def _changes(self) -> Overlay:
        certificate = self.certificate
        return certificate.overlay if isinstance(certificate, LocalCertificate) else Overlay.of(certificate)

    def _single(self, system: ConeStateSpace | NodeStack) -> NodeStack:
        stacks, _, _ = gather(system)
        if len(stacks) != 1 or len(stacks[0]) != 1:
            raise ShapeError("give one node; add several one after the other.")
        check_timebase(stacks[0], self.dt)
        return stacks[0]

    @staticmethod
    def _identified(overlay: Overlay, *links: Mapping[int, Any] | None) -> list[dict[int, Any]]:
        return [{overlay.identity(int(k)): w for k, w in (link or {}).items()} for link in links]

    def _changed(self, overlay: Overlay) -> ConeNetwork:
        if overlay.covered:
            certificate = LocalCertificate(overlay=overlay, status=Status.PROVED)
            return ConeNetwork(overlay=overlay, certificate=certificate, progress=self._progress)
        return ConeNetwork(overlay.build(), progress=self._progress)

    def copy(self, name: str | None = None, use_prefix_suffix: bool = True) -> ConeNetwork:
        """A network that shares the immutable data.

        Parameters
        ----------
        name : str, optional
        use_prefix_suffix : bool
            As in python-control.
        """
        out = ConeNetwork(self.model, external=self._external, find=self._find, progress=self._progress)
        if "certificate" in self.__dict__:
            out.__dict__["certificate"] = self.certificate
        out.name = self._name_or_default(
            self.name if name is None and use_prefix_suffix else name,
            prefix_suffix_name="duplicate" if name is None and use_prefix_suffix else None,
        )
        return out

    def __repr__(self) -> str:
        return (
            f"<ConeNetwork {self.name}: {self.model.n_nodes} nodes, {self.nstates} states, {self.model.W.nnz} links, "
            f"{self.ninputs} inputs, {self.noutputs} outputs>"
        )

    def __str__(self) -> str:
        return StateSpace.__str__(self) if self.nstates <= 50 else repr(self)

    def _repr_eval_(self) -> str:
        return repr(self)

    def _repr_html_(self) -> str | None:
        certificate = self.__dict__.get("certificate")  # not worth a long computation
        rows = [
            ("nodes", str(self.model.n_nodes)),
            ("states, inputs, outputs", f"{self.nstates}, {self.ninputs}, {self.noutputs}"),
            ("links", str(self.model.W.nnz)),
        ]
        if certificate is None:
            return card(f"Network {self.name}", rows, text="Ask for its certificate: .certificate")
        return card(f"Network {self.name}", rows, status=certificate.status.name, text=certificate.explain())


def rightmost(network: ConeNetwork, k: int) -> NDArray[np.complex128]:
    """k rightmost eigenvalues by ARPACK with the port solver as shifted inverse."""
    model = network.model
    estimate = descend(model, 1.0 if model.discrete else 0.0, relative=1e-2)
    if estimate is None:
        return spla.eigs(network.sparse_A, k=k, which="LR", return_eigenvectors=False)
    system = PortSystem(model, estimate.shift)
    n = network.nstates
    inverse = spla.LinearOperator((n, n), matvec=lambda z: -system.primal(np.ravel(z), 1e-11)[0], dtype=float)
    return spla.eigs(network.sparse_A, k=k, sigma=estimate.shift, OPinv=inverse, which="LM", return_eigenvectors=False)


class Reporter:
    """Lines about long work: to a callable, or to a terminal or notebook once it has taken two seconds."""

    def __init__(self, target: Callable[[str], None] | bool | None) -> None:
        self._target, self._begun, self._shown = target, time.monotonic(), False

    def __enter__(self) -> Callable[[str], None]:
        return self._say

    def _say(self, line: str) -> None:
        if callable(self._target):
            self._target(line)
        elif self._target is not False and (self._target or _is_watched()) and time.monotonic() - self._begun > 2:
            print(f"\r{line:<78}", end="", file=sys.stderr, flush=True)
            self._shown = True

    def __exit__(self, *_: object) -> None:
        if self._shown:
            print(file=sys.stderr)


def _is_watched() -> bool:
    """True if standard error is a terminal or a cell of a notebook, where a line can be overwritten."""
    return sys.stderr.isatty() or type(sys.stderr).__module__.startswith("ipykernel")
