"""Time responses and poles of large networks without a dense matrix.

In continuous time the state is carried over windows of several samples by one Taylor expansion of the
matrix exponential, sum (t^k / k!) (A - m I)^k x e^{m t}, whose terms serve all samples of the window; its
length is chosen from the norm so that the error stays below 1e-11.  Inputs are interpolated linearly
between samples, as in python-control.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from ..errors import DataError, ShapeError, TooLargeError
from ..exact.intake import dimensions, real_number, vector
from .blocks import Floats, Index
from .closed_loop import ClosedLoop
from .model import NetworkModel

Progress: TypeAlias = Callable[[str], None]
# Length of a window times the norm of A: rounding errors grow by e to this power.
_REACH = 6.0
_TAIL = 1e-13
# Products with A above which an implicit method takes over.
_STIFF = 300_000


# States and inputs up to which responses to many steps take one dense exponential.
_MOST_DENSE = 1500

# Samples beyond this fill the memory.
_MOST_SAMPLES = 10**8
# Quotients of shorter times overflow.
_SHORTEST = 1e-250


def sample_times(T: ArrayLike | float, dt: Any, count: int = 200) -> NDArray[np.float64]:
    """Evenly spaced sample times from an array, or from a final time.

    Raises
    ------
    ShapeError, DataError
        No times, times that are not evenly spaced and increasing, or (discrete time) not dt apart.
    """
    step = (1.0 if dt is True else float(dt)) if dt else None
    if dimensions(T) == 0:
        end = real_number(T, "T", positive=True)
        if end < _SHORTEST:
            raise DataError(f"T is {end:g}; choose a unit of time in which it is not below {_SHORTEST:g}.")
        if step and end / step > _MOST_SAMPLES:
            raise TooLargeError(f"T is {end:g}, which is more than {_MOST_SAMPLES} steps of {step:g}.")
        return np.arange(float(round(end / step) + 1)) * step if step else np.linspace(0.0, end, count)
    times = vector(T, "T")
    if times.size == 0:
        raise ShapeError("T is empty; give sample times or a final time.")
    gaps = np.diff(times)
    if gaps.size and not (gaps.min() > _SHORTEST and np.ptp(gaps) <= 1e-6 * gaps.mean()):
        raise DataError("T must increase in equal steps.")
    if step and gaps.size and abs(gaps.mean() - step) > 1e-6 * step:
        raise DataError(f"T has steps of {gaps.mean():g}, but the sampling time is {step:g}.")
    return times


def respond(
    loop: ClosedLoop,
    times: Floats,
    x0: Floats,
    inputs: tuple[sp.csr_array, Floats] | None,
    rows: Index,
    keep_states: bool,
    progress: Progress | None = None,
) -> tuple[Floats, Floats | None]:
    """Outputs (`rows` of them) at evenly spaced sample times, shape (len(rows), len(times)), and states if wanted.

    `inputs` are the input matrix (n, m) and samples (m, len(times)), without feedthrough to the outputs.
    """
    C, _ = loop.output_matrices(rows)
    states = np.zeros((len(x0), len(times))) if keep_states else None
    run = _Run(loop, times, inputs, C, np.zeros((len(rows), len(times))), states, progress)
    run.store(0, x0)
    if loop.model.discrete:
        x = x0
        for i in range(1, len(times)):
            x = loop.matrix @ x + (0.0 if inputs is None else inputs[0] @ inputs[1][:, i - 1])
            run.store(i, x)
    elif len(times) > 1:
        centre, norm = _centre_and_norm(loop)
        if norm * run.h * (len(times) - 1) > _STIFF:
            _implicit(run, x0)
        elif inputs is None:
            _free(run, x0, centre, norm)
        else:
            _forced(run, x0, norm)
    return run.outputs, run.states


@dataclass
class _Run:
    """A simulation: the loop, when it is looked at, what goes in, and what comes out."""

    loop: Any
    times: Floats
    inputs: tuple[sp.csr_array, Floats] | None
    C: sp.csr_array
    outputs: Floats
    states: Floats | None
    progress: Progress | None

    @property
    def h(self) -> float:
        """Time between samples."""
        return float(self.times[1] - self.times[0])

    def store(self, at: int, x: Floats) -> None:
        """Note the state at a sample."""
        self.outputs[:, at] = self.C @ x
        if self.states is not None:
            self.states[:, at] = x

    def report(self, done: int) -> None:
        """Say how far it is."""
        if self.progress is not None:
            self.progress(f"simulating: {done} of {len(self.times) - 1} samples")


def _centre_and_norm(loop: ClosedLoop) -> tuple[float, float]:
    A = loop.matrix
    if not sp.issparse(A):
        return 0.0, float(spla.norm(loop.model.block_matrices[0], 1)) * 4
    diagonal = A.diagonal()
    centre = 0.5 * (float(diagonal.min()) + float(diagonal.max())) if diagonal.size else 0.0
    rest = np.abs(diagonal - centre) - np.abs(diagonal)
    by_row = np.asarray(abs(A).sum(axis=1)).ravel() + rest
    by_column = np.asarray(abs(A).sum(axis=0)).ravel() + rest
    # scaling every state by its own unit does not change the exponential: take the smaller bound
    return centre, max(float(min(by_row.max(), by_column.max(), np.sqrt(by_row.max() * by_column.max()))), 1e-300)


def _free(run: _Run, x: Floats, centre: float, norm: float) -> None:
    """Windows of several samples, or several windows for one sample."""
    A, h, count = run.loop.matrix, run.h, len(run.times) - 1
    splits, per_window = max(1, int(np.ceil(norm * h / _REACH))), max(1, min(int(_REACH / (norm * h)), count))
    step, at = h / splits, 0
    while at < count:
        for _ in range(splits - 1):
            x = np.exp(centre * step) * sum(_taylor(A, x, step, centre))
        samples = np.arange(1, min(per_window, count - at) + 1)
        terms = _taylor(A, x, len(samples) * step, centre)
        weights = (samples / len(samples))[:, None] ** np.arange(len(terms)) * np.exp(centre * step * samples)[:, None]
        run.outputs[..., at + samples] = _sampled(weights, [run.C @ term for term in terms])
        if run.states is not None:
            run.states[..., at + samples] = _sampled(weights, [term[: len(run.states)] for term in terms])
        x = sum(w * term for w, term in zip(weights[-1], terms, strict=True))  # type: ignore[assignment]
        at += len(samples)
        run.report(at)


def _sampled(weights: Floats, terms: list[Floats]) -> Floats:
    """The sums of the terms with the weights of every sample, samples last."""
    return np.moveaxis(np.tensordot(weights, np.stack(terms), axes=1), 0, -1)


class _Driven:
    """(x, t b) moves freely like x' = A x + b with a constant b: columns for many inputs are moved by one product."""

    def __init__(self, A: Any, size: int, t: float) -> None:
        self.A, self.size, self.t = A, size, t

    def __matmul__(self, z: Floats) -> Floats:
        out = np.zeros_like(z)
        out[: self.size] = self.A @ z[: self.size] + z[self.size :] / self.t
        return out


