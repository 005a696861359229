"""Induced gains of positive systems, from the DC gain.

With storage v = -A^{-T} C'f the least supply for the output f'y is r' = f'G(0), G(0) = D - C A^{-1} B
(Theorem 3, Kawano and Forni, Theorem `cone_d`).  The gain is the infimum of the certified bounds: for
orthants and ones the largest column sum (L1) or row sum (L-infinity) of G(0); see Rantzer, European
Journal of Control 24 (2015), for positive systems.  On orthants the L2 gain is sigma_max(G(0)): bounds with proof are
in `structured_gain`.
"""

from __future__ import annotations

from contextlib import suppress
from fractions import Fraction
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..cards import shown
from ..cones import Cone
from ..errors import DataError, KposError, UndecidedError
from ..exact.intake import choice, exact_matrix, require_shape
from ..exact.linalg import identity, product, solve_columns
from ..exact.matrix import Matrix, dense
from ..proof.certificate import Status
from ..systems.system import System
from .positivity import PositivityCertificate, cone_positivity
from .stability import lyapunov_on
from .structured_gain import require_orthants

Norm: TypeAlias = Literal["L1", "L2", "Linf"]
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
    norm: Norm = "L1",
    e: ArrayLike | None = None,
    f: ArrayLike | None = None,
    discrete: bool = False,
) -> float:
    """Induced gain of a positive system, from its DC gain G(0) = D - C A^{-1} B.

    "L1": the largest f'y integrated over time per e'u integrated over time, max_i f'G(0)u_i / e'u_i over
    the generators of U.  "Linf": with |u| = min{t : t e - u and t e + u in U} and |y| likewise with f, the
    largest |y(t)| per largest |u(t)|, max_k h_k'G(0)e / h_k'f over the facets of Y.  For orthants and ones:
    largest column sum and largest row sum of G(0).  "L2": the largest singular value of G(0), on nonnegative orthants U
    and Y, which is the gain between Euclidean norms integrated over time.

    Parameters
    ----------
    A, B, C, D : array_like, shapes (n, n), (n, m), (p, n), (p, m)
    X, U, Y : Cone, or array_like of its generators
    norm : {"L1", "L2", "Linf"}
    e : array_like, shape (m,), optional
        Weight of the inputs: in int U* for "L1" (default: sum of the normalised facets of U), in int U for
        "Linf" (default: sum of the normalised generators).
    f : array_like, shape (p,), optional
        Weight of the outputs, in int Y* or int Y.  "L2" takes no weights.
    discrete : bool
        True for x[k+1] = A x[k] + B u[k], where G(1) = D + C (I - A)^{-1} B takes the place of G(0).

    Returns
    -------
    float
        inf if the system is not exponentially stable.  An infimum, correctly rounded for up to 30 states; above, it is
        computed with a relative error of about 1e-16 times the condition number of A, at most about 1e-8.  For a
        proof of a bound g ask `dissipativity` for q = -f, r = g e with a slightly larger g, for bounds of the L2 gain
        `structured_gain`.  L2 gains are the nearest double for up to 30 inputs or outputs besides.

    Raises
    ------
    KposError
        If the system is not positive: the formula does not hold then.
    UndecidedError
        If positivity or stability could not be decided.
    DataError, ShapeError
        Weights of the wrong size, or outside the interior they must lie in; weights for "L2".
    ConeMismatchError
        "L2", and U or Y is no nonnegative orthant.

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
    norm: Norm = "L1",
    e: ArrayLike | None = None,
    f: ArrayLike | None = None,
) -> float:
    """The induced gain once positivity has been decided; see `induced_gain`."""
    norm = choice(norm, "norm", ("L1", "L2", "Linf"))
    p = positivity.system()
    if norm == "L2":
        _require_euclidean(p, e, f)
    if positivity.witness is not None:
        raise KposError(f"the gain formula holds for positive systems only. {positivity.explain()}")
    stable = lyapunov_on(positivity)
    if stable.status is Status.REFUTED:
        return float("inf")
    if not stable:
        raise UndecidedError(f"the gain is not known: {stable.explain()}")
    G, is_exact = _static_gain(p)
    if norm == "L2":
        with suppress(OverflowError, np.linalg.LinAlgError):
            return _finite(_largest_singular_value(G, is_exact))
        raise UndecidedError(_BEYOND)
    homes = (p.U.dual, p.Y.dual) if norm == "L1" else (p.U, p.Y)
    weights = [_weight(w, name, home) for w, name, home in ((e, "e", homes[0]), (f, "f", homes[1]))]
    e_row, f_row, rays, facets = (
        M.plain().fractions() if is_exact else dense(M.values) for M in (*weights, p.U.exact_rays, p.Y.exact_facets)
    )
    if norm == "L1":
        quotients = (rays @ (f_row[0] @ G)) / (rays @ e_row[0])
    else:
        quotients = (facets @ (G @ e_row[0])) / (facets @ f_row[0])
    return _finite(np.max(quotients))


def _finite(gain: Any) -> float:
    """The gain as a double."""
    with suppress(OverflowError):
        found = float(gain)
        if np.isfinite(found):
            return found
    raise UndecidedError(_BEYOND)


def _require_euclidean(p: System, e: ArrayLike | None, f: ArrayLike | None) -> None:
    require_orthants(p.U, p.Y)
    for name, weight in (("e", e), ("f", f)):
        if weight is not None:
            raise DataError(
                f"{name} weighs gains for L1 and Linf; the L2 gain has none. Scale the columns of B and D, or the rows "
                "of C and D, instead."
            )


def _largest_singular_value(G: NDArray[Any], is_exact: bool) -> float:
    """sigma_max(G) for G >= 0, the nearest double if G is exact and small."""
    if not is_exact or min(G.shape) > _EXACT_STATES or not G.any():
        return float(np.linalg.norm(G.astype(np.float64), 2))
    unit = max(G.ravel().tolist())
    M = G / unit
    N = product(M.T, M) if M.shape[1] <= M.shape[0] else product(M, M.T)
    near = float(Fraction(float(np.linalg.norm(M.astype(np.float64), 2))) * unit)
    while _is_below(N, _half_way(near, -np.inf) / unit):
        near = np.nextafter(near, -np.inf)
    while not _is_below(N, _half_way(near, np.inf) / unit):
        near = np.nextafter(near, np.inf)
    return float(near)


def _half_way(x: float, to: float) -> Fraction:
    """The middle between a double and its neighbour."""
    return (Fraction(x) + Fraction(float(np.nextafter(x, to)))) / 2


def _is_below(N: NDArray[np.object_], bound: Fraction) -> bool:
    """True if the spectral radius of N >= 0 is below bound^2: (bound^2 - N) a = 1 has a solution a > 0."""
    a = solve_columns(bound**2 * identity(len(N)) - N, np.full((len(N), 1), Fraction(1), dtype=object))
    return a is not None and bool((a > 0).all())


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
