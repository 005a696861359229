"""A network as the StateSpace python-control expects, with dense matrices only on demand."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from control import StateSpace
from numpy.typing import NDArray

from ..cones import Cone, product
from ..errors import TooLargeError
from ..exact.intake import words
from ..progress import Reporter, Target
from .blocks import Index
from .closed_loop import ClosedLoop
from .model import READABLE, NetworkModel

# States above which dense matrices are refused (200 MB for A).
DENSE_STATES = 5_000


class NetworkShell(StateSpace):
    """What `control.StateSpace` stores, made from stacks and sparse matrices when first asked for.

    Parameters
    ----------
    model : NetworkModel
    external : tuple of two ndarrays of int, optional
        External inputs and outputs kept; all if not given.
    name : str, optional
    progress : callable or bool, optional
    """

    def __init__(
        self,
        model: NetworkModel,
        *,
        external: tuple[Index, Index] | None = None,
        name: str | None = None,
        progress: Target = None,
    ) -> None:
        # StateSpace.__init__ would ask for dense matrices; set up what the classes above it need.
        self.name = self._name_or_default(words(name, "name"))
        self.model = model
        self.loop = ClosedLoop(model)  # refuses networks that are not well posed
        self._external = external
        self.dt = model.dt
        self._repr_format = None
        self.params: dict[str, Any] = {}
        self._current_params: dict[str, Any] = {}
        Reporter(progress)  # refuses what is no target
        self._progress = progress

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
                f"sparse_{name}, poles(k), spectral_abscissa(), initial_response() or forced_response(), which "
                "stay sparse."
            )
        return getattr(self, f"sparse_{name}").toarray()

    def horner(self, x: Any, warn_infinite: bool = True) -> NDArray[np.complex128]:
        """Frequency response C (x I - A)^{-1} B + D; python-control's own method, refused before it fills the memory.

        Parameters
        ----------
        x : complex or array_like of complex
            Points s or z.
        warn_infinite : bool
            Warn if x is a pole.

        Returns
        -------
        ndarray of complex, shape (noutputs, ninputs, number of points)

        Raises
        ------
        TooLargeError
            More than `DENSE_STATES` states.
        """
        if self.nstates > DENSE_STATES:
            raise TooLargeError(
                f"the frequency response of this network with {self.nstates} states would take dense matrices (limit "
                f"{DENSE_STATES}); use forced_response() with a few outputs, or solve with x I - sparse_A."
            )
        return super().horner(x, warn_infinite)

    def _generic_name_check(self) -> bool:
        # python-control asks this before it converts a system, and then makes a list for each pair of an input and an
        # output before it looks at A
        if self.nstates > DENSE_STATES and self.ninputs * self.noutputs > DENSE_STATES**2:
            raise TooLargeError(
                f"{self.ninputs} x {self.noutputs} transfer functions of this network with {self.nstates} states are "
                "refused; select inputs= and outputs=, or use forced_response()."
            )
        return super()._generic_name_check()

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

    @cached_property
    def X(self) -> Cone:
        """State cone: the product of the nodes' state cones, in their order."""
        cones: list[Any] = [None] * self.model.n_nodes
        for s, index in zip(self.model.stacks, self.model.members, strict=True):
            for j in index.tolist():
                cones[j] = s.X
        return product(cones)
