"""Gains of local observers on simplicial cones, by one sparse linear program.

As in `program`, in generator coordinates R_j of every node: for eta > 0 with eta'M + c' <= 0, M the network of the
nodes A_j + L_j C_j, the sum of the final widths is at most eta'g, and with Z_j = diag(eta_j) R_j^{-1} L_j

    minimise    sum_k eta_k |R^{-1}_k|'(w_hi - w_lo) + 2 |Z_k|'noise
    subject to  diag(eta_j) R_j^{-1} A_j R_j + Z_j C_j R_j >= 0 off the diagonal (discrete time: everywhere),
                eta'R^{-1}(A + B W C) R + sum_k Z_k C R + c' <= 0    (discrete time: - eta' besides).

Z_j has entries for outputs that are measured only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..design.plant import Floats
from ..design.running import Programs
from ..exact.program import Block, Program
from ..networks.blocks import Index
from ..networks.model import NetworkModel
from .program import FASTEST

# From this many variables on, the interior point method without crossover is faster than the simplex method.
_LARGE = 4000


class MeasuredNetwork(NamedTuple):
    """A network in doubles, with its bounds.

    Attributes
    ----------
    model : NetworkModel
        Simplicial state cones, D = 0.
    disturbance, noise : ndarray, shapes (n,) and (sum q_k,)
        w_hi - w_lo, and the noise that is counted.
    measured : ndarray of bool, shape (sum q_k,)
    """

    model: NetworkModel
    disturbance: Floats
    noise: Floats
    measured: NDArray[np.bool_]


class _Node(NamedTuple):
    """The nodes of a stack in generator coordinates, and the places of their states, and of Z (-1 where it is 0)."""

    own: Floats
    inputs: Floats
    outputs: Floats
    states: Index
    gains: Index
    rays: Floats
    weights: Floats


def local_gains(plant: MeasuredNetwork, kept: float, lp: Programs) -> list[Floats] | None:
    """L of the smallest sum of the final widths, (N, n, q) for every stack; None without a solution.

    Parameters
    ----------
    plant : MeasuredNetwork
    kept : float
        Part of the size of A that entries off the diagonal keep from 0.
    lp : Programs
    """
    model = plant.model
    nodes, owner, output = _coordinates(plant)
    n, z = model.totals[0], len(owner)
    counted = model.join([np.tile(np.abs(s.rays).sum(axis=0), (len(s.own), 1)) for s in nodes], 0)
    scale = model.join([np.tile(np.abs(s.own).max(axis=(1, 2))[:, None], (1, s.own.shape[1])) for s in nodes], 0)
    least = counted / (FASTEST * np.where(scale > 0, scale, 1.0))
    program = Program(
        eta=Block(n, low=least, cost=_costs(plant, nodes)),
        more=Block(z, low=0.0, cost=2 * plant.noise[output]),
        less=Block(z, low=0.0, cost=2 * plant.noise[output]),
    )
    for s in nodes:
        _keep(program, s, kept, model.discrete, (n, z))
    _fall(program, model, nodes, counted, z)
    answer = program.solve(lp, method="ipm") if n + 2 * z > _LARGE else program.solve(lp)
    if not answer or answer["eta"].min() <= 0:  # solvers have broken bounds
        return None
    Z, eta = np.append(answer["more"] - answer["less"], 0.0), answer["eta"]
    return [s.rays @ (Z[s.gains] / eta[s.states][:, :, None]) for s in nodes]


def _coordinates(plant: MeasuredNetwork) -> tuple[list[_Node], Index, Index]:
    """The stacks, and the state and the output of every entry of Z."""
    nodes, count, owner, output = list[_Node](), 0, list[Index](), list[Index]()
    for s, (states, _, outputs) in zip(plant.model.stacks, plant.model.places, strict=True):
        R = np.asarray(s.X.rays, dtype=float).T
        weights = np.linalg.inv(R)
        A, B, C = (np.asarray(M.values, dtype=float) for M in (s.A, s.B, s.C))
        allowed = np.broadcast_to(plant.measured[outputs][:, None, :], (len(s), len(R), outputs.shape[1]))
        gains = np.full(allowed.shape, -1, dtype=np.intp)
        gains[allowed] = count + np.arange(np.count_nonzero(allowed))
        count += np.count_nonzero(allowed)
        owner.append(np.broadcast_to(states[:, :, None], allowed.shape)[allowed])
        output.append(np.broadcast_to(outputs[:, None, :], allowed.shape)[allowed])
        nodes.append(_Node(weights @ A @ R, weights @ B, C @ R, states, gains, R, weights))
    return nodes, np.concatenate(owner), np.concatenate(output)


def _costs(plant: MeasuredNetwork, nodes: list[_Node]) -> Floats:
    parts = zip(nodes, plant.model.split(plant.disturbance, 0), strict=True)
    return plant.model.join([part @ np.abs(s.weights).T for s, part in parts], 0)


def _keep(program: Program, s: _Node, kept: float, discrete: bool, sizes: tuple[int, int]) -> None:
    """Rows of M >= 0 off the diagonal."""
    N, n, _ = s.gains.shape
    k, j = np.nonzero(np.ones((n, n), dtype=bool) if discrete else ~np.eye(n, dtype=bool))
    if not k.size:
        return
    rows = np.arange(N * len(k)).reshape(N, len(k))
    # C of the output i at the generator j, where the output is measured
    through = s.outputs[:, :, j].transpose(0, 2, 1) * (s.gains[:, k] >= 0)
    scale = kept * np.abs(s.own).max(axis=(1, 2))[:, None] * through.any(axis=2)
    own, total = s.own[:, k, j] - scale, int(rows.size)
    eta = sp.csr_array((own.ravel(), (rows.ravel(), s.states[:, k].ravel())), shape=(total, sizes[0]))
    Z = _at(through, np.broadcast_to(rows[:, :, None], through.shape), s.gains[:, k], (total, sizes[1]))
    program.above(0.0, eta=eta, more=Z, less=-Z)


def _fall(program: Program, model: NetworkModel, nodes: list[_Node], counted: Floats, z: int) -> None:
    """Rows of eta'M + c' <= 0."""
    n = model.totals[0]
    own, B, C = (
        model.blocks([getattr(s, name) for s in nodes], rows, columns)
        for name, rows, columns in (("own", 0, 0), ("inputs", 0, 1), ("outputs", 2, 0))
    )
    M = own + B @ model.W @ C - model.discrete * sp.eye_array(n, format="csr")
    Z = sp.csr_array((n, z))
    for s in nodes:
        shape = (*s.gains.shape, s.gains.shape[1])  # node, state k of Z, output, generator
        values = np.broadcast_to(s.outputs[:, None], shape)
        rows = np.broadcast_to(s.states[:, None, None, :], shape)
        Z = Z + _at(values, rows, np.broadcast_to(s.gains[..., None], shape), (n, z))
    program.below(-counted, eta=sp.csr_array(M.T), more=Z, less=-Z)


def _at(values: Floats, rows: Index, columns: Index, shape: tuple[int, int]) -> sp.csr_array:
    """A sparse matrix of these entries, without those of columns -1."""
    known = columns >= 0
    return sp.csr_array((values[known], (rows[known], columns[known])), shape=shape)
