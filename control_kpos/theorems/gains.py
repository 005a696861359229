"""Induced gains of positive systems, from the DC gain.

With storage v = -A^{-T} C'f the least supply for the output f'y is r' = f'G(0), G(0) = D - C A^{-1} B
(Theorem 3, Kawano and Forni, Theorem `cone_d`).  The gain is the infimum of the certified bounds: for
orthants and ones the largest column sum (L1) or row sum (L-infinity) of G(0); see Rantzer, European
Journal of Control 24 (2015), for positive systems.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..cards import shown
from ..cones import Cone
from ..errors import DataError, KposError, UndecidedError
from ..exact.intake import choice, exact_matrix, require_shape
from ..exact.linalg import identity, solve_columns
from ..exact.matrix import Matrix, dense
from ..proof.certificate import Status
from ..systems.system import System
from .positivity import PositivityCertificate, cone_positivity
from .stability import lyapunov_on

# States up to which gains are correctly rounded; and condition numbers of A from which on they are beyond it, too.
_EXACT_STATES = 30
_NEARLY_SINGULAR = 1e8
_BEYOND = "the gain is beyond the range of doubles; rescale the weights e and f, or the data."


def induced_gain(
    A: ArrayLike | Matrix | Any,
    B: ArrayLike | Matrix | Any,
    C: ArrayLike | Matrix | Any,
    D: ArrayLike | Matrix | Any,
    X: Cone | ArrayLike,
    U: Cone | ArrayLike,
    Y: Cone | ArrayLike,
    *,
    norm: Literal["L1", "Linf"] = "L1",
    e: ArrayLike | None = None,
    f: ArrayLike | None = None,
    discrete: bool = False,
) -> float:
    """Induced gain of a positive system, from its DC gain G(0) = D - C A^{-1} B.

    "L1": the largest f'y integrated over time per e'u integrated over time, max_i f'G(0)u_i / e'u_i over
    the generators of U.  "Linf": with |u| = min{t : t e - u and t e + u in U} and |y| likewise with f, the
    largest |y(t)| per largest |u(t)|, max_k h_k'G(0)e / h_k'f over the facets of Y.  For orthants and ones:
    largest column sum and largest row sum of G(0).

    Parameters
    ----------
    A, B, C, D : array_like, shapes (n, n), (n, m), (p, n), (p, m)
    X, U, Y : Cone, or array_like of its generators
    norm : {"L1", "Linf"}
    e : array_like, shape (m,), optional
        Weight of the inputs: in int U* for "L1" (default: sum of the normalised facets of U), in int U for
        "Linf" (default: sum of the normalised generators).
    f : array_like, shape (p,), optional
        Weight of the outputs, in int Y* or int Y.
    discrete : bool
        True for x[k+1] = A x[k] + B u[k], where G(1) = D + C (I - A)^{-1} B takes the place of G(0).

    Returns
    -------
    float
        inf if the system is not exponentially stable.  An infimum, correctly rounded for up to 30 states; above, it is
        computed with a relative error of about 1e-16 times the condition number of A, at most about 1e-8.  For a
        proof of a bound g ask `dissipativity` for q = -f, r = g e with a slightly larger g.

    Raises
    ------
    KposError
        If the system is not positive: the formula does not hold then.
    UndecidedError
        If positivity or stability could not be decided.
    DataError, ShapeError
        Weights of the wrong size, or outside the interior they must lie in.

    Examples
    --------
    >>> import control_kpos as kp
    >>> R1 = kp.orthant(1)
    >>> kp.induced_gain([[-2]], [[1]], [[1]], [[0]], R1, R1, R1)
    0.5
    """
    return induced_gain_of(cone_positivity(A, B, C, D, X, U, Y, discrete=discrete), norm=norm, e=e, f=f)


@np.errstate(all="ignore")
def induced_gain_of(
    positivity: PositivityCertificate,
    *,
    norm: Literal["L1", "Linf"] = "L1",
    e: ArrayLike | None = None,
    f: ArrayLike | None = None,
) -> float:
    """The induced gain once positivity has been decided; see `induced_gain`."""
    norm = choice(norm, "norm", ("L1", "Linf"))
    p = positivity.system()
    if positivity.witness is not None:
        raise KposError(f"the gain formula holds for positive systems only. {positivity.explain()}")
    stable = lyapunov_on(positivity)
    if stable.status is Status.REFUTED:
        return float("inf")
    if not stable:
        raise UndecidedError(f"the gain is not known: {stable.explain()}")
    homes = (p.U.dual, p.Y.dual) if norm == "L1" else (p.U, p.Y)
    weights = [_weight(w, name, home) for w, name, home in ((e, "e", homes[0]), (f, "f", homes[1]))]
    G, is_exact = _static_gain(p)
    e_row, f_row, rays, facets = (
        M.plain().fractions() if is_exact else dense(M.values) for M in (*weights, p.U.exact_rays, p.Y.exact_facets)
    )
    if norm == "L1":
        quotients = (rays @ (f_row[0] @ G)) / (rays @ e_row[0])
    else:
        quotients = (facets @ (G @ e_row[0])) / (facets @ f_row[0])
    with suppress(OverflowError):
        gain = float(np.max(quotients))
        if np.isfinite(gain):
            return gain
    raise UndecidedError(_BEYOND)


def _static_gain(p: System) -> tuple[NDArray[Any], bool]:
    """D - C A^{-1} B, with A - I for A in discrete time, and whether it is of fractions."""
    if p.X.dim > _EXACT_STATES:
        A, B, C, D = (dense(m.values) for m in p.matrices)
        S = A - np.eye(p.X.dim) if p.discrete else A
        with suppress(np.linalg.LinAlgError):
            if np.linalg.cond(S) < _NEARLY_SINGULAR:
                return np.asarray(D - C @ np.linalg.solve(S, B), dtype=np.float64), False
    A, B, C, D = (m.plain().fractions() for m in p.matrices)
    x = solve_columns(A - identity(len(A)) if p.discrete else A, B)
    if x is None:
        raise UndecidedError("the gain is out of reach of exact arithmetic at this size; move A away from singular.")
    return D - C @ x, True


def _weight(weight: ArrayLike | None, name: str, home: Cone) -> Matrix:
    if weight is None:
        return Matrix(np.asarray(home.interior_point, dtype=float)[None])
    exact = require_shape(exact_matrix(weight, name), name, (1, home.dim)).plain()
    if not home.contains(exact.fractions()[0], strict=True):
        signals = "inputs in U" if name == "e" else "outputs in Y"
        raise DataError(
            f"{name} = {shown(np.array(exact.values[0]))} does not weigh the {signals}: for L1 it must be positive on "
            f"every generator of the cone (in the interior of the dual), for Linf it must lie in the interior of the "
            f"cone; for instance {shown(np.asarray(home.interior_point))}."
        )
    return exact
