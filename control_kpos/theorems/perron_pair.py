"""Stability of Metzler matrices decided exactly, at any size: on which side of zero the Perron root lies.

A matrix of integers whose entries off the diagonal are not negative falls into irreducible parts.  A part with
x >= 0, N x >= 0 decides alone: its entries in the rows of other parts only add to N x.  If every part has v > 0 with
v'N < 0, weights join these vectors: the decrease of each part is made larger than the increase that it causes in the
others.  Parts are decided by bordered refinement
(`refinement`), and what floating point cannot see (blocks coupled by less than its precision) by exact solution of

    [[N, d], [c', 0]] (x, t) = (0, 1),        d, c > 0.

Coordinates of a cone that is not simplicial form a group; c and d are then sums of facets and generators, and signs
are asked of facets and generators.  What the equations leave open there goes to a linear program.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from graphlib import TopologicalSorter
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..errors import TooLargeError
from ..exact.linalg import solve_exactly
from ..exact.matrix import Index, Integers, bit_length
from ..exact.rational_programs import exact_feasibility, primitive_fractions
from ..exact.sparse_integers import Floats, SparseIntegers
from .bordered import decide_bordered
from .perron_root import approach
from .refinement import Frame, Pair, Refined, Step, balancing_units, frames, moved, rational_multiple

# Bits at which a root that may be zero is first looked at as zero.
_FIRST_ATTEMPT = 110
# A t below minus this is not rounding: x is looked for first.
_NO_ROUNDING = 2.0**-45
# Weights of parts may differ by this many bits: always; on small networks, because files hold no more; all together.
_LONGEST = 1900, 70_000, 2**28
# Rows up to which exact solutions and programs are asked for.
_EXACT_ROWS = 600
_PROGRAM_ROWS = 80
# Bits of a vector in place of an exact solution.
_ROUNDED = 96
# Frames tried for vectors whose entries differ by more than this many bits.
_FRAMES, _SPREAD = 3, 200
# Part of the largest product of Perron entries below which a coordinate is left out of a witness of growth.
_TAIL = 2.0**-100


# Frames of parts by their first coordinates.
Memory: TypeAlias = dict[int, Pair]


@dataclass(frozen=True)
class Decision:
    """Whether a matrix is stable, with v'N < 0 for v in the interior of the dual cone, or N x in the cone.

    Attributes
    ----------
    stable : bool
    vector : ndarray of int (object), shape (n,)
    """

    stable: bool
    vector: Integers


@dataclass(frozen=True)
class Cones:
    """Coordinates that belong to cones that are not simplicial; all others are not negative.

    Attributes
    ----------
    group : ndarray of int, shape (n,)
        Coordinates of one cone share the number of the first of them; all others have their own.
    facets, rays : dict of int to ndarray of int (object), shape (., k)
        By group; no facets where they are too many to be listed.
    """

    group: Index
    facets: dict[int, Integers | None] = field(default_factory=dict)
    rays: dict[int, Integers] = field(default_factory=dict)

    def touches(self, part: Index) -> bool:
        """True if some coordinates of the part belong to such a cone."""
        return bool(self.facets) and any(k in self.facets for k in self.group[part].tolist())

    def of(self, part: Index) -> tuple[Integers | None, Integers]:
        """Facets and generators of the product of the cones of a part."""
        heads = [k for k in part.tolist() if self.group[k] == k]
        one = np.ones((1, 1), dtype=object)
        facets = [self.facets.get(k, one) for k in heads]
        listed = [rows for rows in facets if rows is not None]
        rays = _block_diagonal([self.rays.get(k, one) for k in heads])
        return _block_diagonal(listed) if len(listed) == len(facets) else None, rays


@np.errstate(all="ignore")  # what overflows or vanishes in a proposal proves nothing
def decide(
    N: SparseIntegers,
    cones: Cones | None = None,
    *,
    marginal: bool = False,
    memory: Memory | None = None,
    growing: bool = False,
) -> Decision | None:
    """Settle whether N, cross-positive on a product of half-lines and cones, is stable.

    Parameters
    ----------
    N : SparseIntegers, shape (n, n)
    cones : Cones, optional
        Default: the nonnegative orthant.
    marginal : bool
        True: v'N <= 0 will do, which holds with equality in parts with a root of zero that influence no others.
    memory : dict, optional
        Frames of the parts, for decisions at other shifts of the same matrix.
    growing : bool
        What is expected, and looked for first.

    Returns
    -------
    Decision, or None where a part is undecided and none is unstable.  N x is not 0 if such an x was found.
    """
    cones = Cones(np.arange(N.height)) if cones is None else cones
    found: list[tuple[Index, Decision]] = []
    open_, still = False, None
    for part, own in strong_parts(N, cones.group):
        decided = _decide_part(own, cones, part, memory, growing)
        if decided is not None and not decided.stable:
            still = _placed(decided.vector, part, N.height)
            if N.apply(still).any():
                return Decision(False, still)
            decided = _balanced(own, cones, part) if marginal else decided
        if decided is None:
            open_ = True
        elif decided.stable:
            found.append((part, decided))
        elif marginal:
            return Decision(False, _placed(decided.vector, part, N.height))
    if still is not None and (open_ or not marginal):
        return Decision(False, still)
    v = None if open_ else _joined(N, found, cones)
    return None if v is None else Decision(True, v)


def _placed(x: Integers, part: Index, size: int) -> Integers:
    out = np.zeros(size, dtype=object)
    out[part] = x
    return out


def strong_parts(N: SparseIntegers, group: Index) -> list[tuple[Index, SparseIntegers]]:
    """Irreducible parts with their coordinates, each after all those that it influences."""
    at = group[N.rows], group[N.indices]
    used = N.data != 0
    graph = sp.csr_array((np.ones(used.sum()), (at[0][used], at[1][used])), shape=(N.height, N.height))
    label = connected_components(graph, directed=True, connection="strong")[1][group]
    if (label == label[0]).all():
        return [(np.arange(N.height), N)]
    target, source = label[N.rows], label[N.indices]
    after: dict[int, set[int]] = {int(k): set() for k in np.unique(label)}
    for t, s in set(zip(target[used].tolist(), source[used].tolist(), strict=True)):
        if t != s:
            after[s].add(t)
    members = _by_label(label, np.arange(N.height))
    place = np.empty(N.height, dtype=np.intp)
    for part in members.values():
        place[part] = np.arange(len(part))
    entries = _by_label(target, np.flatnonzero(target == source))
    out = []
    for k in TopologicalSorter(after).static_order():
        part, inside = members[k], entries.get(k, np.zeros(0, dtype=np.intp))
        shape = (len(part), len(part))
        own = SparseIntegers.of(place[N.rows[inside]], place[N.indices[inside]], N.data[inside], shape)
        out.append((part, own))
    return out


def _by_label(label: Index, which: Index) -> dict[int, Index]:
    """The given positions, sorted by their labels."""
    order = which[np.argsort(label[which], kind="stable")]
    names, first = np.unique(label[order], return_index=True)
    return dict(zip(names.tolist(), np.split(order, first[1:]), strict=True))


def _balanced(N: SparseIntegers, cones: Cones, part: Index) -> Decision | None:
    """v with v'N = 0 for an irreducible part with N x = 0; on cones that are not simplicial v'N <= 0, or N x != 0."""
    if cones.touches(part) and N.height <= _PROGRAM_ROWS:
        return _by_program(N, cones.of(part)[1], moving=True)
    facets = {k: rows for k, rows in cones.facets.items() if rows is not None}
    if len(facets) < len(cones.facets) and cones.touches(part):
        return None
    found = _decide_part(N.T, Cones(cones.group, {**cones.rays}, facets), part)
    return None if found is None or found.stable or N.T.apply(found.vector).any() else Decision(True, found.vector)


def _joined(N: SparseIntegers, found: list[tuple[Index, Decision]], cones: Cones) -> Integers | None:
    """Vectors of the parts times powers of two, so that v'N < 0 on the whole, or None."""
    v = np.zeros(N.height, dtype=object)
    if len(found) == 1:
        v[found[0][0]] = found[0][1].vector
        return v
    columns, longest, (least, most, all_) = N.T, 0, _LONGEST
    most = max(least, min(most, all_ // N.height))
    for part, decided in found:
        mine = columns.take(part)
        burden = _on_rays(cones, part, mine.apply(v))
        v[part] = decided.vector
        spared = burden - _on_rays(cones, part, mine.apply(v))
        loaded = [pair for pair in zip(burden.tolist(), spared.tolist(), strict=True) if pair[0] > 0]
        if any(s <= 0 for _, s in loaded):
            return None
        raised = max((b.bit_length() - s.bit_length() + 2 for b, s in loaded), default=0)
        v[part] = decided.vector << max(raised, 0)
        longest = max(longest, max(abs(value).bit_length() for value in v[part]))
        if longest > most:
            return None
    return v


def _on_rays(cones: Cones, part: Index, values: Integers) -> Integers:
    """Values of a dual vector on the generators of a part."""
    return values if not cones.touches(part) else cones.of(part)[1] @ values


def _block_diagonal(blocks: list[Integers]) -> Integers:
    out = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)), dtype=object)
    i = j = 0
    for b in blocks:
        out[i : i + len(b), j : j + b.shape[1]] = b
        i, j = i + len(b), j + b.shape[1]
    return out


