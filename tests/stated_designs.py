"""What designs promise, on random plants: gains in fractions, refusals and limits against linear programs of their own.

With x = T z for the generators T of a simplicial cone and Z = F T diag(z), invariance and a common decrease of z are
linear in z > 0 and Z.  A gain that such a program finds with room to spare exists, whatever the package says.
"""

import itertools
import warnings
from dataclasses import dataclass, field
from fractions import Fraction

import campaigns
import numpy as np
import scipy.optimize
import statements
from statements import fractions_of

import control_kpos as kp
from control_kpos.errors import ActuatorLossWarning

ROOM = 1e-4


@dataclass(frozen=True)
class Task:
    """A plant on a simplicial cone of determinant 1 with generators T, S their inverse, and what is asked of a gain."""

    pairs: tuple
    T: np.ndarray
    S: np.ndarray
    discrete: bool = False
    asked: dict = field(default_factory=dict)

    @property
    def rate(self):
        asked = self.asked.get("rate", 0)
        return Fraction(0) if asked == "max" else Fraction(asked)

    @property
    def plant(self):
        A, B = self.pairs[0]
        X = kp.PolyhedralCone(self.T.T.astype(float))
        return kp.ConeStateSpace(A, B, np.eye(len(A)), 0 * B, self.discrete, X=X)

    def design(self):
        vertices = {"vertices": self.pairs} if len(self.pairs) > 1 else {}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ActuatorLossWarning)
            return kp.state_feedback(self.plant, **self.asked, **vertices)


def random_task(rng):
    """One to three vertices, and keywords of `state_feedback`, some of them given."""
    n, m = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    T, S = campaigns.unimodular(rng, n) if n > 1 else (np.eye(1), np.eye(1))
    A, B = np.round(rng.uniform(-2, 1, (n, n)), 2), rng.integers(-1, 3, (n, m)).astype(float)
    others = range(int(rng.choice([0, 0, 1, 2])))
    pairs = [(A, B)]
    pairs += [(A + np.round(rng.uniform(-0.4, 0.4, (n, n)), 2), B + 0.25 * rng.integers(-1, 2, (n, m))) for _ in others]
    asked, discrete = {}, bool(rng.random() < 0.3)
    if rng.random() < 0.5:
        asked["rate"] = rng.choice(["1/3", "0.25", "3/4"])
    if rng.random() < 0.5:
        asked["gain_bound"] = float(rng.choice([0.5, 2, 5]))
    if rng.random() < 0.3:
        asked["structure"] = rng.random((m, n)) < 0.7
    if len(pairs) == 1 and not discrete and "structure" not in asked and rng.random() < 0.3:
        asked["disturbance"] = T @ rng.integers(0, 3, (n, 1)), rng.integers(0, 3, (1, n)) @ S
    elif rng.random() < 0.2:
        asked["rate"] = "max"
    return Task(tuple(pairs), fractions_of(T), fractions_of(S), discrete, asked)


def leading(T):
    """Sizes of the first entries of columns that have at least an eighth of the size of the largest."""
    return np.array([next(abs(x) for x in column if 8 * abs(x) >= max(map(abs, column))) for column in T.T])


# -- linear programs of our own


def inequalities(task, rate, bound=None):
    """Rows (G, h) with G (z, Z) + h w <= 0 if z is in the order of the cone, w the size of a disturbance."""
    n, m = task.pairs[0][1].shape
    rows, sizes = [], []

    def row(z, Z, size=0.0):
        rows.append(np.concatenate([z, Z.T.ravel()]))  # Z one generator after another
        sizes.append(size)

    E = task.asked["disturbance"][0].sum(axis=1) if "disturbance" in task.asked else np.zeros(n)
    e = task.S.astype(float) @ E
    unit = np.eye(n)
    for pair in task.pairs:
        A, B = (task.S.astype(float) @ M for M in pair)
        A = A @ task.T.astype(float)
        for i in range(n):
            for k in range(n):
                if i != k or task.discrete:
                    row((ROOM - A[i, k]) * unit[k], -np.outer(B[i], unit[k]))
            row(A[i] + (float(rate) + ROOM - task.discrete) * unit[i], np.outer(B[i], np.ones(n)), e[i])
    lengths = leading(task.T).astype(float)
    if bound is not None:
        for k, j, sign in itertools.product(range(n), range(m), (1, -1)):
            row(-(1 - ROOM) * bound * lengths[k] * unit[k], sign * np.outer(np.eye(m)[j], unit[k]))
    return np.array(rows), np.array(sizes)


