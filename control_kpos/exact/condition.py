"""What is required of the signs of bilinear forms, and whether the kernel has proven it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .matrix import Matrix
from .signs import UNKNOWN, BilinearForms

Relation = Literal[">", ">=", "<", "<=", "=="]
_ALLOWED: dict[str, tuple[int, ...]] = {">": (1,), ">=": (0, 1), "<": (-1,), "<=": (-1, 0), "==": (0,)}


@dataclass(frozen=True, eq=False)
class Condition:
    """The requirement z_ki (relation) 0 for bilinear forms z_ki = l_k' M r_i.

    Attributes
    ----------
    name : str
        The inequality in words, such as "h'A x >= 0".
    forms : BilinearForms
    relation : {">", ">=", "<", "<=", "=="}
    where : ndarray of bool, or None
        Entries required, shaped like `forms.values` (like its `data` if sparse); None: all.
    """

    name: str
    forms: BilinearForms
    relation: Relation
    where: NDArray[np.bool_] | None = None

    @cached_property
    def _signs(self) -> NDArray[np.int8]:
        signs = self.forms.signs(self.where)
        return signs.data if self.forms.is_sparse else signs

    @property
    def _failing(self) -> NDArray[np.bool_]:
        first, *others = _ALLOWED[self.relation]
        bad = self._signs != first
        for sign in others:
            bad &= self._signs != sign
        return bad if self.where is None else bad & self.where

    def verdict(self) -> bool | None:
        """True if proven everywhere, False if proven to fail somewhere, None if unknown."""
        return self._verdict

    @cached_property
    def _verdict(self) -> bool | None:
        outside = (
            self.forms.is_sparse
            and self.relation in "<>"
            and self.forms.pattern.nnz < np.prod(self.forms.pattern.shape)
        )
        failing = self._failing
        if not outside and not failing.any():
            return True
        return False if outside or (failing & (self._signs != UNKNOWN)).any() else None

    def worst_violation(self) -> tuple[int, ...] | None:
        """Index of the proven violation of largest relative size, or None."""
        if self.verdict() is True:
            return None
        bad = self._failing & (self._signs != UNKNOWN)
        if not bad.any():
            return None
        size = np.where(bad, self._oriented(), np.inf)
        flat = int(np.argmin(size))
        if self.forms.is_sparse:
            row = int(np.searchsorted(self.forms.pattern.indptr, flat, side="right")) - 1
            return row, int(self.forms.pattern.indices[flat])
        return tuple(int(i) for i in np.unravel_index(flat, size.shape))

    @property
    def residual(self) -> NDArray[np.float64]:
        """The forms in floating point, 0 where nothing is required."""
        z = self.forms.values.data if self.forms.is_sparse else self.forms.values
        return z if self.where is None else np.where(self.where, z, 0.0)

    @property
    def scale(self) -> NDArray[np.float64]:
        """Sizes against which the residuals are to be judged."""
        m = self.forms.magnitudes
        return m.data if self.forms.is_sparse else m

    def _oriented(self) -> NDArray[np.float64]:
        relative = self.forms.relative()
        relative = relative.data if self.forms.is_sparse else relative
        if self.relation == "==":
            return -np.abs(relative)
        return relative if self.relation[0] == ">" else -relative

    @property
    def margin(self) -> float:
        """Smallest relative distance to violation, in [-1, 1]; negative if violated."""
        relative = self._oriented()
        if self.where is not None:
            relative = relative[self.where]
        return float(relative.min(initial=1.0))


@dataclass(frozen=True, eq=False)
class Evaluated(Condition):
    """What is kept of a condition whose matrices are not needed any more: the verdict and its numbers.

    Attributes
    ----------
    holds : bool or None
    found, sizes : ndarray
        The forms, and sizes against which they are to be judged.
    """

    # always set by `of`; a parent with defaults forces defaults here
    holds: bool | None = None
    found: NDArray[np.float64] = None  # type: ignore[assignment]
    sizes: NDArray[np.float64] = None  # type: ignore[assignment]

    @classmethod
    def of(cls, condition: Condition) -> Evaluated:
        """The verdict on a condition that is required everywhere."""
        holds, nothing = condition.verdict(), Matrix.zeros(0, 1)
        numbers = holds, condition.residual, condition.scale
        return cls(condition.name, BilinearForms(nothing, None, nothing), condition.relation, None, *numbers)

    def verdict(self) -> bool | None:
        """As it was found."""
        return self.holds

    def worst_violation(self) -> None:
        """None: which form failed is not kept."""
        return

    @property
    def residual(self) -> NDArray[np.float64]:
        """The forms in floating point."""
        return self.found

    @property
    def scale(self) -> NDArray[np.float64]:
        """Sizes against which the residuals are to be judged."""
        return self.sizes

    def _oriented(self) -> NDArray[np.float64]:
        ratio = np.divide(self.found, self.sizes, out=np.zeros_like(self.sizes), where=self.sizes > 0)
        if self.relation == "==":
            return -np.abs(ratio)
        return ratio if self.relation[0] == ">" else -ratio


def residuals(conditions: Sequence[Condition]) -> dict[str, NDArray[np.float64]]:
    """The forms of each condition in floating point, by its name."""
    out = {condition.name: condition.residual.view() for condition in conditions}
    for values in out.values():
        values.flags.writeable = False
    return out


def all_hold(conditions: Sequence[Condition]) -> bool:
    """True if every condition is proven."""
    return all(condition.verdict() is True for condition in conditions)
