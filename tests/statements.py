"""What the package states, on random data, against an independent truth; tests run few, the campaign many."""

import itertools
import warnings
from fractions import Fraction

import campaigns
import flint
import numpy as np
import scipy.linalg
import scipy.optimize

import control_kpos as kp
from control_kpos.errors import ActuatorLossWarning, KposError

# -- no foreign exception and no warning, in units up to the ends of floating point


def any_units(rng, size):
    bits = int(rng.choice([0, 0, 1, 30, 300, 500, 900, 1000]))
    return 2.0 ** rng.integers(-bits, bits + 1, size) if bits else np.ones(size)


@np.errstate(all="ignore")
def system_in_any_units(rng):
    """Often positive, often stable, with entries from 2**-1000 to 2**1000."""
    n, m, q = rng.integers(1, [5, 3, 3])
    A = rng.integers(-3, 4, (n, n)) * 1.0
    if rng.random() < 0.7:
        A = np.abs(A)
        np.fill_diagonal(A, -A.sum(axis=1) - rng.integers(0, 2, n))
    units = any_units(rng, n)
    matrices = [A * units[:, None] / units * any_units(rng, 1)]
    matrices += [rng.integers(0, 3, shape) * any_units(rng, 1) for shape in ((n, m), (q, n))]
    matrices.append(rng.integers(0, 2, (q, m)) * any_units(rng, 1) * (rng.random() < 0.3))
    matrices = [np.nan_to_num(M, nan=0.0, posinf=1e300, neginf=-1e300) for M in matrices]
    return kp.ConeStateSpace(*matrices, True if rng.random() < 0.3 else 0)


def _ask(rng, s, path):
    """One question about a system, and everything that can be done with the answer."""
    loops = [s] * int(rng.integers(1, 4))
    W = rng.integers(0, 3, (len(loops) * s.ninputs, len(loops) * s.noutputs)) * any_units(rng, 1) * 0.2
    rate = (None, "max", 0.5)[int(rng.integers(3))]
    questions = [
        s.cone_positivity,
        lambda: s.linear_lyapunov(rate),
        s.dissipativity,
        s.gain,
        lambda: kp.feedback_interconnect(loops, W).certificate,
        lambda: kp.feedback_interconnect(loops, W).abscissa_certificate(),
        lambda: kp.feedback_interconnect(loops, W).with_links(0.5 * W).certificate,
        lambda: (
            kp.feedback_interconnect(loops, W)
            .with_node(s, incoming={0: 0.5 * W[: s.ninputs, : s.noutputs]})
            .certificate
        ),
        lambda: kp.find_cone(s.A, discrete=bool(s.dt)),
        lambda: kp.find_cone(s, time_limit=1),
        lambda: kp.state_feedback(s, time_limit=1),
        lambda: kp.output_feedback(s, time_limit=1),
        lambda: kp.network_feedback(loops, 0 * W, time_limit=1),
        lambda: kp.scale_free_certificate(s, 0.5),
    ]
    answer = questions[int(rng.integers(len(questions)))]()
    for text in ("explain", "_repr_html_", "__repr__", "__str__", "check"):
        getattr(answer, text, str)()
    if isinstance(answer, kp.Certificate):
        answer.save(path)
        kp.load_certificate(path)


def foreign_errors(count, seed, mode, path):
    """Exceptions that are not ours, and warnings, with numpy told to `mode` every floating point error."""
    rng, found = np.random.default_rng(seed), []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", ActuatorLossWarning)
        for k in range(count):
            s = system_in_any_units(rng)
            try:
                with np.errstate(all=mode):
                    _ask(rng, s, path)
            except KposError:
                pass
            except Exception as error:  # noqa: BLE001 -- this is what is looked for
                found.append((seed, k, type(error).__name__, str(error)))
    return found


# -- designs: what is promised of a gain, in fractions; a refusal against a linear program of its own


def fractions_of(M):
    return np.vectorize(Fraction, otypes=[object])(np.asarray(M, dtype=object))


def keeps(A, T, S):
    """A T inside T in continuous time, for a simplicial cone: T^-1 A T is Metzler."""
    M = S @ A @ T
    return all(M[i, j] >= 0 for i in range(len(M)) for j in range(len(M)) if i != j)


def decreases(A, T, v, rate):
    """v'x > 0 and v'A x + rate v'x <= 0 on the columns of T."""
    value = v @ T
    return (value > 0).all() and (v @ A @ T + rate * value <= 0).all() and (rate > 0 or (v @ A @ T < 0).all())


def leading(T):
    """Sizes of the first entries of columns that have at least an eighth of the size of the largest."""
    return np.array([next(abs(x) for x in column if 8 * abs(x) >= max(map(abs, column))) for column in T.T])


