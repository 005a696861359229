"""Modes that no feedback moves, found and judged in exact arithmetic.

With R a basis of the directions that B, A B, A^2 B, .. span and N one of the rows y with y R = 0, N A = A_u N: the
eigenvalues of A_u are among those of A + B F for every F (Kalman).  They are proven to be stable or not; what is not
proven is not said.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cards import about
from ..exact import linalg
from ..exact.budget import OutOfBudgetError, affords, spend
from ..exact.matrix import Matrix
from ..exact.polynomials import (
    Polynomial,
    characteristic_polynomial,
    moebius,
    scale_roots,
    square_free_part,
    vanishes,
)
from ..exact.roots import Disc, on_imaginary_axis, root_discs
from .plant import Floats, Plant

# Relative size of a singular value below which exact arithmetic is asked; operations of a decomposition, for each entry
# and row; operations of exact arithmetic for n^4; binary digits of a mode after which no more is said of its stability;
# entries of matrices that are decomposed together.
_SUSPECT, _EFFORT, _EXACT_EFFORT, _DIGITS, _TOGETHER = 1e-7, 10.0, 300.0, 512, 20_000


def reachable(A: Matrix, B: Matrix) -> NDArray[np.object_]:
    """A basis of what B, A B, A^2 B, .. span, as columns of fractions.

    Raises
    ------
    OutOfBudgetError
        If the operations are not left.
    """
    n = A.shape[0]
    spend(_EXACT_EFFORT * n**4)
    a, basis = A.fractions(), linalg.columns(B.fractions())
    while 0 < basis.shape[1] < n:
        larger = linalg.columns(np.concatenate([basis, linalg.product(a, basis)], axis=1))
        if larger.shape[1] == basis.shape[1]:
            break
        basis = larger
    return basis


def controllability_notes(plant: Plant) -> tuple[str, ...]:
    """One sentence for each uncontrollable mode of the first vertex, as far as the effort allows.

    Floating point decides only where exact arithmetic looks.
    """
    A, B = plant.vertices[0]
    with suppress(OutOfBudgetError, np.linalg.LinAlgError):
        if _is_suspect(*plant.pairs[0]):
            basis = reachable(A, B)
            of = " of the first vertex" if len(plant.vertices) > 1 else ""
            if basis.shape[1] < plant.n:
                return tuple(_notes(A, basis, plant.discrete, of))
    return ()


def _is_suspect(A: Floats, B: Floats) -> bool:
    """Some eigenvalue s with rank [A - s I, B] < n (Hautus), in floating point; A and B are brought to size 1."""
    effort, n = sum(A.shape) / 2 * (A.size + B.size) * _EFFORT, len(A)
    if not affords(effort):
        return False
    A, B = (M / (np.abs(M).max(initial=0.0) or 1.0) for M in (A, B))
    modes = np.linalg.eigvals(A)
    modes, step = modes[modes.imag >= 0], max(1, _TOGETHER // (A.size + B.size))
    for at in range(0, len(modes), step):
        if not affords(effort * step):
            return False
        shifted = A - modes[at : at + step, None, None] * np.eye(n)
        pencils = np.concatenate([shifted, np.broadcast_to(B, (len(shifted), *B.shape))], axis=2)
        sizes = np.linalg.svd(pencils, compute_uv=False)
        if not (sizes[:, -1] > _SUSPECT * sizes[:, 0]).all():
            return True
    return False


def _notes(A: Matrix, basis: NDArray[np.object_], discrete: bool, of: str) -> Iterator[str]:
    rows = linalg.nullspace(basis.T) if basis.shape[1] else linalg.identity(A.shape[0])
    fixed = linalg.solve_columns(rows, linalg.product(A.fractions().T, rows))
    if fixed is None:
        return
    p, factor = characteristic_polynomial(Matrix.from_fractions(fixed))
    p = square_free_part(scale_roots(p, factor))
    for disc, stable in _modes(p, discrete):
        yield _note(p, disc, stable, of)


def _modes(p: Polynomial, discrete: bool) -> Iterator[tuple[Disc, bool | None]]:
    """A disc around every root with imaginary part >= 0, and whether that is stable; None if this is not decided."""
    edge, discs = Fraction(discrete), ()
    for discs in root_discs(p, _DIGITS):
        ranges = [disc.range(modulus=discrete) for disc in discs]
        if all(high < edge or low >= edge for low, high in ranges):
            break
    open_ = [disc for disc in discs if _side(disc, discrete) is None and not disc.is_real]
    # one pair next to the edge, and one that is on it
    on_edge = len(open_) == 2 and on_imaginary_axis(moebius(p, edge) if discrete else p)
    for disc in discs:
        if disc.y < 0:
            continue
        stable = _side(disc, discrete)
        if stable is None and (on_edge if disc.y else any(vanishes(p, x) for x in {edge, -edge} if _holds(disc, x))):
            stable = False
        yield disc, stable


def _side(disc: Disc, discrete: bool) -> bool | None:
    low, high = disc.range(modulus=discrete)
    return True if high < int(discrete) else False if low >= int(discrete) else None


def _holds(disc: Disc, x: Fraction) -> bool:
    low, high = disc.range()
    return low <= x <= high


def _note(p: Polynomial, disc: Disc, stable: bool | None, of: str) -> str:
    unit = Fraction(2) ** -disc.places
    parts: Any = (disc.x * unit, disc.y * unit) if disc.y else (disc.x * unit,)
    # shown are the digits of the centre of the disc, which need not be the root
    text = about(*parts, digits=4, form="{} +/- {}j" if disc.y else "{}")
    exact = not disc.y and vanishes(p, parts[0])
    mode = text if exact or text.startswith("about ") else f"about {text}"
    consequence = {
        True: "it is stable and stays as it is, which limits the decay rate",
        False: "it is not stable, so no feedback stabilises this plant; change the actuators",
        None: "it is on the edge of stability or next to it, and stays there",
    }[stable]
    return f"The mode {mode}{of} is not controllable: {consequence}."
