"""An invariant cone for one matrix that holds given vectors and lies in given half-spaces.

Tried in this order: the orthant; chains through a vector in rational arithmetic (`chain`), first where orbits would
start along a boundary or where the dominant eigenvalue is repeated; orbits into a core (`orbit`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...exact.budget import require_seconds
from ...exact.matrix import Matrix
from ...proof.multipliers import Frame, nonnegative_combination
from ..certificate import ConeCertificate
from ..one_matrix.chain import rational_chains
from ..one_matrix.search import balanced, flatness
from ..one_matrix.split import Split, split
from ..reduction import extreme_generators
from .assembly import Assembly, Path, assemble
from .core import Core, core_inside
from .first_steps import first_steps, steps_on_boundary
from .orbit import Flow, flow, follow
from .outlook import outlook

Array = NDArray[np.float64]

# Generators are tested for redundancy up to this number, times the dimension; each test is a linear program.
_PRUNED = 1600
_SHRINK = (1.0, 0.2)
# The dynamics are followed with gaps reduced by this part of the smallest one.
_SLACK = (1e-3, 1e-4, 1e-5)
# Lengths of steps along a boundary, as parts of the longest sensible one.
_FIRST = (0.5, 0.1, 0.02, 0.004)


def find_with_ports(
    A: Matrix,
    vectors: Matrix,
    normals: Matrix,
    *,
    discrete: bool,
    max_rays: int | None,
    report: Callable[[str], None],
) -> tuple[ConeCertificate, Array | None, float]:
    """Certificate (PROVED or UNDECIDED), separators and conditioning.

    Parameters
    ----------
    vectors : Matrix, shape (k, n)
        To be held by the cone, such as the columns of B; k may be 0.
    normals : Matrix, shape (r, n)
        Half-spaces to lie in, such as the rows of C; r may be 0.
    """
    search = _Search(A, vectors, normals, discrete, max_rays)
    on_boundary = [steps_on_boundary(A, vectors[np.array([j])], normals) for j in range(vectors.shape[0])]
    s = split(search.matrix, discrete=discrete)
    attempts = [search.orthant(), search.orbits(s, on_boundary), search.chains()]
    if s is None or any(on_boundary):
        attempts[1:] = attempts[:0:-1]
    for certificate, separators in (found for attempt in attempts for found in attempt):
        rays = 0 if certificate.rays is None else certificate.rays.shape[0]
        report(f"a cone with {rays} rays: {'proved' if certificate else 'not proven'}")
        if certificate and certificate.rays is not None:
            return certificate, separators, flatness((np.asarray(certificate.rays.values) / search.units).T)
    return search.certificate(), None, np.inf


Found = Iterator[tuple[ConeCertificate, "Array | None"]]


class _Search:
    """The question, and several ways to answer it."""

    def __init__(self, A: Matrix, vectors: Matrix, normals: Matrix, discrete: bool, max_rays: int | None) -> None:
        self.A, self.vectors, self.normals, self.discrete = A, vectors, normals, discrete
        self.most = max_rays or 10**9
        self.matrix, self.units = balanced(A)
        self.b, self.c = np.asarray(vectors.values) / self.units, np.asarray(normals.values) * self.units

    def certificate(self, shares: Matrix | None = None, **proof: Matrix | Array) -> ConeCertificate:
        """The certificate with this proof."""
        return ConeCertificate.settle(
            matrices=Matrix.stack([self.A]),
            discrete=self.discrete,
            contains=self.vectors if self.vectors.shape[0] else None,
            shares=shares if self.vectors.shape[0] else None,
            within=self.normals if self.normals.shape[0] else None,
            **proof,
        )

    def orthant(self) -> Found:
        """The orthant, on which zeros of A, B and C are no trouble: P = A."""
        eye = np.eye(self.A.shape[0])
        if len(eye) <= self.most:
            yield (
                self.certificate(
                    shares=self.vectors,
                    rays=Matrix(eye),
                    multipliers=Matrix.stack([self.A]),
                    pointing=np.ones(len(eye)),
                    right_inverse=eye,
                ),
                1.0 - 2.0 * eye,
            )

    def chains(self) -> Found:
        """Simplicial cones in rational arithmetic."""
        if self.A.shape[0] > self.most:
            return
        for rays, P, shares in rational_chains(self.A, self.vectors, self.normals, discrete=self.discrete):
            values = np.asarray(rays.values)
            if np.linalg.matrix_rank(values / self.units) < len(values):
                continue
            inverse = np.linalg.inv((values / self.units).T) / self.units
            heights = inverse.sum(axis=0)
            certificate = self.certificate(
                shares=shares, rays=rays, multipliers=Matrix.stack([P]), pointing=heights, right_inverse=inverse
            )
            yield certificate, heights - 2.0 * inverse * (heights @ values.T).max()

    def orbits(self, s: Split | None, on_boundary: list[int]) -> Found:
        """Orbits of the vectors and a core."""
        if s is None:
            return
        if np.sign(self.c @ s.right).sum() + np.sign(self.b @ s.left).sum() < 0:
            s = s.turned()
        for paths, built in self._proposals(s, on_boundary):
            rays, P, separators, shares, support = self._exactly(built, paths, s)
            if rays.shape[0] > self.most:
                continue
            R = (np.asarray(rays.values) / self.units).T
            inverse = np.zeros(R.T.shape)
            inverse[support] = np.linalg.pinv(R[:, support])
            yield (
                self.certificate(
                    shares=shares,
                    rays=rays,
                    multipliers=P if P.is_sparse else Matrix.stack([P]),
                    pointing=s.left / self.units,
                    right_inverse=inverse / self.units,
                ),
                separators,
            )

    def _proposals(self, s: Split, on_boundary: list[int]) -> Iterator[tuple[list[Path], Assembly]]:
        """Paths of all vectors into a core, and what they make together, small ones first."""
        to_split = np.asarray(np.linalg.inv(s.basis).T, dtype=np.float64)
        c, b = self.c @ s.basis, self.b @ to_split
        if not ((c[:, 0] > 0).all() and (b[:, 0] > 0).all()):
            return
        for shrink in _SHRINK:
            core = core_inside(s, c, b, shrink, discrete=self.discrete)
            if core is None:
                return
            large: list[tuple[list[Path], Assembly]] = []
            for slack in _SLACK:
                require_seconds()
                f = flow(s, slack, discrete=self.discrete)
                paths = self._paths(f, c, core, to_split, on_boundary)
                if paths is None:
                    continue
                built = assemble(f, paths, core)
                if built.points.size <= _PRUNED:
                    yield paths, built
                else:
                    large.append((paths, built))
            yield from sorted(large, key=lambda found: len(found[1].points))

    def _paths(self, f: Flow, c: Array, core: Core, to_split: Array, on_boundary: list[int]) -> list[Path] | None:
        """A path into the core for every vector, or None."""
        lengths = np.array(_FIRST if any(on_boundary) else _FIRST[:1])
        if any(on_boundary) and not f.discrete:
            lengths = lengths * outlook(f.S, c).longest
        for length in lengths:
            paths: list[Path] = []
            for j, count in enumerate(on_boundary):
                vector = self.vectors[np.array([j])]
                first = first_steps(self.A, vector, count, float(length), f.dominant, discrete=f.discrete)
                head = (np.asarray(first.points.values) / self.units) @ to_split
                orbit = follow(f, head[-1], c, core)
                if orbit is None:
                    break
                paths.append(Path(np.concatenate([head[:-1], orbit.points]), first, orbit))
            if len(paths) == len(on_boundary):
                return paths
        return None

    def _exactly(
        self, built: Assembly, paths: list[Path], s: Split
    ) -> tuple[Matrix, Matrix, Array | None, Matrix, NDArray[np.intp]]:
        """Generators in the user's coordinates, the vectors themselves among them, none redundant.

        Returns
        -------
        rays, multipliers : Matrix
        separators : ndarray or None
        shares : Matrix
        support : ndarray of int
            Generators that take up rounding errors.
        """
        values = built.points @ s.basis.T
        rays, kept = self._rays(values, built, paths)
        index, separators = np.arange(len(values)), None
        P, shares = built.P, built.shares
        if values.size <= _PRUNED:
            index, separators = extreme_generators(values, s.left, kept)
            P, changed = _substituted(values, P, index, s.left)
            shares, separators = shares @ changed.T, separators / self.units
        R = values[index].T
        # What is known exactly stays: columns without residual, vectors that are generators themselves.
        column, own = built.exact[index], np.isin(built.starts, index)[:, None]
        unheld = np.where(own, 0.0, self.b - shares @ R.T)
        residual = np.where(column, 0.0, self.matrix @ R - (P.T @ R.T).T)
        support = built.support if sp.issparse(P) else np.arange(len(index))
        inverse = np.linalg.pinv(R[:, support])
        shares[:, support] += unheld @ inverse.T
        correction = inverse @ residual
        if sp.issparse(P):
            to = sp.csr_array(
                (np.ones(len(support)), (support, np.arange(len(support)))), shape=(len(index), len(support))
            )
            P = sp.csr_array(P + to @ sp.csr_array(correction))
        else:
            P = P + correction
        return rays[index], Matrix(P), separators, Matrix(shares), support

    def _rays(self, values: Array, built: Assembly, paths: list[Path]) -> tuple[Matrix, NDArray[np.bool_]]:
        """Exact generators, and which of them must stay because others are exact combinations of them."""
        rows, kept, at = [], np.zeros(len(values), dtype=bool), 0
        for path, row in zip(paths, built.starts, strict=True):
            if row < 0:
                continue
            known = path.first.points
            rows += [Matrix(values[at:row] * self.units), known]
            at = row + known.shape[0]
            kept[row:at] = path.count > 0
        return Matrix.join([*rows, Matrix(values[at:] * self.units)], -2), kept


def _substituted(values: Array, P: Array, index: NDArray[np.intp], pointing: Array) -> tuple[Array, Array]:
    """Multipliers after dropping generators that are combinations of the others, and these combinations.

    Returns
    -------
    P : ndarray, shape (p, p)
    shares : ndarray, shape (p, N)
        Every generator as a combination of the kept ones.
    """
    shares = np.zeros((len(index), len(values)))
    shares[np.arange(len(index)), index] = 1.0
    dropped = np.setdiff1d(np.arange(len(values)), index)
    frame = Frame.of(values[index], pointing) if dropped.size else None
    if frame is not None:
        for j in dropped:
            target = frame.to @ values[j]
            q, _ = nonnegative_combination(frame, target, size=float(np.abs(target).max()) or 1.0)
            shares[:, j] = np.maximum(q, 0.0) / frame.heights
    return shares @ P[:, index], shares