def _decide_part(
    N: SparseIntegers, cones: Cones, part: Index, memory: Memory | None = None, growing: bool = False
) -> Decision | None:
    """`decide` for an irreducible part."""
    if cones.touches(part):
        facets, rays = cones.of(part)
        if facets is not None:
            refined = decide_bordered(N, facets, rays)
            solved = _by_solution(N, facets, rays) if refined is None else Decision(*refined)
            if solved is not None:
                return solved
        return _by_program(N, rays)
    if N.height == 1:
        return Decision(bool(N.data.size and N.data[0] < 0), np.array([1], dtype=object))
    memory = {} if memory is None else memory
    known = memory.get(int(part[0]))
    found = None if known is None else _near_margin(moved(known, N), growing)
    if found is None:
        made = frames(N)
        found = None if made is None else _near_margin(made, growing)
        if made is not None:
            memory[int(part[0])] = made
    return found or _away_from_margin(N) or _by_solution(N)


def _near_margin(made: Pair, growing: bool) -> Decision | None:
    """Bordered refinement of the Perron vector, from either side."""
    right, left = Refined(*made[0]), Refined(*made[1])
    if (growing or right.solver.nearly[-1] < -_NO_ROUNDING) and not _leans_below(right, left):
        grown = _grown(right, _FIRST_ATTEMPT)
        if grown is not None:
            return grown
    sign, goal, step = 0, _FIRST_ATTEMPT, None
    for step in left:
        sign = step.sign
        if sign:
            break
        if goal <= step.P or step.is_exact:
            exact = _marginal(right, goal)
            if exact is not None:
                return exact
            goal *= 2
    if step is None or not sign:
        return None
    if sign > 0:
        return Decision(True, _ambient(left.frame, step.X)) if (step.X > 0).all() else None
    return _grown(right)


