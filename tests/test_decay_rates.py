"""Decay rates of matrices far from normal, and rates that are asked for at the largest and beside it."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import control_kpos as kp
from control_kpos import checker


def chain(size, down, discrete=False):
    """x_1 -> x_2 -> ...: 1/4 is the supremum of the rates that are proven, and not attained."""
    return np.diag(np.full(size, discrete - 0.25)) + np.diag(np.full(size - 1, float(down)), -1)


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize(("size", "down"), [(3, 1), (60, 7), (400, 1)])
def test_rates_of_chains_come_close_to_the_supremum(size, down, discrete):
    certificate = kp.linear_lyapunov(chain(size, down, discrete), kp.orthant(size), discrete=discrete, rate="max")
    assert certificate and 0.25 * (1 - 1e-6) < certificate.decay_rate < 0.25 and certificate.check()
    assert 0.25 <= certificate.decay_rate_bound < 0.25 * (1 + 1e-8)
    assert not certificate.settle(**certificate.data() | {"decay_rate": 0.25})
    assert not replace(certificate, decay_rate=0.25).check()


@pytest.mark.parametrize("discrete", [False, True])
def test_chains_on_other_cones(discrete):
    rng, size = np.random.default_rng(0), 40
    T = np.triu(rng.integers(0, 2, (size, size)), 1) + np.eye(size, dtype=int)
    T, inverse = T.astype(object), np.array(np.round(np.linalg.inv(T.astype(float))), dtype=int).astype(object)
    assert (T @ inverse == np.eye(size)).all()
    A = T @ (4 * chain(size, 1, discrete)).astype(int).astype(object) @ inverse * Fraction(1, 4)
    certificate = kp.linear_lyapunov(A.tolist(), kp.PolyhedralCone(T.T.tolist()), discrete=discrete, rate="max")
    assert certificate and certificate.check() and 0.25 * (1 - 1e-6) < certificate.decay_rate < 0.25


@pytest.mark.parametrize("discrete", [False, True])
def test_a_supremum_is_no_rate(discrete, tmp_path):
    A, cone = chain(30, 1, discrete), kp.orthant(30)
    certificate = kp.linear_lyapunov(A, cone, discrete=discrete, rate="1/4")
    assert certificate.status is kp.Status.REFUTED and certificate.check() and "but not at 1/4" in certificate.explain()
    certificate.save(tmp_path / "c.json")
    assert kp.load_certificate(tmp_path / "c.json").status is kp.Status.REFUTED
    assert checker.main(tmp_path / "c.json") == 1
    last = np.eye(30)[-1]  # nothing is left of A x + x / 4
    assert not replace(certificate, witness=replace(certificate.witness, x=last, exact=None)).check()
    assert kp.linear_lyapunov(A, cone, discrete=discrete, rate=Fraction(1, 4) - Fraction(1, 10**6))


@pytest.mark.parametrize(
    ("A", "proved"),
    [
        ([[-1, 0, 0], [0, "-4/3", "1/3"], [0, "2/3", "-5/3"]], True),  # two parts at one rate, side by side
        ([[-1, 1, 0], [0, -2, 1], [0, 0, -3]], True),  # the slowest part feeds no other
        ([[-3, 1, 0], [0, -2, 1], [0, 0, -1]], False),  # the slowest part feeds all others
        ([[-1, 0], ["1/7", -1]], False),
    ],
)
def test_at_the_rate_of_reducible_matrices(A, proved):
    certificate = kp.linear_lyapunov(A, kp.orthant(len(A)), rate=1)
    assert certificate.status is (kp.Status.PROVED if proved else kp.Status.REFUTED) and certificate.check()


def with_rate(seed):
    """K-positive on a cone that is not simplicial, with v = sum w_j h_j and v'A = -rate v' exactly."""
    rng, n = np.random.default_rng(seed), 4
    cube = [[*rng.permutation([1, 2, 2 * s, -s])[:3].tolist(), 3] for s in (1, -1) for _ in range(3)]
    box = [[*(s * np.eye(3, dtype=int)[k]).tolist(), 1] for k in range(3) for s in (1, -1)]
    X = kp.PolyhedralCone(cube + box)
    H, R = (m.rows_as_integers(np.arange(m.shape[0])) for m in (X.exact_facets, X.exact_rays))
    weights = [Fraction(int(w), 7) for w in rng.integers(1, 9, len(H))]
    v = sum(w * h for w, h in zip(weights, H, strict=True))
    inner = [rng.integers(0, 3, len(R)) @ R + R[0] for _ in H]
    P = sum(np.outer(x * w / (v @ x), h) for x, w, h in zip(inner, weights, H, strict=True))
    rate = Fraction(22, 7)  # v'P = v'
    return P - (1 + rate) * np.eye(n, dtype=int).astype(object), X, rate


@pytest.mark.parametrize("seed", range(6))
def test_beside_the_rate_on_a_cone_with_many_facets(seed):
    A, X, rate = with_rate(seed)
    for ahead in (-1e-12, 0, 1e-30, 1e-18, 1e-12, 1e-3):
        certificate = kp.linear_lyapunov(A.tolist(), X, rate=rate * (1 + Fraction(ahead)))
        assert certificate.status is (kp.Status.REFUTED if ahead > 0 else kp.Status.PROVED) and certificate.check()


@pytest.mark.parametrize("entries", [[[-5e-324, 0], [5e-324, -5e-324]], [[-5e-324]], [[-1e-310, 0], [1e-312, -3e-310]]])
def test_the_smallest_doubles_have_a_largest_rate(entries):
    """Steps between shifts do not vanish."""
    c = kp.linear_lyapunov(entries, kp.orthant(len(entries)), rate="max")
    assert c and c.check() and 0 <= c.decay_rate <= -entries[0][0] <= c.decay_rate_bound
