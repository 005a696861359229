"""Differential positivity and contraction of a nonlinear network: enclosed, proposed, settled."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ..errors import DataError, ShapeError
from ..exact.intake import exact_matrix, vector
from ..exact.matrix import Matrix
from ..exact.unreadable import UnboundedError
from ..proof.certificate import Status
from .contraction import DifferentialNetworkCertificate, OrderViolation
from .enclosed import (
    Blocks,
    Care,
    Coordinates,
    between,
    block_matrix,
    boxes,
    enclose,
    least_in_ranges,
    own_shares,
    taken_off,
)
from .network import NonlinearNetwork
from .nodes import is_orthant
from .steady import rates_at, require_agreement, steady
from .weights import ROOM, contractions, own_output

Array = NDArray[np.float64]

# Boxes of all nodes together, times states, up to which boxes are cut where that may help.
_MOST_BOXES = 2 * 10**6
# Corners of the region that are looked at for a violation, besides the middle and the two of the order.
_CORNERS, _INSIDE = 8, 1e-6
# Where between the ends of the region functions are compared with their enclosures.
_BETWEEN = 0.3, 0.7
# At an equilibrium rates are no larger than this, relative to states and rates nearby.
_AT_REST = 1e-6


@np.errstate(all="ignore")
def certify_network(
    net: NonlinearNetwork,
    region: ArrayLike | None,
    inputs: ArrayLike | None,
    equilibrium: ArrayLike | None,
    pieces: int,
) -> DifferentialNetworkCertificate:
    """Decide whether a nonlinear network keeps the order of its cones on a region, and whether it contracts there.

    Costs one enclosure of all Jacobians, two or three solves as for the certificate of one linear network, and the
    proof, which is linear in the data.
    """
    n, m, _ = net.totals
    if region is None:
        raise DataError(f"region is missing: give the lower and upper end of each of {n} states, shape ({n}, 2).")
    low, high = ends_of(region, n, "region", exact=not all(is_orthant(kind.X) for kind in net.kinds))
    w_low, w_high = (np.zeros(m), np.zeros(m)) if inputs is None else ends_of(inputs, m, "inputs")
    if (w_low > w_high).any():
        row = int(np.argmax(w_low > w_high))
        raise DataError(f"inputs[{row}] is [{w_low[row]}, {w_high[row]}]: the lower end exceeds the upper one.")
    if equilibrium is not None:
        _require_inside(net, vector(equilibrium, "equilibrium", n), low, high, 0.5 * w_low + 0.5 * w_high)
    try:
        return _decided(net, (low, high), (w_low, w_high), pieces)
    except UnboundedError as error:
        raise DataError(f"region: {error} on the region; choose a smaller region, or smaller inputs.") from None


def _decided(
    net: NonlinearNetwork, region: tuple[Array, Array], inputs: tuple[Array, Array], pieces: int
) -> DifferentialNetworkCertificate:
    """The certificate on a region, with more care if the first enclosure does not show contraction."""
    net, states = steady(net), boxes(net, *region)
    rng = np.random.default_rng(0)  # at a middle, which is often zero, functions that differ may agree
    x = between(net, *region, rng.uniform(*_BETWEEN, len(region[0])))
    w = inputs[0] + rng.uniform(*_BETWEEN, len(inputs[0])) * (inputs[1] - inputs[0])
    require_agreement(net, x, w, _at(net, x, w))
    corners = _corners(net, region, inputs)
    most = min(pieces, max(1, _MOST_BOXES // net.totals[0]))
    blocks = enclose(net, states, inputs)
    found = _settled(net, blocks, corners)
    for care in dict.fromkeys((Care(growth=True), Care(most, growth=True))):
        if found.contracts:
            break
        blocks = enclose(net, states, inputs, care=care)
        found = _settled(net, blocks, corners)
    if found.status is Status.PROVED:
        return found
    refuted = _refuted(net, _ends(net, blocks), region, inputs)
    return found if refuted is None else refuted


def _settled(net: NonlinearNetwork, blocks: Blocks, corners: dict[str, Any]) -> DifferentialNetworkCertificate:
    """The certificate for these ends, with vectors that prove contraction if there are any."""
    data = _ends(net, blocks)
    if any((M.values.data < 0).any() for M in data["lower"][1:]):
        return DifferentialNetworkCertificate.settle(**data)
    for vectors in contractions(net, blocks, data):
        found = DifferentialNetworkCertificate.settle(**data, **corners, **vectors)
        if found:
            return found
    return DifferentialNetworkCertificate.settle(**data, **corners)


def ends_of(data: ArrayLike, n: int, name: str, *, exact: bool = False) -> tuple[Array, Array]:
    """Lower and upper ends of n quantities, each the next double outwards of what was given."""
    given = exact_matrix(data, name)
    if given.shape not in ((n, 2), (1, 2)):
        raise ShapeError(
            f"{name} has shape {given.shape}, but must be ({n}, 2): lower and upper end of each of {n}; or (1, 2) for "
            "all alike."
        )
    if exact and not given.is_double:
        raise DataError(f"{name} holds numbers that are no doubles, which cannot be rounded in the order of the cones.")
    low, high = given.rounded(up=False)[:, 0], given.rounded(up=True)[:, 1]
    return np.array(np.broadcast_to(low, n)), np.array(np.broadcast_to(high, n))


def _require_inside(net: NonlinearNetwork, x: Array, low: Array, high: Array, w: Array) -> None:
    """Refuse an equilibrium outside of the region, or a point that is none."""
    parts = zip(net.kinds, *(net.model.split(part, 0) for part in (x, low, high)), net.model.members, strict=True)
    for kind, x_k, a, b, members in parts:
        T = Coordinates.of(kind)
        if T is not None:
            x_k, a, b = (part @ T.inverse[0].T for part in (x_k, a, b))
        outside = (x_k < a) | (x_k > b)
        if outside.any():
            row, i = (int(k) for k in np.argwhere(outside)[0])
            raise DataError(
                f"equilibrium: {net.model.name_of(int(members[row]))} has {x_k[row, i]:.6g} as its "
                f"coordinate {i}, which is outside of the region, [{a[row, i]:.6g}, {b[row, i]:.6g}]. Extend the "
                "region, or look for an equilibrium inside of it."
            )
    if net.is_ranged:
        return
    rates = rates_at(net, x, w)
    size = 1 + np.abs(x).max(initial=0.0) + np.abs(rates_at(net, high, w)).max(initial=0.0)
    if not np.abs(rates).max(initial=0.0) <= _AT_REST * size:
        i = int(np.argmax(np.abs(rates)))
        raise DataError(f"equilibrium: state {i} still changes at the rate {rates[i]:.6g}; give a point at rest.")


def _at(net: NonlinearNetwork, x: Array, w: Array, *, slopes: bool = False) -> Blocks:
    """The rates at one state of the network, and the slopes there."""
    return enclose(net, [(part, part) for part in net.model.split(x, 0)], (w, w), slopes=slopes)


def _ends(net: NonlinearNetwork, blocks: Blocks) -> dict[str, Any]:
    """Both ends as block diagonal matrices, and the own outputs."""
    ends = []
    for side in (0, 1):
        nodes = [
            block_matrix(net.model, getattr(blocks, name), side, *kinds)
            for name, kinds in (("A", (0, 0)), ("B", (0, 1)), ("C", (2, 0)))
        ]
        ends.append(tuple(Matrix(M) for M in (*nodes, _without_zeros(blocks.W[side]), _without_zeros(blocks.S[side]))))
    return {"upper": ends[1], "lower": ends[0], "own": own_output(net).astype(float)}


def _without_zeros(M: sp.csr_array) -> sp.csr_array:
    out = M.copy()
    out.eliminate_zeros()
    return out


def _corners(net: NonlinearNetwork, region: tuple[Array, Array], inputs: tuple[Array, Array]) -> dict[str, Any]:
    """Bounds of the rates at the corners of the region, if they point into it."""
    ends = [_at(net, x, w).rates for x, w in zip(region, inputs, strict=True)]
    lower = net.model.join([rates[0] for rates in ends[0]], 0)
    upper = net.model.join([rates[1] for rates in ends[1]], 0)
    if (lower < 0).any() or (upper > 0).any():
        return {}
    return {"rates_at_lower": lower, "rates_at_upper": upper}


def _refuted(
    net: NonlinearNetwork, data: dict[str, Any], region: tuple[Array, Array], inputs: tuple[Array, Array]
) -> DifferentialNetworkCertificate | None:
    """The certificate with an entry that is negative at a state of the network, if one is seen."""
    for part in _parts(net.totals[0]):
        x = between(net, *region, part)
        w = 0.5 * inputs[0] + 0.5 * inputs[1]
        here = _at(net, x, w, slopes=True)
        A = _with_own_share(net, here)
        found = _ends(net, replace(here, A=A))["upper"]
        for block, M in enumerate(found):
            rows, columns, values = _entries_of(M)
            bad = (values < 0) & ((rows != columns) | (block != 0))
            if bad.any():
                k = int(np.argmin(np.where(bad, values, np.inf)))
                found_at = OrderViolation(block, int(rows[k]), int(columns[k]), float(values[k]), x)
                certificate = DifferentialNetworkCertificate.settle(**data, witness=found_at)
                if certificate.status is Status.REFUTED:
                    return certificate
    return _in_ranges(net, data)


def _with_own_share(net: NonlinearNetwork, here: Blocks) -> list[Any]:
    """A at a state, with upper bounds of what remains when the own shares of differences are taken off."""
    if any((end.data < 0).any() for end in (here.S[0], here.W[0])):
        return here.A  # the link itself is what breaks the order
    most = int(np.diff(here.S[0].indptr).max(initial=0))
    shares, out = own_shares(net, here.S[0]), []
    for (low, high), B, C, share in zip(here.A, here.B, here.C, shares, strict=True):
        ends = np.maximum(B[0], 0.0), np.maximum(C[0], 0.0)
        lost = taken_off(np.zeros_like(high), *ends, share * (1 - (most + 1) * ROOM))
        out.append((low, high + lost + ROOM * (np.abs(high) + np.abs(lost))))
    return out


def _in_ranges(net: NonlinearNetwork, data: dict[str, Any]) -> DifferentialNetworkCertificate | None:
    """The certificate with a link that is known by a range with ends below zero, if there is one."""
    for block, M in zip((3, 4), least_in_ranges(net), strict=True):
        rows, columns, values = _entries_of(Matrix(M))
        known = data["lower"][block].values
        for k in np.argsort(values, kind="stable")[:1] if len(values) else ():
            i, j, value = int(rows[k]), int(columns[k]), float(values[k])
            if value < 0 and known[i, j] <= value:
                return DifferentialNetworkCertificate.settle(**data, witness=OrderViolation(block, i, j, value))
    return None


def _parts(n: int) -> Iterator[Any]:
    """Where in the region to look: middle, corners, and corners at random."""
    yield from (np.full(n, part) for part in (0.5, 0.0, 1.0))
    rng = np.random.default_rng(0)
    for _ in range(_CORNERS):  # a little inside, so that rounding does not leave the region
        yield np.where(rng.random(n) < 0.5, _INSIDE, 1 - _INSIDE)


def _entries_of(M: Matrix) -> tuple[Any, Any, Array]:
    coo = sp.coo_array(M.values)
    return coo.coords[0], coo.coords[1], coo.data
