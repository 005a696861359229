"""The inequalities of Theorem 4 as conditions for the kernel, on stacked nodes and sparse coupling.

Every product of given data is left to the kernel; nothing is multiplied beforehand.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from ..cones import Cone, Orthant
from ..errors import UndecidedError
from ..exact.condition import Condition
from ..exact.distinct import distinct
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..exact.stacks import Identity, Joined, Transposed, forms_on, stacked
from ..proof.inclusion import MEANING, NAMES
from ..theorems.decay_rates import Rate, at_rate
from .blocks import Floats, Index, block_diagonal, nonzero_blocks, shared, take_blocks
from .model import BLOCKS, NetworkModel
from .nodes import NodeStack

STATE, INPUT, OUTPUT, DIRECT = (NAMES[name] for name in "ABCD")
INCLUSIONS = {NAMES[name]: meaning for name, meaning in MEANING.items()}
STORAGE, RATE, SUPPLY = "v'x > 0", "(v'A + rate v' - q'C) x <= 0", "(v'B - r' - q'D) u <= 0"
STRICT, REQUIRED = "(v'A - q'C) x < 0", "(v'A + required_rate v' - q'C) x <= 0"
COUPLING, BALANCE = "h'W y >= 0", "sigma q'y + sum sigma r'W y <= 0"
LINKS_WITHIN = "h'(W_upper - W_lower) y >= 0"
LOOP_WEIGHT, LOOP_DIRECT, LOOP_COUPLING = "p'y > 0", "(p'D - t') u <= 0", "(t'W - p') y < 0"

# What other shards send to inputs: bounds, and the inputs that they go to.
Heard: TypeAlias = "tuple[Matrix, Index] | None"

# Entries up to which generators that are not doubles are written out.
_EXACT_ENTRIES = 10**6


def titled(name: str, model: NetworkModel, g: int) -> str:
    """The condition's name, with the stack it is about if there are several."""
    return name if len(model.stacks) == 1 else f"{name} [stack {g}]"


def beside(*vectors: Matrix) -> Joined:
    """Vectors of every node, (N, size) each, beside each other as one row of every node, (N, 1, sum of sizes)."""
    return Joined([v[:, None, :] for v in vectors], -1)


def after(*vectors: Matrix) -> Matrix:
    """Vectors after each other as one row."""
    return Matrix.join(vectors, -1)[None, :]


def facets(cone: Cone) -> Matrix:
    """Facet normals in dense form."""
    return cone.exact_facets.dense()


def positivity(model: NetworkModel, g: int) -> list[Condition]:
    """Theorem 1 for every node of a stack: forms of shape (N, facets, generators)."""
    s = model.stacks[g]
    out = []
    X, U, _ = s.rays
    own, outer = facets(s.X), facets(s.Y)
    state = stacked(own, s.A, X)
    where = None if model.discrete else np.broadcast_to(s.X.incidence, (len(s), s.X.n_facets, s.X.n_rays))
    out.append(Condition(titled(STATE, model, g), state, ">=", where))
    for name, target, matrix, source in ((INPUT, own, s.B, U), (OUTPUT, outer, s.C, X), (DIRECT, outer, s.D, U)):
        if not (name == DIRECT and s.D.is_zero):
            out.append(Condition(titled(name, model, g), stacked(target, shared(matrix), source), ">="))
    return out


def coupling(model: NetworkModel) -> list[Condition]:
    """(I): h'W_jk y >= 0 for facets h of U_j and generators y of Y_k, on the nonzero blocks of W."""
    return [condition for condition, _ in coupling_by_pairs(model)]


def coupling_by_pairs(model: NetworkModel) -> list[tuple[Condition, tuple[Index, Index] | None]]:
    """The same with the nodes j and k of the blocks; None if the condition is about the entries of W."""
    receiving = model.receiving
    if all(isinstance(c, Orthant) for c in (*receiving, *(s.Y for s in model.stacks))) and model.coupling.is_sparse:
        one = Matrix(np.ones((1, 1)))
        forms = stacked(one, Matrix(model.coupling.values.data[:, None, None]), one)
        return [(Condition(COUPLING, forms, ">="), None)]
    out = []
    for g, (j, k), (blocks,) in _blocks_by_stacks(model, [model.coupling]):
        forms = stacked(facets(receiving[g[0]]), blocks, model.stacks[g[1]].rays[2])
        out.append((Condition(_between(COUPLING, model, g), forms, ">="), (j, k)))
    return out