def plant_on_a_cone(rng):
    """A plant, and a simplicial cone of determinant 1 as its generators T and their inverse S."""
    n, m = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    T, S = campaigns.unimodular(rng, n) if n > 1 else (np.eye(1), np.eye(1))
    A = np.round(rng.uniform(-2, 1, (n, n)), 2)
    B = rng.integers(-1, 3, (n, m)).astype(float)
    X = kp.PolyhedralCone(T.T)
    return kp.ConeStateSpace(A, B, np.eye(n), np.zeros((n, m)), X=X), fractions_of(T), fractions_of(S)


def demands_on_a_gain(rng, s):
    """Keywords of `state_feedback`, some of them given."""
    out = {}
    if rng.random() < 0.5:
        out["rate"] = rng.choice(["1/3", "0.25", "1"])
    if rng.random() < 0.5:
        out["gain_bound"] = float(rng.choice([0.5, 2, 5]))
    if rng.random() < 0.3:
        out["structure"] = rng.random((s.ninputs, s.nstates)) < 0.7
    return out


def impossible_by_linprog(s, T, S, demands):
    """False if a linear program finds a gain with room to spare: x = T z, F T diag(z) = Z, as the variables."""
    n, m = s.nstates, s.ninputs
    A, B = (S @ fractions_of(M) for M in (s.A @ np.asarray(T, float), s.B))
    A, B, eps = A.astype(float), B.astype(float), 1e-4
    rows, rhs = [], []
    for i in range(n):
        for k in range(n):
            if i != k:  # (A_ik z_k + B_i Z_k) >= eps z_k
                row = np.zeros(n + m * n)
                row[k] = -(A[i, k] - eps)
                row[n + k * m : n + (k + 1) * m] = -B[i]
                rows.append(row)
                rhs.append(0.0)
        row = np.zeros(n + m * n)  # sum_k (A_ik z_k + B_i Z_k) + rate z_i <= -eps
        row[:n] = A[i]
        row[i] += float(Fraction(demands.get("rate", 0))) + eps
        for k in range(n):
            row[n + k * m : n + (k + 1) * m] = B[i]
        rows.append(row)
        rhs.append(-eps)
    lengths = leading(T).astype(float)
    bounds = [(1.0, 100.0)] * n + [(None, None)] * (m * n)
    if "gain_bound" in demands:
        for k in range(n):
            for j in range(m):
                for sign in (1, -1):
                    row = np.zeros(n + m * n)
                    row[k], row[n + k * m + j] = -0.99 * demands["gain_bound"] * lengths[k], sign
                    rows.append(row)
                    rhs.append(0.0)
    return scipy.optimize.linprog(np.zeros(n + m * n), np.array(rows), rhs, bounds=bounds).status != 0


def false_designs(count, seed):
    """Gains that do not do what was asked, exactly; fractions that are not proven; refusals of what is possible."""
    rng, found = np.random.default_rng(seed), []
    for k in range(count):
        s, T, S = plant_on_a_cone(rng)
        demands = demands_on_a_gain(rng, s)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ActuatorLossWarning)
            d = kp.state_feedback(s, **demands)
        if d.status is kp.Status.REFUTED and "structure" not in demands and not impossible_by_linprog(s, T, S, demands):
            found.append((seed, k, "refused what a linear program finds", demands))
        if not d:
            continue
        found += [(seed, k, what, demands) for what in _broken_promises(d, s, T, S, demands)]
    return found


def _broken_promises(d, s, T, S, demands):
    A, B, F = (fractions_of(M) for M in (s.A, s.B, d.F))
    proof = d.certificate.loops[0] if hasattr(d.certificate, "loops") else d.certificate
    v = fractions_of(proof.v_exact or proof.v)
    asked = Fraction(demands.get("rate", 0))
    fraction = float(np.min(d.certified_fraction))
    for ends in itertools.product({Fraction(1), Fraction(fraction)}, repeat=s.ninputs):
        loop = A + B @ np.diag(ends) @ F
        rate = asked if min(ends) < 1 else max(asked, Fraction(d.decay_rate))
        if not keeps(loop, T, S) or not decreases(loop, T, v, rate):
            yield f"the loop at {ends}"
    lengths = leading(T)
    if "gain_bound" in demands and (np.abs(F @ T) > Fraction(demands["gain_bound"]) * lengths).any():
        yield "the gain bound"
    if "structure" in demands and d.F[~demands["structure"]].any():
        yield "the structure"


# -- networks: eigenvalues to 50 digits and more


def random_network(rng):
    """Nodes of one or two states, with feedthrough now and then, and links of either sign."""
    nodes = []
    for _ in range(int(rng.integers(1, 5))):
        n = int(rng.integers(1, 3))
        A = rng.integers(0, 3, (n, n)) * 0.25
        np.fill_diagonal(A, -rng.integers(1, 5, n) * 0.5)
        B, C = rng.integers(0, 3, (n, 1)) * 0.5, rng.integers(0, 3, (1, n)) * 0.5
        nodes.append(kp.ConeStateSpace(A, B, C, 0.25 * (rng.random() < 0.3)))
    N = len(nodes)
    W = np.round(rng.uniform(-0.2 * (rng.random() < 0.2), 1.2, (N, N)), 2) * (rng.random((N, N)) < 0.6)
    return nodes, W


