"""The modular test: given local supply rates, find weights sigma for condition (III')."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from ..errors import ShapeError
from ..exact.intake import exact_matrix, items
from ..exact.matrix import Matrix
from ..exact.programs import solve
from ..exact.rational_programs import exact_feasibility, primitive_fractions
from ..proof.certificate import Status
from ..theorems.dissipativity import DissipativityCertificate, dissipativity_of
from . import conditions as on
from .blocks import Floats, inverse
from .certificate import NetworkCertificate
from .certify import (
    at_own_link,
    certify,
    loop_weights,
    provable_rate,
    violation,
)
from .model import NetworkModel
from .own_links import own_links, own_links_closed
from .witnesses import NodeNotDissipative, NoWeights, node_positivity

SupplyRates: TypeAlias = Sequence[Any]
# sigma, or outputs y that exclude every sigma
Proposal: TypeAlias = tuple[Floats | None, Floats | None]

# Entries of (III') up to which its weights are sought in rational arithmetic.
_EXACT_ENTRIES = 2000


def read_rates(model: NetworkModel, rates: SupplyRates) -> tuple[Matrix, Matrix]:
    """Supply rates as two vectors q and r over all outputs and inputs.

    Raises
    ------
    ShapeError
        Not one pair (q_j, r_j) per node, or vectors of the wrong length.
    """
    given = items(rates, "supply_rates")
    if len(given) != model.n_nodes:
        raise ShapeError(f"supply_rates has {len(given)} entries; {model.n_nodes} nodes need one pair (q_j, r_j) each.")
    m, n_out = np.diff(model.offsets[1]), np.diff(model.offsets[2])
    qs, rs = [], []
    for j, item in enumerate(given):
        pair: Any = item.supply if isinstance(item, DissipativityCertificate) else item
        if not isinstance(pair, (tuple, list)) or len(pair) != 2:
            raise ShapeError(f"supply_rates[{j}] must be a pair (q, r).")
        q, r = pair
        qs.append(_row(q, f"q in supply_rates[{j}]", int(n_out[j])))
        rs.append(_row(r, f"r in supply_rates[{j}]", int(m[j])))
    return Matrix.join(qs, -1).dense()[0], Matrix.join(rs, -1).dense()[0]


def _row(data: Any, name: str, size: int) -> Matrix:
    given = exact_matrix(data, name, ndim=2 if isinstance(data, Matrix) else 1)
    row = given if len(given.shape) == 2 else given[None]
    if row.shape != (1, size):
        raise ShapeError(f"{name} has {row.shape[-1]} entries; it must have {size}.")
    return row


def certify_rates(model: NetworkModel, q: Matrix, r: Matrix) -> NetworkCertificate:
    """Theorem 4 with given supply rates, of all outputs and inputs; own links closed if they break it, as in `certify`.

    With u_j = W_jj y_j + v_j the supply r'u + q'y reads r'v + (q + W_jj'r)'y.
    """
    found = certify_rates_as_given(model, q, r)
    closed = own_links_closed(model) if at_own_link(model, found.witness) else None
    if closed is None:
        return found
    rows, columns, values = own_links(model)[1]
    seen = q.fractions()
    np.add.at(seen, columns, values.fractions() * r.fractions()[rows])
    return certify_rates_as_given(closed, Matrix.from_fractions(seen), r)


def certify_rates_as_given(model: NetworkModel, q: Matrix, r: Matrix) -> NetworkCertificate:
    """Theorem 4 with given supply rates, of all outputs and inputs.

    REFUTED means that these rates prove nothing: a node does not satisfy its own, or no sigma fits; the network may
    still be stable with others.
    """
    early = violation(model)
    if early is not None:
        return early
    loop = loop_weights(model)
    if model.has_feedthrough and loop is None:
        return certify(model)
    v, witness = storages(model, q, r)
    common: dict[str, Any] = {"model": model, "loop_weights": loop, "q": q, "r": r}
    if witness is not None or v is None:
        return NetworkCertificate.settle(**common, witness=witness)
    rate = max(provable_rate(model, Matrix(v), q, discrete=model.discrete), 0.0)
    weighted = {**common, "v": Matrix(v), "decay_rate": rate}
    gains = balance_matrix(model, q.values, r.values)
    found = NetworkCertificate.settle(**common)
    for sigma, y in itertools.chain(weights(gains), obstructions(model, gains), exact_weights(model, q, r)):
        if y is not None:
            found = NetworkCertificate.settle(**common, witness=NoWeights(y))
        elif sigma is not None:
            found = NetworkCertificate.settle(**weighted, sigma=sigma)
        if found.status is not Status.UNDECIDED:
            return found
    return found


def storages(model: NetworkModel, q: Matrix, r: Matrix) -> tuple[Floats | None, NodeNotDissipative | None]:
    """v_j for every node, or the first node that has none.

    For -q in Y* the least storage is v = (mu - A)^{-T} C'(-q); a multiple of (mu - A)^{-T} c, half of
    what the inequalities of the inputs allow, makes it strict.  Other supply rates go through the linear program of
    Theorem 3, node by node.
    """
    least = 1.0 if model.discrete else 0.0
    parts: list[Floats] = []
    for g, s in enumerate(model.stacks):
        given_q, given_r = model.split(q, 2)[g], model.split(r, 1)[g]
        q_g, r_g = given_q.values, given_r.values
        K = inverse(least * np.eye(s.sizes[0]) - s.A.values)
        c = np.asarray(s.X.dual.interior_point)
        with np.errstate(all="ignore"):
            low = np.einsum("jkn,jk->jn", K, -np.einsum("jqn,jq->jn", s.C.values, q_g))
            extra = np.einsum("jkn,k->jn", K, c)
            U, X = s.U.rays, s.X.rays
            spare = (r_g + np.einsum("jqm,jq->jm", s.D.values, q_g) - np.einsum("jn,jnm->jm", low, s.B.values)) @ U.T
            used = np.einsum("jn,jnm->jm", extra, s.B.values) @ U.T
            ratio = np.where(used > 0, spare / used, np.where(spare >= 0, np.inf, -1.0))
            part = 0.5 * np.minimum(
                ratio.min(axis=1, initial=np.inf), 2.0 * (1.0 + np.abs(low).max(axis=1, initial=0.0))
            )
            v = low + part[:, None] * extra
            good = (part > 0) & (v @ X.T > 0).all(axis=1) & (-q_g @ s.Y.rays.T >= 0).all(axis=1)
        for place in np.flatnonzero(~good).tolist():
            node = int(model.members[g][place])
            found = dissipativity_of(node_positivity(model, node), q=given_q[place][None], r=given_r[place][None])
            if found.status is Status.REFUTED:
                return None, NodeNotDissipative(node, given_q[place], given_r[place], found.witness)
            if found.v is None:
                return None, None
            v[place] = found.v
        parts.append(v)
    return model.join(parts, 0), None


def balance_matrix(model: NetworkModel, q: Floats, r: Floats) -> sp.csr_array:
    """Coefficients of sigma in (III'): one row per generator of an output cone, one column per node."""
    Q, M, N = model.totals[2], model.totals[1], model.n_nodes
    own = sp.csr_array((q, (np.arange(Q), model.owners(2))), shape=(Q, N))
    given = sp.csr_array((r, (np.arange(M), model.owners(1))), shape=(M, N))
    return sp.csr_array(on.output_generators(model).values @ (own + model.WT @ given))


def weights(gains: sp.csr_array) -> Iterator[Proposal]:
    """Candidates for sigma: ones, then with margin in all rows, then with margin in every row that can have it."""
    count = gains.shape[1]
    yield np.ones(count), None
    size = np.maximum(np.asarray(abs(gains).sum(axis=1)).ravel(), 1e-300)
    scaled = sp.csr_array(sp.diags_array(1 / size) @ gains)
    for each in (False, True):
        for top in (1e4, 1e9):
            x, margin = _with_margin(scaled, (1.0, top), each, "simplex" if count < 2000 else "ipm")
            if margin.any() and (x > 0).all():
                yield x, None


def obstructions(model: NetworkModel, gains: sp.csr_array) -> Iterator[Proposal]:
    """Candidates for y in Y whose supply is positive at every node, then at every node where it can be."""
    for each in (False, True):
        x, _ = _with_margin(sp.csr_array(-gains.T), (0.0, 1.0), each, "simplex")
        if x.size:
            yield None, on.output_generators(model).values.T @ np.maximum(x, 0.0)


def _with_margin(M: sp.csr_array, limits: tuple[float, float], each: bool, method: Any) -> tuple[Floats, Floats]:
    """x with M x + margin <= 0 and the largest margin, one for all rows or one for each; empty if there is none."""
    height, count = M.shape
    margin, most = (sp.eye_array(height), 1e-3) if each else (np.ones((height, 1)), 1.0)
    rows = sp.csr_array(sp.hstack([M, sp.csr_array(margin)]))
    sizes = count, rows.shape[1] - count
    cost, lower, upper = (np.repeat(pair, sizes) for pair in ((0.0, -1.0), (limits[0], 0.0), (limits[1], most)))
    found = solve(cost, rows, np.zeros(height), bounds=(lower, upper), method=method)
    return (found.x[:count], found.x[count:]) if found else (np.zeros(0), np.zeros(0))


def exact_weights(model: NetworkModel, q: Matrix, r: Matrix) -> Iterator[Proposal]:
    """sigma, or y in Y that excludes it, as whole numbers from a rational program; nothing if that is too long.

    By Tucker's theorem some sigma >= 1 satisfies (III') unless a y in Y has a supply that is negative at no node and
    positive at one.
    """
    height = sum(len(s) * s.Y.n_rays for s in model.stacks)
    if height * model.n_nodes > _EXACT_ENTRIES:
        return
    generators = on.output_generators(model).dense().fractions()
    own = np.where(model.owners(2)[:, None] == np.arange(model.n_nodes), q.fractions()[:, None], 0)
    given = np.where(model.owners(1)[:, None] == np.arange(model.n_nodes), r.fractions()[:, None], 0)
    gains = generators @ (own + model.coupling.dense().fractions().T @ given)
    unit = np.array([[Fraction(int(i == j)) for j in range(height)] for i in range(height)], dtype=object)
    x, y = exact_feasibility(np.concatenate([gains, unit], axis=1), -gains.sum(axis=1))
    yield (None if x is None else _whole(x[: model.n_nodes] + 1)), (None if y is None else _whole(y @ generators))


def _whole(x: Any) -> Floats | None:
    """A positive multiple of x in whole numbers that are doubles, or None."""
    whole = primitive_fractions(x)
    return whole.astype(float) if all(abs(v) <= 2**53 for v in whole) else None