def coupling_within(low: NetworkModel, high: NetworkModel, *, sum_of: bool = False) -> list[Condition]:
    """h'(W_upper - W_lower) y >= 0 for the links of two networks of the same nodes; the sum if `sum_of`."""
    ends, name = [high.coupling, low.coupling], LINKS_WITHIN.replace("-", "+") if sum_of else LINKS_WITHIN
    if all(isinstance(c, Orthant) for s in high.stacks for c in (s.U, s.Y)) and all(W.is_sparse for W in ends):
        # sums and differences of two doubles have the right sign
        apart = Matrix(sp.csr_array(high.W + low.W if sum_of else high.W - low.W).data[:, None])
        return [Condition(name, BilinearForms(Matrix(np.ones((1, 1))), None, apart), ">=")]
    out = []
    for g, _, blocks in _blocks_by_stacks(high, ends):
        y = high.stacks[g[1]].rays[2]
        row = Matrix.join([y, y if sum_of else -y], -1)
        forms = stacked(facets(high.stacks[g[0]].U), Matrix.join(blocks, -1), row)
        out.append(Condition(_between(name, high, g), forms, ">="))
    return out


def nodes_within(low: NetworkModel, high: NetworkModel, g: int, *, sum_of: bool = False) -> list[Condition]:
    """h'(M_upper - M_lower) x >= 0 for A, B, C and D of a stack, where they differ; of their sum if `sum_of`.

    The sum of A, in continuous time, only for generators x on the facet h.
    """
    s, ends = high.stacks[g], (high.stacks[g], low.stacks[g])
    cones = s.X, s.U, s.Y
    out = []
    for name, (rows, columns) in BLOCKS.items():
        upper, lower = (getattr(end, name) for end in ends)
        if not same_numbers(upper, lower):
            x, sign = s.rays[columns], "+" if sum_of else "-"
            row = Matrix.join([x, x if sum_of else -x], -1)
            forms = stacked(facets(cones[rows]), Matrix.join([upper, lower], -1), row)
            flow = sum_of and name == "A" and not high.discrete
            where = np.broadcast_to(s.X.incidence, (len(s), s.X.n_facets, s.X.n_rays)) if flow else None
            title = titled(f"h'({name}_upper {sign} {name}_lower) x >= 0", high, g)
            out.append(Condition(title, forms, ">=", where))
    return out


def same_numbers(a: Matrix, b: Matrix) -> bool:
    """True if two matrices of one shape hold the same numbers."""
    if a is b or (a.is_double and b.is_double):
        apart = a.values != b.values
        return a is b or not (apart.nnz if sp.issparse(apart) else np.any(apart))
    return bool((a.dense().fractions() == b.dense().fractions()).all())


def _between(name: str, model: NetworkModel, g: tuple[int, int]) -> str:
    return name if len(model.receiving) == 1 else f"{name} [stack {g[1]} to {g[0]}]"


def _nonzero(M: Matrix) -> Any:
    """Doubles that are not zero where M is not; the closest one to a fraction may be."""
    return M.values if M.is_double else abs(M.values) + M.radius


