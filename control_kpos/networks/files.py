"""Network certificates as files: one large system, in which the nodes stand beside each other.

A, B, C, D are block diagonal, X, U, Y products, in the order of the nodes, and W is the coupling.  A reader
needs no idea of nodes: v'x_i > 0, (v'A + rate v' - q'C) x_i <= 0, (v'B - r' - q'D) u_i <= 0 and q'y + r'W y <= 0
on the generators of the products are the conditions of Theorem 4, node by node and generator by generator.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..cones import Cone, Orthant, ProductCone, product
from ..errors import DataError
from ..exact.distinct import distinct
from ..exact.matrix import Matrix
from ..proof import weights as proofs
from ..proof.certificate import exactly
from ..proof.portable_cones import own_generators
from .blocks import take_blocks
from .model import BLOCKS, NetworkModel
from .nodes import NodeStack
from .own_links import own_links_closed
from .witnesses import (
    AlgebraicLoop,
    CouplingViolation,
    NetworkInstability,
    NodeNotDissipative,
    NodeViolation,
    NoWeights,
)

_KINDS = ("X", "U", "Y")
# The names that `describe` gives to the parts of a network.
NAMES = (*BLOCKS, *_KINDS, "W", "discrete", "dt", "sizes", "stack", "cones", "names", "own_links_closed")
_DENSE = 4 * 10**6
# What has to lie in a cone for each kind of witness.
_PLACED = {"growth": "xzWC", "loop": "yWC", "motion": "xzu", "weights": "y"}


def describe(model: NetworkModel) -> dict[str, Any]:
    """A network by the names its parts have in files."""
    if model.origin is not None:
        return {**describe(model.origin), "own_links_closed": True}
    labels = any(s.names for s in model.stacks)
    return {
        **{name: _side_by_side(model, name) for name in BLOCKS},
        **{name: product_cone(model, kind) for kind, name in enumerate(_KINDS)},
        "W": model.coupling,
        "discrete": model.discrete,
        "dt": model.dt,
        "sizes": np.diff(np.array(model.offsets), axis=1).T.astype(float),
        "stack": model.home[0].astype(float),
        "cones": tuple((s.X, s.U, s.Y) for s in model.stacks),
        "names": tuple(model.names) if labels else None,
    }


def rebuild(contents: dict[str, Any]) -> NetworkModel:
    """The inverse of `describe`.

    Raises
    ------
    DataError
        The parts do not fit together.
    """
    if "own_links_closed" in contents:
        if contents["own_links_closed"] is not True:
            raise DataError("own_links_closed is true where it stands.")
        closed = own_links_closed(rebuild({k: x for k, x in contents.items() if k != "own_links_closed"}))
        if closed is None:
            raise DataError("no node has a link to itself that could be closed.")
        return closed
    dt = contents.get("dt")
    if dt is not None and not (isinstance(dt, (bool, int, float)) and 0 <= dt < np.inf):
        raise DataError("dt is not a time base.")
    if any(
        not ((part >= 0) & (part < 2**31) & (part == np.round(part))).all()
        for part in (contents["sizes"], contents["stack"])
    ):
        raise DataError("sizes and stack are not whole numbers.")
    sizes, stack = contents["sizes"].astype(np.intp), contents["stack"].astype(np.intp)
    cones, names = contents["cones"], contents.get("names")
    if stack.ndim != 1 or sizes.shape != (len(stack), 3) or not np.array_equal(distinct(stack), np.arange(len(cones))):
        raise DataError("sizes and stack do not describe nodes.")
    named = isinstance(names, tuple) and len(names) == len(stack) and all(isinstance(name, str) for name in names)
    if names is not None and not named:
        raise DataError("names are text, one for every node.")
    offsets = np.concatenate([np.zeros((1, 3), dtype=np.intp), np.cumsum(sizes, axis=0)])
    members = [np.flatnonzero(stack == g) for g in range(len(cones))]
    stacks = []
    for index, (X, U, Y) in zip(members, cones, strict=True):
        if not (sizes[index] == (X.dim, U.dim, Y.dim)).all():
            raise DataError("the sizes of the nodes are not those of their cones.")
        places = [offsets[index, kind][:, None] + np.arange(C.dim) for kind, C in enumerate((X, U, Y))]
        a, b, c, d = (take_blocks(contents[name], places[i], places[j]) for name, (i, j) in BLOCKS.items())
        own = () if names is None else tuple(names[j] for j in index)
        stacks.append(NodeStack(a, b, c, d, X, U, Y, dt, own))
    model = NetworkModel(tuple(stacks), tuple(members), contents["W"], dt)
    if contents["W"].shape != model.totals[1:]:
        raise DataError("W has not the inputs and outputs of the nodes.")
    alike = all(_same_generators(product_cone(model, kind), contents[name]) for kind, name in enumerate(_KINDS))
    if not alike or model.discrete is not contents["discrete"] or not _same_blocks(model, contents):
        raise DataError("the nodes are not those of the large system.")
    return model


def _same_generators(X: Cone, Y: Cone) -> bool:
    """True if the generators of two products are the same vectors in the same order, as files have them."""
    known: dict[str, int] = {}

    def places(C: Cone) -> Any:
        parts, counts = (C.factors, C.counts) if isinstance(C, ProductCone) else ((C,), (1,))
        texts = {id(part): _text(part) for part in parts}
        repeats = [k * (part.dim if isinstance(part, Orthant) else 1) for part, k in zip(parts, counts, strict=True)]
        return np.repeat([known.setdefault(texts[id(part)], len(known)) for part in parts], repeats)

    return np.array_equal(places(X), places(Y))


def _text(factor: Cone) -> str:
    """The generators of a cone, or of the half-lines of an orthant."""
    return str([[Fraction(1)]] if isinstance(factor, Orthant) else own_generators(factor).fractions().tolist())


def product_cone(model: NetworkModel, kind: int) -> Cone:
    """The product of the state (kind 0), input (1) or output (2) cones in the order of the nodes."""
    cones = [(s.X, s.U, s.Y)[kind] for s in model.stacks]
    if len(cones) == 1:
        return product([cones[0]] * model.n_nodes)
    return product([cones[g] for g in model.home[0]])


def _side_by_side(model: NetworkModel, name: str) -> Matrix:
    """The block-diagonal matrix of all nodes, sparse; dense if the data are fractions."""
    rows, columns = BLOCKS[name]
    stacks = [getattr(s, name) for s in model.stacks]
    if all(m.is_double for m in stacks):
        return Matrix(model.blocks([m.values for m in stacks], rows, columns))
    shape = model.totals[rows], model.totals[columns]
    if shape[0] * shape[1] > _DENSE:
        raise DataError("networks given in decimals or fractions are written up to moderate size only.")
    out = np.full(shape, Fraction(0), dtype=object)
    for m, place in zip(stacks, model.places, strict=True):
        out[place[rows][:, :, None], place[columns][:, None, :]] = m.fractions()
    return Matrix.from_fractions(out)


def _same_blocks(model: NetworkModel, contents: dict[str, Any]) -> bool:
    """True if the matrices have no entries outside the blocks of the nodes."""
    for name in BLOCKS:
        given, blocks = contents[name], _side_by_side(model, name)
        if given.shape != blocks.shape or _count(given) != _count(blocks):
            return False
    return True


def _count(m: Matrix) -> int:
    if m.is_sparse:
        return int(sp.csr_array(m.values).count_nonzero())
    return int(np.count_nonzero(m.values if m.numerators is None else m.numerators))


def evidence(model: NetworkModel, witness: Any) -> dict[str, Any]:
    """What a checker needs besides `describe`: weights of vectors in cones, or the normal that is crossed."""
    cones = {name: product_cone(model, kind) for kind, name in enumerate(_KINDS)}
    if isinstance(witness, (CouplingViolation, NodeViolation)):
        return _crossed(model, witness)
    X, U, Y = (cones[name] for name in _KINDS)
    prover, M, out = proofs.Prover(), _Products(model), dict[str, Any]()
    for key, target, name, source in (
        ("P", X, "A", X),
        ("N", X, "B", U),
        ("L", Y, "C", X),
        ("K", Y, "D", U),
        ("M", U, "W", Y),
    ):
        if not target.is_simplicial:  # there, weights follow
            out[key] = prover.inclusion(target, M[name], source, invariance=key == "P" and not model.discrete)
    if witness is not None:
        shows, x, u, y, rate = _motion(model, witness)
        places = {
            "x": (X, lambda: x),
            "z": (X, lambda: M.times("A", x) + M.times("B", u) - rate * x),
            "u": (U, lambda: u),
            "y": (Y, lambda: y),
            "W": (U, lambda: M.times("W", y) - u),
            "C": (Y, lambda: M.times("C", x) + M.times("D", u) - y),
        }
        for name in _PLACED[shows]:
            target, vector = places[name]
            out[f"w{name}"] = None if target.is_simplicial else prover.vector(target, vector())
    return out


def _crossed(model: NetworkModel, witness: CouplingViolation | NodeViolation) -> dict[str, Any]:
    """The normal in the large system."""
    if isinstance(witness, CouplingViolation):
        node, kind, facet = witness.target, 1, witness.facet
    else:
        broken = witness.violation
        node, kind, facet = witness.node, 0 if broken.condition[0] in "AB" else 2, broken.facet
    s = model.stacks[model.locate(node)[0]]
    crossed = None if product_cone(model, kind).is_simplicial else (s.X, s.U, s.Y)[kind]
    return proofs.crossed_facet(crossed, facet, int(model.offsets[kind][node]), model.totals[kind])


class _Products(dict[str, Matrix]):
    """The matrices of the large system, made when they are asked for."""

    def __init__(self, model: NetworkModel) -> None:
        super().__init__(W=model.coupling)
        self.model = model

    def __missing__(self, name: str) -> Matrix:
        try:
            self[name] = _side_by_side(self.model, name)
        except DataError as reason:
            raise proofs.ProofOmittedError(str(reason)) from None
        return self[name]

    def times(self, name: str, x: Any) -> Any:
        """A x, B u, C x, D u or W y in fractions."""
        return proofs.product(self[name], x)


def moved(model: NetworkModel, x: Any, u: Any, y: Any, w: Any) -> tuple[Any, Any, Any]:
    """A x + B u + w, with A - I for A in discrete time, C x + D u - y and W y - u, in fractions."""
    M = _Products(model)
    ahead = M.times("A", x) + M.times("B", u) + w - int(model.discrete) * x
    return ahead, M.times("C", x) + M.times("D", u) - y, M.times("W", y) - u


def _motion(model: NetworkModel, witness: Any) -> tuple[str, Any, Any, Any, Fraction]:
    """What a witness shows, with x, u, y and the rate of the large system in which it shows it."""
    x, u, y = (np.full(total, Fraction(0), dtype=object) for total in model.totals)
    rate = Fraction(int(model.discrete))
    if isinstance(witness, NetworkInstability):
        x, u, y = (part.fractions() for part in witness.vectors)
        return "growth", x, u, y, Fraction(witness.rate)
    if isinstance(witness, AlgebraicLoop):
        y, u = (part.fractions() for part in witness.vectors)
        return "loop", x, u, y, rate
    if isinstance(witness, NoWeights):
        return "weights", x, u, exactly(witness, "y").fractions(), rate
    if isinstance(witness, NodeNotDissipative):
        for whole, kind, name in ((x, 0, "x"), (u, 1, "u")):
            first, own = int(model.offsets[kind][witness.node]), exactly(witness.violation, name).fractions()
            whole[first : first + len(own)] = own
        return "motion", x, u, y, rate
    raise proofs.ProofOmittedError(f"{type(witness).__name__} is for control_kpos alone")
