"""Poles and time responses of a network, without dense matrices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import ArrayLike, NDArray

from ..errors import DataError, ShapeError, TooLargeError, UndecidedError
from ..exact.budget import require_time
from ..exact.intake import (
    dimensions,
    exact_matrix,
    flag,
    places,
    real_number,
    vector,
    whole_number,
)
from ..exact.matrix import dense
from ..progress import Reporter
from ..proof.in_time import in_time
from .blocks import Floats, Index, converging
from .certify import positive_form
from .dense_on_demand import DenseOnDemand
from .model import READABLE
from .response_data import NetworkResponse
from .simulate import delayed, respond, sample_times, step_all
from .spectrum.descent import descend
from .spectrum.port_solves import PortSystem

# Numbers a response may hold before it has to be narrowed down.
RESPONSE_LIMIT = 200_000_000
# Steps per sample.
_FINEST = 10_000


class NetworkResponses(DenseOnDemand):
    """Poles and time responses; see `ConeNetwork`."""

    time_limit: float | None = None

    def poles(self, k: int | None = None, *, time_limit: float | None = None) -> NDArray[np.complex128]:
        """Poles: all of a network of moderate size, or the k rightmost ones.

        Parameters
        ----------
        k : int, optional
            How many; all if not given, which needs a dense matrix.
        time_limit : float, optional
            Seconds.  Default: that of the network.

        Returns
        -------
        ndarray of complex, sorted by falling real part if k is given

        Raises
        ------
        TooLargeError
            All poles of a network with more than `DENSE_STATES` states.
        UndecidedError
            LAPACK or ARPACK does not converge, or the time limit ended the search.

        Notes
        -----
        With k: ARPACK on the closed loop, shifted to the proven upper end of the abscissa; the eigenvalues
        next to it are found, to about 1e-8, not proven.
        """
        if k is not None:
            k = whole_number(k, "k", least=1, most=self.nstates, outside=ShapeError)
        limit = self.time_limit if time_limit is None else time_limit
        found = in_time(limit, lambda: self._poles(k), lambda: None)
        if found is None:
            raise UndecidedError(f"{self.name}: the time limit ended the search for the poles; more may help.")
        return found

    def _poles(self, k: int | None) -> NDArray[np.complex128]:
        with converging("the poles"):
            if k is None or self.nstates <= max(400, 2 * k + 2):
                require_time(float(self.nstates) ** 3)
            if k is None:
                return np.linalg.eigvals(self.A).astype(complex)
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
    ) -> NetworkResponse:
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
        NetworkResponse
            A `control.TimeResponseData`.

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
    ) -> NetworkResponse:
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
        NetworkResponse
            A `control.TimeResponseData`.
        """
        times = sample_times(T, self.dt)
        x0 = self._initial_state(X0)
        rows = self._chosen_outputs(outputs)
        keep = self.nstates * len(times) <= 20_000_000 if states is None else flag(states, "states")
        self._require_room(len(rows) + keep * self.nstates, len(rows), keep, len(times))
        samples = self._input_samples(U, len(times))
        inputs = None if samples is None else (self.sparse_B, samples)
        with Reporter(self._progress) as report, np.errstate(all="ignore"):
            y, x = respond(self.loop, times, x0, inputs, self.external[1][rows], keep, report)
        if samples is not None and self.model.has_feedthrough:
            y = y + self.sparse_D[rows] @ samples
        _require_finite(y)
        return self._response(times, y, x, samples, rows)

    def step_response(
        self,
        T: ArrayLike | float | None = None,
        X0: ArrayLike = 0.0,
        *,
        inputs: Sequence[int | str] | None = None,
        outputs: Sequence[int | str] | None = None,
        states: bool | None = None,
    ) -> NetworkResponse:
        """Responses to unit steps of the external inputs, one at a time, all simulated together.

        Parameters
        ----------
        T : array_like or float, optional
            Evenly spaced sample times, or the final time (200 samples).  Default: seven time constants of the slowest
            pole.
        X0 : array_like, shape (nstates,), (N, n) for nodes of one size, or a number
        inputs, outputs : sequence of int or str, optional
            Inputs that step and outputs to keep, by place or name; all if not given.
        states : bool, optional
            Keep the states too.  Default: if they are fewer than 2 10^7 numbers.

        Returns
        -------
        NetworkResponse
            A `control.TimeResponseData` with outputs of shape (outputs, inputs, times).

        Raises
        ------
        DataError
            No T for a network without a slowest time constant: unstable, or at the margin.
        TooLargeError
            More than 2 10^8 numbers.

        Notes
        -----
        `control.step_response` computes a dense matrix exponential for every input, and takes any network up to
        `DENSE_STATES` states as it takes other systems: 50 inputs take 50 times longer.

        Examples
        --------
        >>> import control_kpos as kp
        >>> node = kp.ConeStateSpace([[-2]], [[1]], [[1]], 0)
        >>> net = kp.feedback_interconnect([node] * 2, [[0, 1], [1, 0]])
        >>> net.step_response(10.0).outputs[:, :, -1].round(3)
        array([[0.667, 0.333],
               [0.333, 0.667]])
        """
        times = sample_times(self._settled() if T is None else T, self.dt)
        x0, rows = self._initial_state(X0), self._chosen_outputs(outputs)
        columns = self._chosen(inputs, "inputs", self.input_index)
        keep = self.nstates * len(columns) * len(times) <= 20_000_000 if states is None else flag(states, "states")
        self._require_room((len(rows) + keep * self.nstates) * len(columns), len(rows), keep, len(times))
        B = self.sparse_B[:, columns].toarray()
        with Reporter(self._progress) as report, np.errstate(all="ignore"):
            y, x = step_all(self.loop, times, x0, B, self.external[1][rows], keep, report)
        if self.model.has_feedthrough:
            y = y + self.sparse_D[rows][:, columns].toarray()[:, :, None]
        _require_finite(y)
        steps = np.zeros((self.ninputs, len(columns), len(times)))
        steps[columns, np.arange(len(columns))] = 1.0
        return self._response(times, y, x, steps, rows, columns)

    def _settled(self) -> float:
        """Seven time constants of the slowest pole."""
        pole = complex(self.poles(1)[0])
        rate = 1 - abs(pole) if self.model.discrete else -pole.real
        step = float(self.dt or 1.0)
        if not rate > 1e-9:
            raise DataError("the network does not settle in a reasonable time; give T, the times or the final time.")
        return 7 * step / rate

    def delayed_response(
        self,
        T: ArrayLike | float,
        X0: ArrayLike,
        delays: ArrayLike | Any,
        *,
        outputs: Sequence[int | str] | None = None,
        refine: int = 8,
    ) -> NetworkResponse:
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
        NetworkResponse
            A `control.TimeResponseData`.
        """
        if self.model.discrete:
            raise DataError("delays are simulated in continuous time; in discrete time add delay states to the nodes.")
        times = sample_times(T, self.dt)
        rows = self._chosen_outputs(outputs)
        coo = sp.coo_array(self.model.W)
        refine = whole_number(refine, "refine", least=1, most=_FINEST)
        if dimensions(delays) == 0:
            tau = np.full(coo.nnz, real_number(delays, "delays"))
        else:
            table: Any = exact_matrix(delays, "delays").values
            if table.shape != coo.shape:
                raise ShapeError(
                    f"delays is {table.shape[0]} x {table.shape[1]}; it must be a number or {coo.shape[0]} x "
                    f"{coo.shape[1]} like the coupling."
                )
            tau = np.asarray(sp.csr_array(table)[coo.coords[0], coo.coords[1]], dtype=float).ravel()
        if not (tau >= 0).all() or not np.isfinite(tau).all():
            raise DataError("delays must be finite and not negative.")
        with Reporter(self._progress) as report, np.errstate(all="ignore"):
            y = delayed(self.model, times, self._initial_state(X0), tau, refine, self.external[1][rows], report)
        _require_finite(y)
        return self._response(times, y, None, None, rows)

    def _require_room(self, height: int, outputs: int, keep: bool, count: int) -> None:
        """Refuse a response of too many numbers."""
        if height * count > RESPONSE_LIMIT:
            raise TooLargeError(
                f"a response of {outputs} outputs{' and all states' if keep else ''} at {count} times is refused "
                f"(limit {RESPONSE_LIMIT} numbers); choose outputs=, states=False or fewer times."
            )

    def _initial_state(self, X0: ArrayLike) -> Floats:
        if dimensions(X0) == 0:
            return np.full(self.nstates, real_number(X0, "X0"))
        return vector(dense(exact_matrix(X0, "X0").values).ravel(), "X0", self.nstates)

    def _input_samples(self, U: ArrayLike | None, count: int) -> Floats | None:
        if U is None:
            return None
        samples = dense(exact_matrix(U, "U").values)
        if dimensions(U) == 0:
            samples = np.full((self.ninputs, count), float(samples[0, 0]))
        if samples.shape != (self.ninputs, count):
            raise ShapeError(
                f"U is {samples.shape[0]} x {samples.shape[1]}; it must be {self.ninputs} x {count}: inputs by "
                "sample times."
            )
        return samples if np.any(samples) else None

    def _chosen_outputs(self, outputs: Sequence[int | str] | int | str | None) -> Index:
        return self._chosen(outputs, "outputs", self.output_index)

    def _chosen(self, given: Any, name: str, labels: Mapping[str, int]) -> Index:
        """Places of outputs or inputs by place or name."""
        count = self.noutputs if name == "outputs" else self.ninputs
        if given is None:
            return np.arange(count)
        chosen = []
        for item in places(given, name):
            place = labels.get(item) if isinstance(item, str) else item
            if place is None or not -count <= place < count:
                raise ShapeError(f"{name} names {item!r}, which is none of the {count} {name}.")
            chosen.append(place % count)
        return np.array(chosen, dtype=np.intp)

    def _response(
        self,
        times: Floats,
        y: Floats,
        x: Floats | None,
        u: Floats | None,
        rows: Index,
        columns: Index | None = None,
    ) -> NetworkResponse:
        """The response; of steps of the inputs in some columns."""
        named = self.model.n_nodes <= READABLE
        labels = list(self.output_index) if named else None
        steps = {}
        if columns is not None:
            sources = list(self.input_index) if named else None
            traces = [f"From {sources[k] if sources else f'u[{k}]'}" for k in columns.tolist()]
            steps = {
                "trace_labels": traces,
                "trace_types": ["step"] * len(traces),
                "title": f"Step response for {self.name}",
            }
        return NetworkResponse(
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
            **steps,
        )


def _require_finite(y: Floats) -> None:
    if not np.isfinite(y).all():
        raise DataError("the response leaves the range of doubles; choose a shorter T, or smaller X0 and U.")


def rightmost(network: DenseOnDemand, k: int) -> NDArray[np.complex128]:
    """k rightmost eigenvalues by ARPACK with the port solver as shifted inverse."""
    model = network.model
    model = positive_form(model) or model
    estimate = descend(model, 1.0 if model.discrete else 0.0, relative=1e-2)
    if estimate is None:
        return spla.eigs(network.sparse_A, k=k, which="LR", return_eigenvectors=False)
    system = PortSystem(model, estimate.shift)
    n = network.nstates
    inverse = spla.LinearOperator((n, n), matvec=lambda z: -system.primal(np.ravel(z), 1e-11)[0], dtype=float)
    return spla.eigs(network.sparse_A, k=k, sigma=estimate.shift, OPinv=inverse, which="LM", return_eigenvectors=False)