def _blocks_by_stacks(
    model: NetworkModel, couplings: list[Matrix]
) -> Iterator[tuple[tuple[int, int], tuple[Index, Index], list[Matrix]]]:
    """The blocks that are not zero in some coupling, for every two stacks: target and source, nodes j and k, blocks.

    Nodes j are receivers of the links, the stacks of targets places in the cones of these.
    """
    to = model.receivers
    pairs = [nonzero_blocks(_nonzero(W), to.owners, model.owners(2)) for W in couplings]
    target_nodes, source_nodes = pairs[0]
    if len(pairs) > 1:
        width = model.n_nodes
        places = distinct(np.concatenate([j.astype(np.int64) * width + k for j, k in pairs]))
        target_nodes, source_nodes = places // width, places % width
    u0, y0 = to.starts, model.offsets[2]
    key = to.kinds[target_nodes] * len(model.stacks) + model.home[0][source_nodes]
    for pair in distinct(key).tolist():
        gj, gk = divmod(pair, len(model.stacks))
        j, k = target_nodes[key == pair], source_nodes[key == pair]
        rows = u0[j][:, None] + np.arange(to.cones[gj].dim)
        columns = y0[k][:, None] + np.arange(model.stacks[gk].sizes[2])
        yield (gj, gk), (j, k), [take_blocks(W, rows, columns) for W in couplings]


def storage(model: NetworkModel, g: int, v: Matrix) -> Condition:
    """v_j'x > 0 on the generators of X_j; v of shape (N, n)."""
    s = model.stacks[g]
    return Condition(titled(STORAGE, model, g), stacked(beside(v), None, s.rays[0]), ">")


def decrease_forms(s: NodeStack, v: Matrix, q: Matrix, rate: Rate, discrete: bool) -> BilinearForms:
    """(v'A + rate v' - q'C) x, with A - I for A in discrete time."""
    eye = Matrix(np.eye(s.sizes[0])[None])
    left, middle = [v], [s.A]
    if discrete:
        left.append(v)
        middle.append(-eye)
    if rate:
        row, block = at_rate(v, rate, eye)
        left.append(row)
        middle.append(block)
    if not q.is_zero:
        left.append(-q)
        middle.append(s.C)
    return stacked(beside(*left), Joined(middle, -2), s.rays[0])


def decrease(
    model: NetworkModel, g: int, v: Matrix, q: Matrix, rate: Rate, *, discrete: bool, name: str = RATE
) -> Condition:
    """(v_j'A_j + rate v_j' - q_j'C_j) x <= 0 on the generators of X_j; strict if the rate is 0."""
    forms = decrease_forms(model.stacks[g], v, q, rate, discrete)
    name, relation = (name, "<=") if rate else (STRICT, "<")
    return Condition(titled(name, model, g), forms, relation)  # type: ignore[arg-type]


def supply(model: NetworkModel, g: int, v: Matrix, q: Matrix, r: Matrix, name: str = SUPPLY) -> Condition:
    """(v_j'B_j - r_j' - q_j'D_j) u <= 0 on the generators of U_j."""
    s = model.stacks[g]
    m = s.sizes[1]
    left, middle = [v, r], [s.B, Matrix(-np.eye(m)[None])]
    if not s.D.is_zero:
        left.append(-q)
        middle.append(s.D)
    return Condition(titled(name, model, g), stacked(beside(*left), Joined(middle, -2), s.rays[1]), "<=")


def loop_direct(model: NetworkModel, g: int, p: Matrix, t: Matrix) -> Condition:
    """(p_j'D_j - t_j') u <= 0 on the generators of U_j."""
    s = model.stacks[g]
    middle = Joined([s.D, Matrix(-np.eye(s.sizes[1])[None])], -2)
    return Condition(titled(LOOP_DIRECT, model, g), stacked(beside(p, t), middle, s.rays[1]), "<=")


def output_generators(model: NetworkModel) -> Matrix:
    """Generators of the product of the Y_k as sparse rows of length sum q_k."""
    return rows_of_product(model, [(s.Y, s.rays[2]) for s in model.stacks], 2)


def input_facets(model: NetworkModel) -> Matrix:
    """Facet normals of the product of the U_j as sparse rows; with those of the halo."""
    cones = [(cone, facets(cone)) for cone in model.receivers.cones]
    return _rows_at(cones, model.received, model.coupling.shape[0])


def rows_of_product(model: NetworkModel, cones: list[tuple[Cone, Matrix]], kind: int) -> Matrix:
    """Generators or facets of all nodes as rows over all inputs (kind 1) or outputs (kind 2)."""
    return _rows_at(cones, [places[kind] for places in model.places], model.totals[kind])


