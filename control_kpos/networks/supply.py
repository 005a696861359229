"""The modular test: given local supply rates, find weights sigma for condition (III')."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from ..arguments import items
from ..arrays import vector
from ..certificates.result import Status
from ..dissipativity import DissipativityCertificate, dissipativity_of
from ..errors import ShapeError
from ..linear_programs import solve
from . import conditions as on
from .blocks import Floats, inverse
from .certificate import NetworkCertificate, per_node
from .certify import certify, loop_weights, provable_rate, violation
from .model import NetworkModel
from .witnesses import NodeNotDissipative, NoWeights, node_positivity

SupplyRates: TypeAlias = Sequence[Any]


def read_rates(model: NetworkModel, rates: SupplyRates) -> tuple[Floats, Floats]:
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
        pair: Any = (item.q, item.r) if isinstance(item, DissipativityCertificate) else item
        if not isinstance(pair, (tuple, list)) or len(pair) != 2:
            raise ShapeError(f"supply_rates[{j}] must be a pair (q, r).")
        q, r = pair
        qs.append(vector(q, f"q in supply_rates[{j}]", int(n_out[j])))
        rs.append(vector(r, f"r in supply_rates[{j}]", int(m[j])))
    return np.concatenate(qs), np.concatenate(rs)


def certify_rates(model: NetworkModel, q: Floats, r: Floats) -> NetworkCertificate:
    """Theorem 4 with given supply rates.

    Parameters
    ----------
    model : NetworkModel
    q, r : ndarray, shapes (sum q_k,), (sum m_j,)

    Returns
    -------
    NetworkCertificate
        REFUTED means that these rates prove nothing: a node does not satisfy its own, or no sigma fits;
        the network may still be stable with others.
    """
    early = violation(model, None)
    if early is not None:
        return early
    loop = loop_weights(model)
    if model.has_feedthrough and loop is None:
        return certify(model)
    v, witness = storages(model, q, r)
    rates = {"q": per_node(q, model, 2), "r": per_node(r, model, 1)}
    if witness is not None or v is None:
        return NetworkCertificate.settle(model=model, witness=witness, loop_weights=loop, **rates)
    rate = max(provable_rate(model, v, q, discrete=model.discrete), 0.0)
    gains = balance_matrix(model, q, r)
    draft = None
    for sigma in weights(gains, model.n_nodes):
        draft = NetworkCertificate.settle(
            model=model, v=per_node(v, model, 0), sigma=sigma, decay_rate=rate, loop_weights=loop, **rates
        )
        if draft.status is Status.PROVED:
            return draft
    for y in obstructions(model, gains):
        refuted = NetworkCertificate.settle(model=model, witness=NoWeights(y), loop_weights=loop, **rates)
        if refuted.status is Status.REFUTED:
            return refuted
    return draft or NetworkCertificate.settle(model=model, loop_weights=loop, **rates)


def storages(model: NetworkModel, q: Floats, r: Floats) -> tuple[Floats | None, NodeNotDissipative | None]:
    """v_j for every node, or the first node that has none.

    For -q in Y* the least storage is v = (mu - A)^{-T} C'(-q); a share of (mu - A)^{-T} c that the slack of
    the inputs leaves room for makes it strict.  Other supply rates go through the linear program of
    Theorem 3, node by node.
    """
    least = 1.0 if model.discrete else 0.0
    parts: list[Floats] = []
    for g, s in enumerate(model.stacks):
        q_g, r_g = model.split(q, 2)[g], model.split(r, 1)[g]
        K = inverse(least * np.eye(s.sizes[0]) - s.A.values)
        c = np.asarray(s.X.dual.interior_point)
        with np.errstate(all="ignore"):
            low = np.einsum("jkn,jk->jn", K, -np.einsum("jqn,jq->jn", s.C.values, q_g))
            extra = np.einsum("jkn,k->jn", K, c)
            U, X = s.U.rays, s.X.rays
            room = (r_g + np.einsum("jqm,jq->jm", s.D.values, q_g) - np.einsum("jn,jnm->jm", low, s.B.values)) @ U.T
            used = np.einsum("jn,jnm->jm", extra, s.B.values) @ U.T
            ratio = np.where(used > 0, room / used, np.where(room >= 0, np.inf, -1.0))
            share = 0.5 * np.minimum(ratio.min(axis=1, initial=np.inf), 2.0 * (1.0 + np.abs(low).max(axis=1)))
            v = low + share[:, None] * extra
            good = (share > 0) & (v @ X.T > 0).all(axis=1) & (-q_g @ s.Y.rays.T >= 0).all(axis=1)
        for place in np.flatnonzero(~good).tolist():
            node = int(model.members[g][place])
            found = dissipativity_of(node_positivity(model, node), q=q_g[place], r=r_g[place])
            if found.status is Status.REFUTED:
                return None, NodeNotDissipative(node, q_g[place], r_g[place], found.witness)
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


def weights(gains: sp.csr_array, count: int) -> Any:
    """Candidates for sigma: ones, then the weights of largest relative slack."""
    yield np.ones(count)
    size = np.maximum(np.asarray(abs(gains).sum(axis=1)).ravel(), 1e-300)
    scaled = sp.csr_array(sp.diags_array(1 / size) @ gains)
    rows = sp.hstack([scaled, np.ones((scaled.shape[0], 1))], format="csr")
    for top in (1e4, 1e9):
        cost = np.zeros(count + 1)
        cost[-1] = -1.0
        bounds = np.concatenate([np.ones(count), [0.0]]), np.concatenate([np.full(count, top), [1.0]])
        found = solve(cost, rows, np.zeros(scaled.shape[0]), bounds=bounds, method="simplex" if count < 2000 else "ipm")
        if found and found.x[-1] > 0:
            yield found.x[:-1]


def obstructions(model: NetworkModel, gains: sp.csr_array) -> Any:
    """Candidates for y in Y whose supply is negative at no node."""
    count, nodes = gains.shape
    generators = on.output_generators(model).values
    transposed = sp.csr_array(gains.T)
    for strict in (True, False):
        if strict:
            rows = sp.hstack([-transposed, np.ones((nodes, 1))], format="csr")
            cost = np.concatenate([np.zeros(count), [-1.0]])
        else:
            rows, cost = -transposed, -np.asarray(gains.sum(axis=1)).ravel()
        upper = np.concatenate([np.ones(count), [1.0]]) if strict else np.ones(count)
        found = solve(cost, rows, np.zeros(nodes), bounds=(0.0, upper))
        if found:
            yield generators.T @ np.maximum(found.x[:count], 0.0)