def is_possible(task, rate, bound=None):
    """A linear program finds a gain with room to spare; structures and disturbances are left out."""
    n, m = task.pairs[0][1].shape
    rows, _ = inequalities(task, rate, bound)
    bounds = [(1.0, 100.0)] * n + [(None, None)] * (m * n)
    return scipy.optimize.linprog(np.zeros(n + m * n), rows, np.zeros(len(rows)), bounds=bounds).status == 0


def smallest_amplification(task, rate, bound=None):
    """The L-infinity gain from w to z that a linear program reaches with room to spare; inf if it finds none."""
    n, m = task.pairs[0][1].shape
    G = task.asked["disturbance"][1] @ task.T.astype(float)
    rows, sizes = inequalities(task, rate, bound)
    rows = np.vstack([np.c_[rows, np.zeros(len(rows))], np.r_[G[0], np.zeros(m * n), -1]])
    bounds = [(1e-2, 1e4)] * n + [(None, None)] * (m * n) + [(0, None)]
    cost = np.eye(n + m * n + 1)[-1]
    found = scipy.optimize.linprog(cost, rows, -np.append(sizes, 0), bounds=bounds)
    return found.fun if found.status == 0 else np.inf


def stabilising_gains(rng, task, tries=30):
    """Gains F that keep every vertex positive, by random programs in F alone, and those among them that stabilise."""
    n, m = task.pairs[0][1].shape
    T, S, rows, rhs = task.T.astype(float), task.S.astype(float), [], []
    for A, B in task.pairs:
        A, B = S @ A @ T, S @ B
        for i, k in itertools.product(range(n), range(n)):
            if i != k or task.discrete:
                rows.append(-np.kron(B[i], np.eye(n)[k]))
                rhs.append(A[i, k] - ROOM)
    bound = np.tile(leading(task.T).astype(float), m) * task.asked.get("gain_bound", 50.0) * (1 - ROOM)
    box, points = np.c_[-bound, bound], []
    for _ in range(tries):
        rows_and_rhs = (np.array(rows), np.array(rhs)) if rows else (None, None)
        found = scipy.optimize.linprog(rng.normal(size=m * n), *rows_and_rhs, bounds=box)
        if found.status != 0:
            return
        points.append(found.x)
        for g in (found.x, np.mean(points, axis=0)):
            F = g.reshape(m, n) @ S
            poles = [np.linalg.eigvals(A + B @ F) for A, B in task.pairs]
            sizes = [abs(p).max() - 1 if task.discrete else p.real.max() for p in poles]
            if max(sizes) < -float(task.rate) - ROOM:
                yield F


# -- what is promised


