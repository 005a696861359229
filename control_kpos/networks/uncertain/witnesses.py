"""Witnesses against a network that is known within sets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...proof.certificate import Vector
from ...proof.encoding import register_record
from ..blocks import Index
from ..witnesses import NodeViolation


@register_record
@dataclass(frozen=True, eq=False)
class FailingMember:
    """A choice of vertices for which the network fails: one vertex of every node, as it is.

    Attributes
    ----------
    choice : ndarray, shape (N,)
        The vertex of every node, counted from 0.
    witness : NodeViolation, NetworkInstability or AlgebraicLoop
        What breaks this member.
    signs : ndarray, shape (N,), or None
        With ranges that change sign: 1 or -1 for every node.  A link between nodes of one sign is at its upper end, one
        between nodes of two signs at its lower end, and the witness is in the coordinates s_j x_j, u_j, y_j.
    """

    choice: NDArray[np.float64]
    witness: Any
    signs: NDArray[np.float64] | None = None

    @property
    def vertices(self) -> Index:
        """The choice as whole numbers."""
        return np.asarray(self.choice).astype(np.intp)

    @property
    def rate(self) -> float:
        """The rate at which this member grows at least; NaN if that is not what breaks it."""
        return getattr(self.witness, "rate", float("nan"))

    def __str__(self) -> str:
        if isinstance(self.witness, NodeViolation):
            return f"at its vertex {self.vertices[self.witness.node]} {self.witness}"
        if self.signs is not None:
            turned = int((np.asarray(self.signs) < 0).sum())
            signs = f", and the signs of all signals turned at {turned} nodes" if turned else ""
            return f"with every link at an end of its range{signs}, {self.witness}"
        return f"with one vertex for every node, {self.witness}"


@register_record
@dataclass(frozen=True, eq=False)
class FailingEnd:
    """The network at the lower ends of its ranges is not positive.

    Attributes
    ----------
    witness : NodeViolation or CouplingViolation
    """

    witness: Any

    def __str__(self) -> str:
        return f"at the lower ends of the ranges, {self.witness}"


@register_record
@dataclass(frozen=True, eq=False)
class NoCommonStorage:
    """Generators of one node that take different vertices, and do not decay: no common v, r, q of Theorem 4 exist.

    Or, with x = 0, outputs that an algebraic loop of such a mixture sustains: no common p, t exist.

    Attributes
    ----------
    x, u : ndarray, shapes (S sum n_j,), (S sum m_j,)
        x^s in X and u^s in U, one vertex after the other.
    y : ndarray, shape (sum q_k,)
        Bounds of the outputs.
    """

    x: Vector = Vector(required=True)
    u: Vector = Vector(required=True)
    y: Vector = Vector(required=True)

    def __str__(self) -> str:
        if not np.any(self.x):
            return "no vectors p, t show that algebraic loops contract at all vertices: those of a mixture do not"
        return (
            "no vectors v, r, q satisfy Theorem 4 at all vertices, with algebraic loops that contract: parts of a "
            "state that take different vertices do not decay"
        )


@register_record
@dataclass(frozen=True, eq=False)
class NoCommonVectors:
    """Neither common v, r, q of Theorem 4 exist, nor common e, u, y: see `BoundedNetworkCertificate`.

    Attributes
    ----------
    storage : NoCommonStorage
        What excludes v, r, q.
    bound : NoCommonStorage
        The same for the transposed network, which excludes e, u, y.
    """

    storage: NoCommonStorage
    bound: NoCommonStorage

    def __str__(self) -> str:
        loops = " for algebraic loops" if not np.any(self.bound.x) else ""
        return f"{self.storage}; and no vectors e, u, y{loops} bound the network at all vertices"
