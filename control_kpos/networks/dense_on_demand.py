"""A network as the StateSpace that python-control expects, with dense matrices only on demand."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import TooLargeError
from ..exact.intake import words
from ..exact.rows import frozen
from ..progress import Reporter, Target
from ..systems.statespace import ConeStateSpace
from .blocks import Index, read_only, shared_view
from .closed_loop import ClosedLoop
from .model import READABLE, NetworkModel

# States above which dense matrices are refused (200 MB for A).
DENSE_STATES = 5_000


class DenseOnDemand(ConeStateSpace):
    """A network as a `ConeStateSpace` that makes its dense matrices from sparse ones when asked; see `ConeNetwork`."""

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
    def external(self) -> tuple[Index, Index]:
        """Places of the external inputs and outputs among all of them."""
        if self._external is None:
            return frozen(np.arange(self.model.totals[1])), frozen(np.arange(self.model.totals[2]))
        return frozen(np.array(self._external[0])), frozen(np.array(self._external[1]))

    # -- copies

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        out: Any = type(self).__new__(type(self))
        memo[id(self)] = out
        vars(out).update(
            {k: dict(x) if isinstance(x, dict) else x for k, x in vars(self).items()}
        )  # the rest is immutable
        return out

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self.__dict__.update(state)

    # -- what StateSpace stores, made on demand

    @cached_property
    def nstates(self) -> int:  # type: ignore[override]
        """Number of states."""
        return self.model.totals[0]

    @cached_property
    def ninputs(self) -> int:  # type: ignore[override]
        """Number of external inputs."""
        return len(self.external[0])

    @cached_property
    def noutputs(self) -> int:  # type: ignore[override]
        """Number of outputs."""
        return len(self.external[1])

    @property
    def A(self) -> NDArray[np.float64]:  # type: ignore[override]
        """Dense closed-loop matrix, read-only, shape (nstates, nstates)."""
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
        out = getattr(self, f"sparse_{name}").toarray()
        out.flags.writeable = False  # an edit would be lost
        return out

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
        """Closed-loop matrix, read-only, shape (nstates, nstates)."""
        return shared_view(self.loop.A)

    @property
    def sparse_B(self) -> sp.csr_array:
        """Input matrix, read-only, shape (nstates, ninputs)."""
        return shared_view(self._sparse_ports[0])

    @property
    def sparse_C(self) -> sp.csr_array:
        """Output matrix, read-only, shape (noutputs, nstates)."""
        return shared_view(self._sparse_ports[1])

    @property
    def sparse_D(self) -> sp.csr_array:
        """Feedthrough, read-only, shape (noutputs, ninputs)."""
        return shared_view(self._sparse_ports[2])

    @cached_property
    def _sparse_ports(self) -> tuple[sp.csr_array, sp.csr_array, sp.csr_array]:
        loop, (inputs, outputs) = self.loop, self.external
        if self._external is None:
            return loop.B, loop.C, loop.D
        chosen = loop.B[:, inputs], loop.C[outputs], loop.D[outputs][:, inputs]
        b, c, d = (read_only(sp.csr_array(part)) for part in chosen)
        return b, c, d

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
        return self._index(1, "u")

    @cached_property
    def output_index(self) -> dict[str, int]:  # type: ignore[override]
        """Names of the outputs and their places."""
        return self._index(2, "y")

    @cached_property
    def state_index(self) -> dict[str, int]:  # type: ignore[override]
        """Names of the states and their places."""
        return self._index(0, "x")

    def _index(self, kind: int, prefix: str) -> dict[str, int]:
        chosen = None if kind == 0 or self._external is None else self._external[kind - 1]
        if self.model.n_nodes > READABLE:
            count = self.model.totals[kind] if chosen is None else len(chosen)
            return {f"{prefix}[{i}]": i for i in range(count)}
        names = self.model.signal_names(kind)
        kept = names if chosen is None else [names[i] for i in chosen]
        return {name: i for i, name in enumerate(kept)}