def rational(M):
    """A matrix of doubles as one of FLINT's fractions."""
    M = fractions_of(M)
    return flint.fmpq_mat(*M.shape, [flint.fmpq(x.numerator, x.denominator) for x in M.ravel()])


def roots_of(M):
    """All eigenvalues of a matrix of fractions, enclosed to 50 digits."""
    with flint.ctx.workdps(50):
        return [root for root, _ in M.charpoly().numer().complex_roots()]


def true_abscissa(nodes, W):
    """The largest real part of the poles, and the spectral radius of W D, as balls; None if I - W D is singular."""
    A, B, C, D = (rational(scipy.linalg.block_diag(*(getattr(s, name) for s in nodes))) for name in "ABCD")
    W = rational(W)
    N = W.nrows()
    loop = flint.fmpq_mat(N, N, [int(i == j) for i in range(N) for j in range(N)]) - W * D
    if loop.det() == 0:
        return None
    poles = roots_of(A + B * loop.inv() * W * C)
    return max((p.real for p in poles), key=float), max((abs(p) for p in roots_of(W * D)), key=float)


def false_networks(count, seed):
    """Verdicts, rates and brackets that eigenvalues to 50 digits contradict; edits that differ from a fresh network."""
    rng, found = np.random.default_rng(seed), []
    for k in range(count):
        nodes, W = random_network(rng)
        try:
            net = kp.feedback_interconnect(nodes, W)
        except KposError:
            if true_abscissa(nodes, W) is not None:
                found.append((seed, k, "refused as not well posed"))
            continue
        found += [(seed, k, what) for what in _network_falsehoods(rng, net, nodes, W)]
    return found


def _network_falsehoods(rng, net, nodes, W):
    top, radius = true_abscissa(nodes, W)
    c = net.certificate
    if c and not (float(top) < 0 and float(radius) < 1 and float(top) <= -c.decay_rate + 1e-12):
        yield "the verdict or its rate"
    if c.status is kp.Status.REFUTED and (W >= 0).all() and float(top) < 0 and float(radius) < 1:
        yield "refuted, though stable and positive"
    bracket = net.abscissa_certificate()
    if bracket and not bracket.lower - 1e-40 <= top <= bracket.upper + 1e-40:
        yield "the bracket"
    gone = int(rng.integers(len(nodes)))
    rest = [j for j in range(len(nodes)) if j != gone]
    edits = [(net.with_links(0.5 * W), nodes, 0.5 * W)]
    if rest:
        edits.append((net.without_node(gone), [nodes[j] for j in rest], W[np.ix_(rest, rest)]))
    column = {i: W[j, gone] for i, j in enumerate(rest) if W[j, gone]}
    row = {i: W[gone, j] for i, j in enumerate(rest) if W[gone, j]}
    moved = [*[nodes[j] for j in rest], nodes[gone]]
    order = np.array([*rest, gone])
    if rest and not W[gone, gone]:
        edits.append(
            (edits[1][0].with_node(nodes[gone], incoming=row, outgoing=column), moved, W[np.ix_(order, order)])
        )
    for edited, parts, links in edits:
        fresh = kp.feedback_interconnect(parts, links).certificate
        if edited.certificate.status is not fresh.status or not edited.certificate.check():
            yield "an edited network"


# -- networks of any size


def false_coverage(count, seed):
    """Graphs that a scale-free certificate covers although the network is not stable."""
    rng, found = np.random.default_rng(seed), []
    for k in range(count):
        D, link, sign = 0.25 * (rng.random() < 0.4), float(rng.choice([0.5, 1, 2])), int(rng.choice([1, -1]))
        b, c = rng.integers(1, 3, 2) * 0.5
        node = kp.ConeStateSpace([[-rng.integers(1, 4)]], [[b]], [[sign * c]], [[sign * D]], Y=[[sign]])
        weight = float(np.round(rng.uniform(0, 2), 2))
        certificate = kp.scale_free_certificate(node, weight=weight, link=[[sign * link]])
        N = int(rng.integers(1, 6))
        W = sign * np.round(rng.uniform(0, 1, (N, N)), 2) * (rng.random((N, N)) < 0.7) * weight * link
        W /= max(
            1.0, np.abs(W).sum(axis=int(rng.integers(2))).max() / (weight * link + 1e-9) * rng.choice([0.9, 1, 1.1])
        )
        W *= rng.choice([1, 1, 1, -1])
        if certificate.covers(W):
            truth = true_abscissa([node] * N, W)
            if truth is None or not (float(truth[0]) < 0 and float(truth[1]) < 1):
                found.append((seed, k, "covers"))
    return found
