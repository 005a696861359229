"""Blocks of uncertainty u_b = Delta_b y_b: which inputs and which outputs belong together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError, ShapeError
from ..exact.intake import found, items, whole_number

Index = NDArray[np.intp]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Blocks:
    """The block of every input and of every output.

    Attributes
    ----------
    inputs, outputs : ndarray of int, shapes (m,) and (q,)
        Blocks are counted from 0; each has an input and an output.
    """

    inputs: Index
    outputs: Index

    @classmethod
    def read(cls, structure: Any, m: int, q: int) -> Blocks:
        """The blocks that an argument `structure` describes.

        Parameters
        ----------
        structure : "full", "diagonal" or None, list of sizes, or list of (inputs, outputs)
            See `control_kpos.robust_margin`.
        m, q : int
            Numbers of inputs and outputs.

        Raises
        ------
        DataError, ShapeError
        """
        if m == 0 or q == 0:
            raise ShapeError(f"sys has {m} inputs and {q} outputs, and no gain; it must have some of both.")
        if isinstance(structure, str) and structure == "full":
            return cls(np.zeros(m, dtype=np.intp), np.zeros(q, dtype=np.intp))
        if structure is None or (isinstance(structure, str) and structure == "diagonal"):
            _require_square(m, q, "diagonal")
            return cls(np.arange(m), np.arange(q))
        if isinstance(structure, str):
            raise DataError(
                f"structure is {found(structure)}; give 'diagonal', 'full', a list of block sizes, or a list of pairs "
                "(inputs, outputs) of lists of places."
            )
        listed = items(structure, "structure")
        are_sizes = all(isinstance(block, (int, np.integer)) for block in listed)
        return _of_sizes(listed, m, q) if are_sizes else _of_pairs(listed, m, q)

    @property
    def count(self) -> int:
        """The number of blocks."""
        return int(self.inputs.max()) + 1

    @property
    def is_diagonal(self) -> bool:
        """True if every block has one input and one output."""
        return is_diagonal(self.inputs.tolist(), self.outputs.tolist())

    @property
    def partner(self) -> Index:
        """The output in the block of every input, if they are single."""
        return np.argsort(self.outputs)[self.inputs]

    def square(self, G: Floats) -> Floats:
        """A gain from inputs to the outputs in their blocks, if they are single."""
        return G[self.partner]

    def quotient(self, y: Floats, a: Floats) -> float:
        """The least |y_b| / |a_b| of the blocks in which a is not zero; NaN if there is none."""
        top = max(float(y.max(initial=0.0)), np.finfo(float).tiny), max(float(a.max(initial=0.0)), np.finfo(float).tiny)
        out, into = (
            np.sqrt(np.bincount(members, (x / unit) ** 2, self.count))
            for members, x, unit in zip((self.outputs, self.inputs), (y, a), top, strict=True)
        )
        used = into > 0
        return float((out[used] / into[used]).min() * (top[0] / top[1])) if used.any() else float("nan")

    def worst(self, y: Floats, a: Floats) -> Floats:
        """Delta >= 0 with a gain |a_b| / |y_b| in each block and Delta y = a, shape (m, q)."""
        tops, sizes = np.zeros(self.count), np.zeros(self.count)
        np.maximum.at(tops, self.outputs, y)
        shares = _over(y, tops[self.outputs])  # no squares of large or small numbers
        np.add.at(sizes, self.outputs, shares**2)
        gains = _over(_over(a, tops[self.inputs]), sizes[self.inputs])
        return np.where(self.inputs[:, None] == self.outputs, gains[:, None] * shares, 0.0)


def _over(x: Floats, y: Floats) -> Floats:
    """x / y, and 0 where y is 0."""
    return np.divide(x, y, out=np.zeros_like(x), where=y > 0)


def is_diagonal(inputs: Sequence[int], outputs: Sequence[int]) -> bool:
    """True if every block has one input and one output."""
    return len(set(inputs)) == len(inputs) == len(outputs) == len(set(outputs))


def _require_square(m: int, q: int, what: str) -> None:
    if m != q:
        raise ShapeError(
            f"structure is {what!r}, but the system has {m} inputs and {q} outputs; it must have as many of both. Say "
            "structure='full', or which inputs and outputs belong together: [(inputs, outputs), ...]."
        )


def _of_sizes(sizes: list[Any], m: int, q: int) -> Blocks:
    counts = [whole_number(size, "structure", least=1, most=m) for size in sizes]
    _require_square(m, q, "a list of block sizes")
    if sum(counts) != m:
        raise ShapeError(f"structure has blocks of {sum(counts)} signals in all, but the system has {m} inputs.")
    members = np.repeat(np.arange(len(counts)), counts)
    return Blocks(members, members)


def _of_pairs(pairs: list[Any], m: int, q: int) -> Blocks:
    members = [np.full(m, -1, dtype=np.intp), np.full(q, -1, dtype=np.intp)]
    for b, pair in enumerate(pairs):
        sides = items(pair, f"structure[{b}]")
        if len(sides) != 2:
            raise ShapeError(f"structure[{b}] has {len(sides)} entries instead of the two lists (inputs, outputs).")
        for kind, (name, side) in enumerate(zip(("inputs", "outputs"), sides, strict=True)):
            _enter(members[kind], b, items(side, f"structure[{b}], {name}"), name)
    for name, blocks in zip(("input", "output"), members, strict=True):
        if (blocks < 0).any():
            raise DataError(f"structure leaves out {name} {int(np.argmin(blocks))}; every one belongs to one block.")
    return Blocks(*members)


def _enter(members: Index, b: int, side: list[Any], name: str) -> None:
    if not side:
        raise DataError(f"structure[{b}] has no {name}; every block has some.")
    for k in side:
        place = whole_number(k, f"structure[{b}], {name}", least=0, most=len(members) - 1)
        if members[place] >= 0:
            raise DataError(f"structure has {name[:-1]} {place} in the blocks {members[place]} and {b}, or twice.")
        members[place] = b
