"""Slow decay beside fast oscillation: cones of thousands of generators, with sparse multipliers."""

from __future__ import annotations

import json
from dataclasses import replace

import control as ct
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.sparse import csr_array

from control_kpos import Status, checker, find_cone, load_certificate
from control_kpos.exact.matrix import Matrix
from control_kpos.find.one_matrix.explicit import LARGE, modal_cone
from control_kpos.find.one_matrix.modes import modes


def oscillations(*ratios: float, seed: int = 0, discrete: bool = False) -> np.ndarray:
    """A dominant eigenvalue and pairs with these ratios of gap to frequency, in random coordinates."""
    blocks = [np.array([[-ratio, 1.0], [-1.0, -ratio]]) * (1 + 0.3 * k) for k, ratio in enumerate(ratios)]
    if discrete:  # a small angle, and a modulus that its polygon of about pi / ratio corners just holds
        blocks = [np.array([[np.cos(r), np.sin(r)], [-np.sin(r), np.cos(r)]]) * (1 - r * r / 2) for r in ratios]
    A = block_diag(*blocks, float(discrete))
    T = np.linalg.qr(np.random.default_rng(seed).standard_normal(A.shape))[0]
    return T @ A @ T.T


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("ratios", [(1e-3,), (4e-5,), (1e-3, 2e-3, 0.5), (1e-3,) * 4])
def test_very_many_generators_are_proven(ratios, discrete):
    A = oscillations(*ratios, discrete=discrete)
    found = find_cone(A, discrete=discrete)
    assert found.status is Status.PROVED and found.n_rays >= found.fewest_rays and found.n_rays > LARGE
    assert found.certificate.multipliers.is_sparse and found.certificate.check()
    R, P = found.rays.T, found.certificate.multipliers.values
    assert np.abs(A @ R - (P.T @ R.T).T).max() < 1e-10 * abs(P).max()
    entries = P.tocoo()
    free = entries.data[entries.coords[0] != entries.coords[1]]
    assert (entries.data if discrete else free).min() >= 0


def test_few_facets_may_be_many():
    A = oscillations(1e-3)
    found = find_cone(A, few="facets")
    assert found and found.n_rays > LARGE and found.certificate.by_facets and found.certificate.check()
    assert found.cone.n_facets == found.n_rays


def test_what_is_wrong_with_sparse_multipliers_is_noticed():
    certificate = find_cone(oscillations(1e-3, 0.5)).certificate
    P = certificate.multipliers.values.tolil()
    i, j = 7, 1200
    for value in (-1e-9, 1e-3):
        wrong = P.copy()
        wrong[i, j] += value
        changed = replace(certificate, multipliers=Matrix(csr_array(wrong)))
        assert not changed.check()
    assert not replace(certificate, matrices=Matrix(certificate.matrices.values + 1e-2)).check()
    assert not replace(certificate, right_inverse=0 * certificate.right_inverse).check()


@pytest.mark.parametrize("kind", ["rays", "facets", "discrete", "inputs and outputs"])
def test_a_reader_without_this_package_can_check_them(tmp_path, kind):
    A, path = oscillations(2e-3, discrete=kind == "discrete"), tmp_path / "cone.json"
    e = np.linalg.svd(A)[2][-1]
    ports = {"contains": [e + 0.1 * np.eye(3)[0]], "within": [e]} if kind == "inputs and outputs" else {}
    found = find_cone(A, few="facets" if kind == "facets" else "rays", discrete=kind == "discrete", **ports)
    assert found.n_rays > LARGE and found.certificate.multipliers.is_sparse
    found.certificate.save(path)
    loaded = load_certificate(path)
    assert loaded.status is Status.PROVED and loaded.check() and checker.main(path) == 0
    content = json.loads(path.read_text())
    entries = content["proof"]["P"][0]["sparse"]
    for change in ("0x1.p-30", "-0x1.p-30"):  # of one weight: the equation, or a sign
        wrong = [[*entries[0][:2], change], *entries[1:]]
        path.write_text(
            json.dumps({**content, "proof": {**content["proof"], "P": [{**content["proof"]["P"][0], "sparse": wrong}]}})
        )
        assert checker.main(path) == 1


def test_proofs_that_would_be_too_long_are_left_out(tmp_path):
    found = find_cone(oscillations(*[1e-3] * 3))
    found.certificate.save(tmp_path / "cone.json")
    assert load_certificate(tmp_path / "cone.json").check()
    assert checker.main(tmp_path / "cone.json") == 2


@pytest.mark.parametrize("ratio", [1e-3, 5e-5])
def test_with_inputs_and_outputs(ratio):
    sys = ct.ss(oscillations(ratio, 0.7, seed=2), np.eye(5), np.eye(5), 0)
    e = np.linalg.svd(sys.A)[2][-1]
    found = find_cone(sys.A, contains=[e + 0.1 * np.eye(5)[0]], within=[e])
    assert found and found.n_rays > LARGE and found.certificate.multipliers.is_sparse and found.certificate.check()
    assert (found.rays @ e > 0).all()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4), st.booleans(), st.booleans())
def test_multipliers_in_closed_form_satisfy_their_equation(seed, pairs, discrete, thin):
    rng = np.random.default_rng(seed)
    A = oscillations(*10.0 ** rng.uniform(-2, 1, pairs), seed=seed, discrete=discrete)
    if discrete:
        A = A * rng.uniform(0.1, 10)
    m = modes(A, discrete=discrete)
    candidate = None if m is None else modal_cone(m, discrete=discrete, thin=thin)
    if candidate is None:
        return
    R, P = candidate.R, candidate.multipliers.combined()
    P = P.toarray() if candidate.multipliers.is_thin else P
    size = np.abs(P).max()
    assert np.abs(A @ R - R @ P).max() < 1e-9 * size
    assert P[~np.eye(len(P), dtype=bool)].min(initial=0) >= -1e-12 * size
    assert not discrete or np.diag(P).min() >= -1e-12 * size
    weights = candidate.multipliers.weights
    np.testing.assert_allclose(R @ weights, m.right, atol=1e-9)
    assert weights.min() >= 0 and (thin or weights.min() > 0)
    np.testing.assert_allclose(R @ candidate.right_inverse, np.eye(len(A)), atol=1e-6)