def broken_promises(rng, task, d):
    """Demands, rates, fractions and limits that a gain does not keep, exactly."""
    F, least, asked = fractions_of(d.F), float(np.min(d.certified_fraction)), task.asked
    parts = [Fraction(int(p)) for p in rng.integers(1, 5, len(task.pairs))]
    mixed = sum(p / sum(parts) * fractions_of(np.hstack(pair)) for p, pair in zip(parts, task.pairs, strict=True))
    n = len(F.T)
    for A, B in [*((fractions_of(M) for M in pair) for pair in task.pairs), (mixed[:, :n], mixed[:, n:])]:
        for ends in itertools.product({Fraction(1), Fraction(least)}, repeat=len(F)):
            rate = task.rate if min(ends) < 1 else max(task.rate, Fraction(d.decay_rate))
            if not is_positive_and_fast(task, A + B @ np.diag(ends) @ F, rate):
                yield f"the loop at {ends}"
    if len(task.pairs) == 1 and not has_decreasing(task, d, F):
        yield "the vector"
    if "gain_bound" in asked and (np.abs(F @ task.T) > Fraction(asked["gain_bound"]) * leading(task.T)).any():
        yield "the gain bound"
    if "structure" in asked and d.F[~asked["structure"]].any():
        yield "the structure"
    if "disturbance" in asked and amplification(task, F) > Fraction(d.value):
        yield "the gain from w to z"
    if is_beyond_the_limit(task, d):
        yield f"the limit {d.limit}"


def is_positive_and_fast(task, loop, rate):
    """T^-1 A T is Metzler (nonnegative in discrete time), and its dominant eigenvalue is as fast as promised."""
    M = task.S @ loop @ task.T
    if any(M[i, j] < 0 for i in range(len(M)) for j in range(len(M)) if i != j or task.discrete):
        return False
    roots = statements.roots_of(statements.rational(M))
    top = max((abs(r) - 1 if task.discrete else r.real for r in roots), key=float)
    return not top > -statements.rational([[rate]])[0, 0] and (rate > 0 or top < 0)


def has_decreasing(task, d, F):
    """V(x) = v'x decreases with the rate, on every generator."""
    A, B = (fractions_of(M) for M in task.pairs[0])
    proof = d.certificate.loops[0] if hasattr(d.certificate, "loops") else d.certificate
    v = fractions_of(proof.v_exact or proof.v)
    rate = max(task.rate, Fraction(d.decay_rate))
    value, change = v @ task.T, v @ (A + B @ F - int(task.discrete) * np.eye(len(A), dtype=int)) @ task.T
    return (value > 0).all() and (change + rate * value <= 0).all() and (rate > 0 or (change < 0).all())


def amplification(task, F):
    """G (-A - B F)^-1 E, exactly: the L-infinity gain of a positive system with one output."""
    A, B = (fractions_of(M) for M in task.pairs[0])
    E, G = (fractions_of(M) for M in task.asked["disturbance"])
    found = statements.rational(G) * statements.rational(-A - B @ F).inv() * statements.rational(E)
    return Fraction(int(found[0, 0].p), int(found[0, 0].q))


def is_beyond_the_limit(task, d):
    """A linear program finds a gain that is better than the one called the limit."""
    if not np.isfinite(d.limit) or "structure" in task.asked:
        return False
    bound = task.asked.get("gain_bound")
    if task.asked.get("rate") == "max":
        return is_possible(task, d.limit * (1 + 1e-3) + 1e-6, bound)
    if "disturbance" in task.asked:
        return smallest_amplification(task, task.rate, bound) < d.limit * (1 - 1e-6)
    return d.limit > 0 and is_possible(task, task.rate, d.limit * (1 - 1e-3))


def false_refusal(rng, task, d):
    """What is called impossible and is possible: by a linear program, or with a vector of its own for each vertex."""
    if "structure" in task.asked:
        return None
    if is_possible(task, task.rate, task.asked.get("gain_bound")):
        return "refused what a linear program finds"
    if "common vector x inside X" not in d.explain() and next(stabilising_gains(rng, task), None) is not None:
        return "refused what individual vectors prove"
    return None


def false_designs(count, seed):
    """Gains that do not do what was asked, fractions and limits that are not true, refusals of what is possible."""
    rng, found = np.random.default_rng(seed), []
    for k in range(count):
        task = random_task(rng)
        d = task.design()
        if d:
            wrong = list(broken_promises(rng, task, d))
        else:
            wrong = [false_refusal(rng, task, d)] if d.status is kp.Status.REFUTED else []
        found += [(seed, k, what, task.asked) for what in wrong if what]
    return found