def _leans_below(right: Refined, left: Refined) -> bool:
    """True if both Perron vectors in floating point tell that the root is negative."""
    y = right.frame.between(left.frame) * left.solver.nearly[:-1]
    step = next(iter(right), None)
    return step is not None and step.leaning(y) > 0


def _grown(right: Refined, bits: float = np.inf) -> Decision | None:
    """x >= 0 with N x >= 0, once the sign of t is certain, or from that many bits on in small integers."""
    step = next((step for step in right if step.sign or bits <= step.P or step.is_exact), None)
    if step is None or step.sign > 0 or not (step.X > 0).all():
        return None
    return Decision(False, _ambient(right.frame, step.X)) if step.sign else _in_small_integers(right.frame, step)


def _marginal(right: Refined, bits: int) -> Decision | None:
    """x >= 0 with N x >= 0 in small integers, from an approximation of that many bits."""
    step = next((step for step in right if bits <= step.P or step.is_exact), None)
    return None if step is None or not (step.X > 0).all() else _in_small_integers(right.frame, step)


def _in_small_integers(frame: Frame, step: Step) -> Decision | None:
    x = rational_multiple(step.X, max(step.error, 0) + 8)
    return None if x is None or not frame.holds(x, -1) else Decision(False, _ambient(frame, x))


def perron_vectors(made: Pair) -> tuple[Integers, Integers] | None:
    """Nearly v and x with v'N = 0 and N x = 0, times powers of two, as far as doubles tell; None if they overflow."""
    out = []
    for frame, solver in made[::-1]:
        x = np.ldexp(solver.perron[:-1], 53)
        if not (np.abs(x) < 2.0**62).all():
            return None
        out.append(_ambient(frame, np.rint(x).astype(np.int64).astype(object)))
    return out[0], out[1]


def _ambient(frame: Frame, X: Integers) -> Integers:
    """From the units of a frame to integers in those of N."""
    units = frame.units
    return X if not units.any() else X << (units - units.min()).astype(object)