def step_all(
    loop: ClosedLoop,
    times: Floats,
    x0: Floats,
    B: Any,
    rows: Index,
    keep_states: bool,
    progress: Progress | None = None,
) -> tuple[Floats, Floats | None]:
    """Outputs (len(rows), m, len(times)) after unit steps of m inputs, one at a time, and states (n, m, .) if wanted.

    `B`, dense of shape (n, m), is what a step adds; outputs are without feedthrough.
    """
    C, _ = loop.output_matrices(rows)
    n, m = B.shape
    # samples lie behind each other in memory, as they are written
    states = np.moveaxis(np.zeros((len(times), n, m)), 0, -1) if keep_states else None
    outputs = np.moveaxis(np.zeros((len(times), len(rows), m)), 0, -1)
    x = np.tile(x0[:, None], m)
    ends = sp.csr_array(sp.hstack([C, sp.csr_array(C.shape)]))
    run = _Run(loop, times, None, ends, outputs, states, progress)
    centre, norm = _centre_and_norm(loop)
    norm = norm + abs(centre)  # b is at rest: nothing is gained by a shift
    F, G, dense = loop.matrix, B, n + m <= _MOST_DENSE and len(times) > 1
    if dense and not loop.model.discrete:  # one exponential for all samples
        whole = np.zeros((n + m, n + m))
        whole[:n, :n], whole[:n, n:] = run.h * loop.A.toarray(), run.h * B
        F, G = np.split(scipy.linalg.expm(whole)[:n], [n], axis=1)
    if loop.model.discrete or len(times) == 1 or dense:
        for i in range(len(times)):
            x = x if i == 0 else F @ x + G
            outputs[..., i] = C @ x
            if states is not None:
                states[..., i] = x
    elif norm * run.h * (len(times) - 1) <= _STIFF:
        run.outputs[..., 0] = C @ x
        if states is not None:
            states[..., 0] = x
        t = _REACH / norm
        _free(replace(run, loop=_Moving(_Driven(loop.matrix, n, t))), np.concatenate([x, t * B]), 0.0, norm)
    else:  # stiff: one implicit integration for each input
        for k in range(m):
            inputs = sp.csr_array(B[:, [k]]), np.ones((1, len(times)))
            outputs[:, k], own = respond(loop, times, x0, inputs, rows, keep_states, progress)
            if states is not None:
                states[:, k] = own
    return outputs, states


@dataclass(frozen=True)
class _Moving:
    """What moves freely, in the place of a closed loop."""

    matrix: Any


def _taylor(A: Any, x: Floats, t: float, centre: float) -> list[Floats]:
    """Terms t^k / k! (A - centre I)^k x until they no longer matter."""
    terms, small = [x], 0
    size = float(np.abs(x).max(initial=0.0))
    for k in range(1, 100):
        terms.append((A @ terms[-1] - centre * terms[-1]) * (t / k))
        small = small + 1 if float(np.abs(terms[-1]).max(initial=0.0)) <= _TAIL * size else 0
        if small == 2:
            break
    return terms


