"""A cone around the dominant direction inside given half-spaces, with multipliers in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .explicit import modal_cone
from .modes import Modes

Array = NDArray[np.float64]

# Polygons are not made larger than this multiple of the dominant direction.
_LARGEST = 1e3


@dataclass(frozen=True, eq=False)
class Core:
    """The free sum of one polygon for each mode: generators e + V w, in modal coordinates (1, y).

    Attributes
    ----------
    points : ndarray, shape (N, n)
        Generators, first coordinate 1.
    P : ndarray, shape (N, N)
        Multipliers, positive off the diagonal (discrete time: everywhere).
    weights : ndarray, shape (N,)
        e as a combination of the generators.
    blocks : list of (rows, coordinates, functionals)
        For each mode: which generators and which coordinates are its own, and functionals whose
        maximum is the gauge of its polygon, one for each edge.
    """

    points: Array
    P: Array
    weights: Array
    blocks: list[tuple[slice, slice, Array]]

    def holds(self, y: Array) -> NDArray[np.bool_]:
        """Which rows are inside."""
        total = np.zeros(len(y))
        for _, at, functionals in self.blocks:
            total += (y[:, at] @ functionals.T).max(axis=1)
        return total <= y[:, 0] * (1 - 1e-9)

    def combination(self, y: Array) -> Array:
        """A point inside as a positive combination of the generators."""
        out = np.zeros(len(self.points))
        used = 0.0
        for rows, at, functionals in self.blocks:
            values = functionals @ y[at]
            edge = int(np.argmax(values))
            corners = self.points[rows, at]
            if corners.shape[1] == 1:
                out[rows][edge] += values[edge]
            else:
                ends = [edge, (edge + 1) % len(corners)]
                out[rows][ends] += np.linalg.solve(corners[ends].T, y[at])
            used += float(values[edge])
        return out + (y[0] - used) * self.weights


def core_inside(m: Modes, normals: Array, shrink: float, *, discrete: bool) -> Core | None:
    """The largest free sum of polygons inside {x : normals x >= 0}, times `shrink`.

    Parameters
    ----------
    normals : ndarray, shape (r, n)
        In modal coordinates, positive on the dominant direction.
    """
    n = len(m.right)
    rows: list[Array] = []
    blocks: list[tuple[slice, slice, Array]] = []
    parts: list[Array] = []
    start, count = 1, 0
    for value, V in zip(m.others, m.bases, strict=True):
        size = V.shape[1]
        eye = np.eye(1 + size)
        alone = Modes(m.dominant, eye[0], eye[0], np.array([value]), [eye[:, 1:]], 1.0)
        found = modal_cone(alone, discrete=discrete)
        if found is None or found.P is None:
            return None
        corners = (found.R[1:] / found.R[0]).T
        at = slice(start, start + size)
        reach = -(normals[:, at] @ corners.T)
        room = np.broadcast_to(normals[:, :1], reach.shape)
        limit = np.divide(room, reach, out=np.full_like(reach, np.inf), where=reach > 0).min(initial=np.inf)
        corners = corners * (shrink * min(float(limit), _LARGEST))
        points = np.zeros((len(corners), n))
        points[:, 0], points[:, at] = 1.0, corners
        rows.append(points)
        parts.append(found.P)
        blocks.append((slice(count, count + len(corners)), at, _gauge(corners)))
        start, count = start + size, count + len(corners)
    if not rows:
        return Core(np.eye(1), np.array([[m.dominant]]), np.ones(1), [])
    weights = np.concatenate([np.full(len(p), 1 / (len(p) * len(rows))) for p in rows])
    return Core(np.concatenate(rows), _coupled(parts, weights), weights, blocks)


def _coupled(parts: list[Array], weights: Array) -> Array:
    """Block-diagonal multipliers with a part of e moved from each block to all generators."""
    out = np.zeros((len(weights), len(weights)))
    start = 0
    for P in parts:
        size = len(P)
        free = P + np.diag(np.full(size, np.inf))
        part = 0.5 * float(free.min()) * size
        at = slice(start, start + size)
        out[at, at] = P - part / size
        out[:, at] += part * weights[:, None]
        start += size
    return out


def _gauge(corners: Array) -> Array:
    """Functionals with maximum 1 on the boundary of a segment, or of a polygon with corners in order."""
    if corners.shape[1] == 1:
        return 1 / corners
    edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    return np.asarray(np.linalg.solve(edges, np.ones((len(edges), 2, 1)))[:, :, 0], dtype=np.float64)
