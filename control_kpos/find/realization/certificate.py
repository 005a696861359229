"""Proof of a realization with nonnegative matrices, by a matrix that takes its states to those of a given one.

With R, n x p, and P, N, Q of the order p,

    A R = R P,    B = R N,    C R = Q,    P_ij >= 0 (i != j; discrete time: all),    N, Q, D >= 0,

both systems have the same response: C (sI - A)^-1 B = C R (sI - P)^-1 N = Q (sI - P)^-1 N, since A R = R P gives
(sI - A)^-1 R = R (sI - P)^-1.  So the impulse response is nonnegative, and the responses to steps never fall.

For minimal (A, B, C) the columns of R span a proper cone that A keeps, that holds B and lies in {x : C x >= 0}; and
such a cone of p rays gives P, N and Q (Ohta, Maeda and Kodama, SIAM J. Control Optim. 22 (1984)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...errors import DataError
from ...exact.condition import Condition
from ...exact.matrix import Matrix
from ...exact.signs import BilinearForms
from ...proof.certificate import Certificate, Status
from ...proof.encoding import register_record

_INTERTWINED, _INPUTS, _OUTPUTS = "A R - R P == 0", "B - R N == 0", "C R - Q == 0"
_SIGNS = ("P >= 0", "N >= 0", "Q >= 0", "D >= 0")


@register_record
@dataclass(frozen=True, eq=False)
class NegativeResponse:
    """An impulse at an input to which an output responds with the wrong sign, at once or next.

    Attributes
    ----------
    row, column : int
        The output and the input.
    step : int
        0: the entry of D is negative; 1: that of C B is, the response right after the impulse.
    """

    row: int = 0
    column: int = 0
    step: int = 0

    def __str__(self) -> str:
        return f"{'C B' if self.step else 'D'}[{self.row}, {self.column}] is negative"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PositiveRealizationCertificate(Certificate):
    """Proof that a system has the response of one with nonnegative matrices, or that D or C B is negative somewhere.

    Attributes
    ----------
    A, B, C, D : Matrix
        The system, with n states.
    discrete : bool
        True for x[k+1] = A x[k] + B u[k].
    A_positive, B_positive, C_positive : Matrix, shapes (p, p), (p, m), (q, p), or None
        P, N and Q, which are nonnegative; P in continuous time off the diagonal.
    transform : Matrix, shape (n, p), or None
        R.
    witness : NegativeResponse or None
        For REFUTED.
    """

    claim: ClassVar[str] = "positive realization"
    no_margin: ClassVar[frozenset[str]] = frozenset({_INTERTWINED, _INPUTS, _OUTPUTS, *_SIGNS})

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    discrete: bool = False
    A_positive: Matrix | None = None
    B_positive: Matrix | None = None
    C_positive: Matrix | None = None
    transform: Matrix | None = None

    def _positive(self) -> tuple[Matrix | None, ...]:
        return self.A_positive, self.B_positive, self.C_positive, self.transform

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        n, m, q = self.A.shape[0], self.B.shape[1], self.C.shape[0]
        if (self.A.shape, self.B.shape, self.C.shape, self.D.shape) != ((n, n), (n, m), (q, n), (q, m)):
            raise DataError("A, B, C and D do not fit together.")
        if self.witness is None and any(M is None for M in self._positive()):
            return Status.UNDECIDED, ()
        return super()._evaluate()

    def conditions(self) -> list[Condition]:
        """The equations with R, and the signs."""
        P, N, Q, R = self._positive()
        if P is None or N is None or Q is None or R is None:
            raise DataError("a realization has three matrices, and one that takes its states to those of the other.")
        (n, p), m, q = R.shape, self.B.shape[1], self.C.shape[0]
        if (P.shape, N.shape, Q.shape, n) != ((p, p), (p, m), (q, p), self.A.shape[0]):
            raise DataError("the matrices of the realization do not fit together.")
        off = None if self.discrete else ~np.eye(p, dtype=bool)
        return [
            Condition(_INTERTWINED, _difference(self.A, R, R, P), "=="),
            Condition(_INPUTS, _difference(self.B, Matrix.identity(m), R, N), "=="),
            Condition(_OUTPUTS, _difference(self.C, R, Matrix.identity(q), Q), "=="),
            *(
                Condition(name, BilinearForms(M, None, Matrix.identity(M.shape[1])), ">=", where)
                for name, M, where in zip(_SIGNS, (P, N, Q, self.D), (off, None, None, None), strict=True)
            ),
        ]

    def refutation(self) -> list[Condition] | None:
        """The sign of the entry of D, or of C B."""
        w, (q, m) = self.witness, self.D.shape
        if not isinstance(w, NegativeResponse) or any(M is not None for M in self._positive()):
            return None
        if not (0 <= w.row < q and 0 <= w.column < m and w.step in (0, 1)):
            return None
        left, right = (self.C, self.B.T) if w.step else (self.D, Matrix.identity(m))
        return [Condition("response < 0", BilinearForms(left[[w.row]], None, right[[w.column]]), "<")]

    def evidence(self) -> dict[str, Any]:
        """Nothing: the data suffice."""
        return {}

    def explain(self) -> str:
        """What has been proven, and what follows."""
        if self.refuted_by is not None:
            return (
                f"Refuted: no realization has nonnegative matrices, because {self.witness}: the response to a positive "
                "impulse begins with the wrong sign."
            )
        if not self or self.A_positive is None:
            return "Undecided: no realization with nonnegative matrices was proven."
        kind = "" if self.discrete else " (off the diagonal of A)"
        return (
            f"Proved: a system of order {self.A_positive.shape[0]} with nonnegative matrices{kind} has exactly this "
            "response. So the impulse response is nonnegative, and responses to steps never fall."
        )


def _difference(a: Matrix, b: Matrix, c: Matrix, d: Matrix) -> BilinearForms:
    """a b - c d."""
    return BilinearForms(Matrix.join([a, c], -1), None, Matrix.join([b.T, -d.T], -1))