def _rows_at(cones: list[tuple[Cone, Matrix]], at: Sequence[Index], size: int) -> Matrix:
    """The rows that belong to each cone, at the places (N, dim) of its members in vectors of this size."""
    if all(isinstance(cone, Orthant) for cone, _ in cones):
        return Matrix(sp.eye_array(size, format="csr"))
    parts, count = [], 0
    for (_, R), places in zip(cones, at, strict=True):
        rows = count + np.arange(len(places) * R.shape[0]).reshape(len(places), R.shape[0])
        parts.append((np.broadcast_to(R.values, (len(places), *R.shape)), rows, places))
        count += rows.size
    if all(R.is_double for _, R in cones):
        return Matrix(block_diagonal(parts, (count, size)))
    if count * size > _EXACT_ENTRIES:
        raise UndecidedError(
            "large networks need cones with generators and facets that are doubles; give them with integer generators."
        )
    out = np.zeros((count, size), dtype=object)
    for (_, R), (_, rows, columns) in zip(cones, parts, strict=True):
        out[rows[:, :, None], columns[:, None, :]] = R.rows_as_integers(np.arange(R.shape[0]))
    return Matrix.from_fractions(out)


def balance_forms(model: NetworkModel, q: Matrix, r: Matrix, sigma: Floats | None) -> BilinearForms:
    """sigma_k q_k'y + sum_j sigma_j r_j'W_jk y for every generator y of every Y_k: forms (1, sum p_k)."""
    Q = model.totals[2]
    if sigma is None or (sigma == 1).all():
        links = Transposed(Matrix(model.WT)) if model.coupling.is_sparse else model.coupling
        rates, through = Joined([q[None, :], r[None, :]], -1), Joined([Identity(Q), links], -2)
        orthants = all(isinstance(s.Y, Orthant) for s in model.stacks)
        return forms_on(rates, through, Identity(Q) if orthants else output_generators(model))
    left, generators = after(q, r), output_generators(model)
    if not left.is_double:  # fractions are multiplied without rounding
        weights = np.array(list(map(Fraction, sigma.tolist())))[_nodes(model)]
        return BilinearForms(Matrix.from_fractions(left.fractions() * weights), _sent_and_received(model), generators)
    # l = sigma, M = diag(q, r), and [y; W y] on the right, which has to be free of rounding
    weights = sigma[_nodes(model)][None, :]
    diagonal = Matrix(sp.csr_array(sp.diags_array(left.values[0])))
    if all(isinstance(s.Y, Orthant) for s in model.stacks) and model.coupling.is_double:
        right = Matrix(sp.csr_array(sp.hstack([sp.eye_array(Q, format="csr"), model.WT], format="csr")))
    else:
        right = _exact_image(generators, model.coupling)
    return BilinearForms(Matrix(weights), diagonal, right)


def _exact_image(generators: Matrix, coupling: Matrix) -> Matrix:
    """Rows [y', (W y)'] in rational arithmetic."""
    Y, W = generators.dense(), coupling.dense()
    if Y.shape[0] * W.shape[0] * W.shape[1] > 10**7:
        raise UndecidedError(
            "weights sigma other than 1 with general output cones are proven up to 10^7 products only; scale the "
            "supply rates."
        )
    y, w = Y.fractions(), W.fractions()
    return Matrix.from_fractions(np.concatenate([y, y @ w.T], axis=1))


def supply_by_node(model: NetworkModel, q: Matrix, r: Matrix, y: Matrix) -> BilinearForms:
    """q_j'y_j + r_j'(W y)_j for every node j: forms (N, 1)."""
    Q, M = model.totals[2], model.totals[1]
    rates, places = after(q, r), (_nodes(model), np.arange(Q + M))
    if rates.is_double:
        left = Matrix(sp.csr_array((rates.values[0], places), shape=(model.n_nodes, Q + M)))
    else:
        table = np.zeros((model.n_nodes, Q + M), dtype=object)
        table[places] = rates.fractions()[0]
        left = Matrix.from_fractions(table)
    return BilinearForms(left, _sent_and_received(model), y[None])