def _away_from_margin(N: SparseIntegers) -> Decision | None:
    """Vectors of inverse iteration at shifts that fall to the root, in doubles."""
    units, weight = balancing_units(N), np.ones(N.height)
    for _ in range(_FRAMES):
        frame, spread = Frame(N, units), np.zeros(N.height)
        for at in approach(frame.F, np.ones(N.height)):
            if at.lower > 0:
                x = _of_doubles(*np.frexp(at.x))
                if frame.holds(x, -1):
                    return Decision(False, _ambient(frame, x))
            if at.upper < 0:
                v = _of_doubles(*frame.left(at.y))
                if Frame(N.T, np.zeros_like(units)).holds(v, 1):
                    return Decision(True, v)
            spread, weight = np.log2(np.maximum(at.x, np.finfo(float).smallest_subnormal)), at.x * at.y
        if not _SPREAD < np.ptp(spread) < np.inf:
            break
        units = units + np.rint(spread).astype(np.int64)  # in units of their own, small entries keep their digits
    return _grown_inside(N, weight)


def _grown_inside(N: SparseIntegers, weight: Floats) -> Decision | None:
    """x >= 0 with N x >= 0 on the coordinates where the Perron vectors live; a principal part has no larger root."""
    core = np.flatnonzero(weight >= _TAIL * weight.max())
    if len(core) > 0.9 * N.height:
        return None
    place = np.full(N.height, -1)
    place[core] = np.arange(len(core))
    rows = N.take(core)
    inside = place[rows.indices] >= 0
    shape = (len(core), len(core))
    found = decide(SparseIntegers.of(rows.rows[inside], place[rows.indices[inside]], rows.data[inside], shape))
    if found is None or found.stable:
        return None
    return Decision(False, _placed(found.vector, core, N.height))


def _of_doubles(m: Floats, e: NDArray[np.int64]) -> Integers:
    """The positive numbers m 2^e times a power of two, as integers of 53 digits and more."""
    return np.ldexp(m, 53).astype(np.int64).astype(object) << (e - e.min()).astype(object)


def _by_solution(N: SparseIntegers, facets: Integers | None = None, rays: Integers | None = None) -> Decision | None:
    """Both bordered equations solved without rounding; on the orthant if no facets and generators are given."""
    if N.height > _EXACT_ROWS:
        return None
    if facets is None or rays is None:
        facets = rays = np.eye(N.height, dtype=int).astype(object)
    c, d, S = facets.sum(axis=0), rays.sum(axis=0), N.toarray()
    x, t = _bordered(S, d, c)
    if x is None:
        return None
    if t <= 0:
        return Decision(False, x) if (facets @ x >= 0).all() and x.any() else None
    v, _ = _bordered(S.T, c, d)
    if v is None or not ((rays @ v > 0).all() and (rays @ (v @ S) < 0).all()):
        return None
    cut = max(abs(value).bit_length() for value in v) - _ROUNDED
    short = v >> max(cut, 0)
    return Decision(True, short if (rays @ short > 0).all() and (rays @ (short @ S) < 0).all() else v)


def _bordered(S: Integers, d: Integers, c: Integers) -> tuple[Integers | None, int]:
    """x and t with S x + t d = 0 and c'x > 0, or None."""
    size = len(S)
    K = np.zeros((size + 1, size + 1), dtype=object)
    K[:size, :size], K[:size, size], K[size, :size] = S, d, c
    right = np.zeros((size + 1, 1), dtype=object)
    right[size] = 1
    solved = solve_exactly(K, right)
    return (None, 0) if solved is None else (solved[0][:size, 0], int(solved[0][size, 0]))


def _by_program(N: SparseIntegers, rays: Integers, *, moving: bool = False) -> Decision | None:
    """x = sum q_i x_i with N x = sum p_i x_i, q (moving: p) not 0, or the combination that excludes it."""
    n, p = N.height, len(rays)
    if n > _PROGRAM_ROWS:
        return None
    M, moved = np.zeros((n + 1, 2 * p), dtype=object), N.toarray() @ rays.T
    M[:n, :p], M[:n, p:] = moved * Fraction(1, 1 << bit_length(moved)), -rays.T
    M[n, p * moving : p * (1 + moving)] = 1
    try:
        combination, farkas = exact_feasibility(M, [0] * n + [1])
    except TooLargeError:
        return None
    if combination is not None:
        return Decision(False, _integers(rays.T @ combination[:p]))
    return None if farkas is None else Decision(True, _integers(-farkas[:n]))


def _integers(x: Integers) -> Integers:
    """Fractions times the positive number that makes them integers without a common factor."""
    return np.array([value.numerator for value in primitive_fractions(x)], dtype=object)