def _forced(run: _Run, x: Floats, norm: float) -> None:
    """One sample at a time: (x, t b, t^2 c) moves freely in steps of t if x' = A x + b + s c."""
    A, (B, U) = run.loop.matrix, run.inputs  # type: ignore[misc]
    splits, n = max(1, int(np.ceil(norm * run.h / _REACH))), len(x)
    t = run.h / splits

    def drift(z: Floats) -> Floats:
        return np.concatenate([t * (A @ z[:n]) + z[n : 2 * n], z[2 * n :], np.zeros(n)])

    whole = spla.LinearOperator((3 * n, 3 * n), matvec=drift, dtype=float)
    for i in range(len(run.times) - 1):
        z: Any = np.concatenate([x, t * (B @ U[:, i]), t * (B @ (U[:, i + 1] - U[:, i])) / splits])
        for _ in range(splits):
            z = sum(_taylor(whole, z, 1.0, 0.0))
        x = z[:n]
        run.store(i + 1, x)
        run.report(i + 1)


def _implicit(run: _Run, x: Floats) -> None:
    """Stiff networks: SciPy's BDF with the sparse Jacobian."""
    times, jacobian = run.times, sp.csc_array(run.loop.A)

    def drift(t: float, x: Floats) -> Floats:
        out = run.loop.matrix @ x
        if run.inputs is not None:
            B, U = run.inputs
            i = min(int((t - times[0]) / run.h), len(times) - 2)
            part = (t - times[i]) / (times[i + 1] - times[i])
            out = out + B @ ((1 - part) * U[:, i] + part * U[:, i + 1])
        return out

    for i, span in enumerate(pairwise(times.tolist())):
        moved = (span[1] - span[0]) * np.abs(drift(span[0], x)).max(initial=0.0)
        size = max(float(np.abs(x).max(initial=0.0)), float(moved), 1e-300)
        done = solve_ivp(drift, span, x, method="BDF", jac=jacobian, rtol=1e-8, atol=1e-10 * size)
        if not done.success:
            raise DataError(f"the implicit integration stopped at t = {span[0]:g}: {done.message}")
        x = done.y[:, -1]
        run.store(i + 1, x)


def delayed(
    model: NetworkModel,
    times: Floats,
    x0: Floats,
    delays: Floats,
    refine: int,
    rows: Index,
    progress: Progress | None = None,
) -> Floats:
    """Outputs (len(rows), len(times)) when link l passes on y(t - delays[l]); y(t) = C x0 before t = 0.

    The nodes are integrated exactly for inputs that are linear between `refine` points per sample, so that the error
    falls with the square of their distance.
    """
    W = sp.coo_array(model.W)
    target, source = W.coords
    steps = (len(times) - 1) * refine
    h = float(times[-1] - times[0]) / steps if steps else 1.0
    F, G0, G1 = zip(*(_linear_hold(s.A.values, s.B.values, h) for s in model.stacks), strict=True)
    lag = np.minimum(delays / h, steps + 1)  # y does not change before t = 0
    reach = int(np.ceil(lag.max(initial=0.0))) + 2
    whole = np.floor(lag).astype(np.intp)
    part = lag - whole
    M = model.totals[1]

    def output(x: Floats, u: Floats) -> Floats:
        return model.times("C", x) + model.times("D", u)

    def arriving(i: int) -> Floats:
        recent, older = past[(i - whole) % reach, source], past[(i - whole - 1) % reach, source]
        late = W.data * ((1 - part) * recent + part * older)
        return np.bincount(target, late, minlength=M).astype(np.float64, copy=False)

    y = output(x0, np.zeros(M))
    for _ in range(50 if model.has_feedthrough else 0):
        y = output(x0, model.W @ y)
    past = np.tile(y, (reach, 1))
    u, x = arriving(0), x0
    outputs = np.zeros((len(rows), len(times)))
    outputs[:, 0] = y[rows]
    for i in range(1, steps + 1):
        free = model.apply(F, x, 0, 0) + model.apply(G0, u, 0, 1)
        u_new, slot = u, past[(i - 1) % reach]
        past[i % reach] = slot
        for _ in range(3):  # links shorter than a step see the new outputs
            u_new = arriving(i)
            x = free + model.apply(G1, u_new, 0, 1)
            past[i % reach] = slot = output(x, u_new)
            if lag.min(initial=1.0) >= 1:
                break
        u = u_new
        if i % refine == 0:
            outputs[:, i // refine] = slot[rows]
            if progress is not None:
                progress(f"simulating with delays: {i} of {steps} steps")
    return outputs


def _linear_hold(A: Floats, B: Floats, h: float) -> tuple[Floats, Floats, Floats]:
    """F, G0, G1 with x(h) = F x + G0 u(0) + G1 u(h) for inputs linear in time; stacks (N, n, n)."""
    count, n, m = B.shape
    block = np.zeros((count, n + 2 * m, n + 2 * m))
    block[:, :n, :n], block[:, :n, n : n + m] = A * h, B * h
    block[:, n : n + m, n + m :] = np.eye(m)
    whole = scipy.linalg.expm(block)
    g1 = whole[:, :n, n + m :]
    return whole[:, :n, :n], whole[:, :n, n : n + m] - g1, g1