def _sent_and_received(model: NetworkModel) -> Matrix:
    """[I; W]: y to y and W y."""
    return Matrix.join([Matrix.identity(model.totals[2], sparse=True), model.coupling], -2)


def _nodes(model: NetworkModel) -> Index:
    """Node number of every output, then of every input."""
    return np.concatenate([model.owners(2), model.owners(1)])


def balance(model: NetworkModel, q: Matrix, r: Matrix, sigma: Floats | None) -> Condition:
    """(III'), one inequality per node and generator of its output cone."""
    return Condition(BALANCE, balance_forms(model, q, r, sigma), "<=")


def loop_gain(model: NetworkModel, p: Matrix, t: Matrix) -> Iterator[Condition]:
    """p and t prove that the algebraic loop u = W D u contracts: rho(W D) < 1."""
    for g, (p_g, t_g) in enumerate(zip(model.split(p, 2), model.split(t, 1), strict=True)):
        s = model.stacks[g]
        yield Condition(titled(LOOP_WEIGHT, model, g), stacked(beside(p_g), None, s.rays[2]), ">")
        yield loop_direct(model, g, p_g, t_g)
    yield Condition(LOOP_COUPLING, balance_forms(model, -p, t, None), "<")


def motion(
    model: NetworkModel, x: Matrix, u: Matrix, y: Matrix, rate: float, heard: Heard = None
) -> Iterator[Condition]:
    """x in X with A_cl x - rate x in X, through u <= W y and y <= C x + D u in the orders of U and Y.

    In a shard u goes on with bounds on what the halo receives; see `received`.
    """
    xs, us, ys = (model.split(part, kind) for kind, part in enumerate((x, u, y)))
    for g, (s, x_g, u_g, y_g) in enumerate(zip(model.stacks, xs, us, ys, strict=True)):
        yield Condition(titled("h'x >= 0", model, g), stacked(facets(s.X), None, beside(x_g)), ">=")
        row = [x_g, u_g]
        middle = [s.A, s.B]
        if rate:
            row.append(x_g)
            middle.append(Matrix(-rate * np.eye(s.sizes[0])[None]))
        forms = stacked(facets(s.X), Joined(middle, -1), beside(*row))
        yield Condition(titled("h'(A x + B u - rate x) >= 0", model, g), forms, ">=")
        if s.sizes[2]:
            middle = Joined([s.C, s.D, Matrix(-np.eye(s.sizes[2])[None])], -1)
            forms = stacked(facets(s.Y), middle, beside(x_g, u_g, y_g))
            yield Condition(titled("h'(C x + D u - y) >= 0", model, g), forms, ">=")
    yield received(model, u, y, heard)


def emitted(model: NetworkModel, y: Matrix) -> list[Condition]:
    """y in Y: h'y >= 0 for every facet h of every Y_j."""
    parts = enumerate(zip(model.stacks, model.split(y, 2), strict=True))
    forms = [(g, stacked(facets(s.Y), None, beside(y_g))) for g, (s, y_g) in parts]
    return [Condition(titled("h'y >= 0", model, g), form, ">=") for g, form in forms]


def received(model: NetworkModel, u: Matrix, y: Matrix, heard: Heard = None) -> Condition:
    """h'(W y - u) >= 0 for every facet h of every U_j.

    In a shard u goes on with lower bounds z on what the halo receives from it; `heard` are such bounds of other shards
    on what they send here, one after the other, and the inputs that they go to.  They are added up in the forms, so
    that what an input receives is compared with all of them at once.
    """
    row, middle = [y, u], [model.coupling, -Matrix.identity(model.coupling.shape[0], sparse=True)]
    if heard is not None and heard[0].shape[0]:
        sent, to = heard
        row.append(sent)
        places, size = (to, np.arange(len(to))), (model.coupling.shape[0], len(to))
        middle.append(Matrix(sp.csr_array((np.ones(len(to)), places), shape=size)))
    forms = BilinearForms(after(*row), Matrix.join(middle, -1).T, input_facets(model))
    return Condition("h'(W y - u) >= 0", forms, ">=")
