"""What the package states, on random data, against an independent truth; tests run few, the campaign many."""

import warnings
from fractions import Fraction

import flint
import numpy as np
import scipy.linalg

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


def fractions_of(M):
    return np.vectorize(Fraction, otypes=[object])(np.asarray(M, dtype=object))


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
