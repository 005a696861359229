"""Random systems whose truth is known exactly, at any number; tests run few of them and the campaign many.

A Metzler matrix is Hurwitz if and only if all leading principal minors of its negative are positive, which
rational arithmetic decides.  Other cones come from unimodular changes of coordinates, which are exact.
"""

import json
from fractions import Fraction

import numpy as np
import tampering

import control_kpos as kp
from control_kpos.certificates import checker
from control_kpos.certificates.encoding import Decoder
from control_kpos.certificates.portable_cones import decode_cone
from control_kpos.errors import CertificateFileError, KposError


def hurwitz(A):
    """Exact truth for a Metzler matrix of doubles: positive leading principal minors of -A."""
    M = [[-Fraction(float(x)) for x in row] for row in A]
    for k in range(len(M)):
        if M[k][k] <= 0:
            return False
        for i in range(k + 1, len(M)):
            factor = M[i][k] / M[k][k]
            M[i] = [a - factor * b for a, b in zip(M[i], M[k], strict=True)]
    return True


def near_margin(rng):
    """A Metzler matrix with an eigenvalue close to zero on either side, in uneven units, sometimes reducible."""
    n = int(rng.integers(2, 5))
    A = rng.integers(0, 4, (n, n)) * rng.choice([1.0, 0.1, 1 / 3]) * (rng.random((n, n)) < 0.8)
    np.fill_diagonal(A, 0)
    A -= np.diag(A.sum(axis=1) * (rng.random(n) < 0.9))
    A -= np.eye(n) * float(rng.choice([-1, 0, 1])) * 10.0 ** -rng.integers(0, 18)
    units = 10.0 ** rng.integers(-6, 7, n) if rng.random() < 0.5 else np.ones(n)
    return A / units[:, None] * units


def unimodular(rng, n):
    """Integer T and its integer inverse."""
    T, S = np.eye(n), np.eye(n)
    for _ in range(3):
        i, j = rng.choice(n, 2, replace=False)
        step = float(rng.integers(-2, 3))
        T[i] += step * T[j]
        S[:, j] -= step * S[:, i]
    return T, S


def wrong_verdicts(count, seed):
    """Near-marginal systems, and their verdicts that are false or missing."""
    rng, out = np.random.default_rng(seed), {"false": [], "undecided": 0, "stable": 0}
    for _ in range(count):
        A = near_margin(rng)
        truth = hurwitz(A)
        certificate = kp.linear_lyapunov(A, kp.orthant(len(A)))
        out["stable"] += truth
        if certificate.status is kp.Status.UNDECIDED:
            out["undecided"] += 1
        elif bool(certificate) is not truth or not certificate.check():
            out["false"].append(A)
    return out


def changed_verdicts(count, seed):
    """Systems whose verdict changes under a change that keeps the truth; and what the change was."""
    rng, out = np.random.default_rng(seed), []
    for _ in range(count):
        n = int(rng.integers(2, 5))
        M = rng.integers(0, 4, (n, n)).astype(float)
        np.fill_diagonal(M, -rng.integers(0, 9, n).astype(float))
        if rng.random() < 0.2:
            M[0, -1] = -1.0  # not Metzler
        verdict = kp.linear_lyapunov(M, kp.orthant(n)).status
        expected = kp.Status.PROVED if (M - np.diag(M.diagonal()) >= 0).all() and hurwitz(M) else kp.Status.REFUTED
        T, S = unimodular(rng, n)
        order = rng.permutation(n)
        rays = T.T
        doubled = np.vstack([rays, 3 * rays[0], rays.sum(axis=0)])
        power = 2.0 ** rng.integers(-500, 501)
        far = 2.0 ** rng.integers(-250, 251, n)
        tens = Fraction(10) ** int(rng.integers(-150, 151))  # doubles would round the generators
        variants = {
            "": (M, np.eye(n)),
            "similarity": (T @ M @ S, rays),
            "repeated and redundant generators": (T @ M @ S, doubled),
            "permutation": (M[np.ix_(order, order)], np.eye(n)),
            "scaled time": (M * power, np.eye(n)),
            "long and short generators": (T @ M @ S, rays * 2.0 ** rng.integers(-500, 501, (n, 1))),
            "generators times 10^k": (T @ M @ S, [[Fraction(int(x)) * tens for x in ray] for ray in rays]),
            "scaled states": (M * far[:, None] / far, np.eye(n)),
        }
        out += [
            (name, M)
            for name, (A, R) in variants.items()
            if kp.linear_lyapunov(A, kp.PolyhedralCone(R)).status is not expected
        ]
        if verdict is not expected:
            out.append(("orthant", M))
    return out


def contradictions(contents, count, seed, path):
    """Changed files that the checker accepts although their claim is false; and how many it accepts."""
    out, accepted = [], 0
    for k, content in enumerate(contents):
        for changed in tampering.mutants(content, count, seed + k):
            try:
                checker.verify(changed, 10**5)
            except Exception:  # noqa: BLE001 - refused
                continue
            accepted += 1
            path.write_text(json.dumps(changed))
            if truth(changed, path) not in (None, changed["status"]):
                out.append(changed)
    return out, accepted


def truth(content, path):
    """What the package says about a file, or decides afresh about its system; None if it refuses the data."""
    try:
        return kp.load_certificate(path).status.name
    except CertificateFileError as error:
        told = str(error).partition("its data give ")[2].partition(" ")[0]
    if told != "UNDECIDED":
        return told or None
    if content["claim"] not in ("positive", "stable"):
        return None  # its witness was changed, which the proof does not need
    decoder = Decoder(10**4, lambda *_: None, decode_cone)
    data = {key: decoder.value(content["data"][key]) for key in ("A", "B", "C", "D", "X", "U", "Y", "discrete")}
    if content["claim"] == "positive":
        return kp.cone_positivity(**data).status.name
    return kp.linear_lyapunov(data["A"], data["X"], discrete=data["discrete"]).status.name


def polyhedral_disagreements(count, seed, path):
    """Random systems on cones with more generators than dimensions: files on which the two readers differ."""
    rng, out = np.random.default_rng(seed), []
    for _ in range(count):
        n = int(rng.integers(3, 6))
        p = n + int(rng.integers(1, 4))
        rays = np.column_stack([rng.integers(-3, 4, (p, n - 1)), np.full(p, 4)]).astype(float)
        cone = kp.PolyhedralCone(rays)
        if not cone.is_proper:
            continue
        inside = np.asarray(cone.interior_point)
        A = rng.choice([0.1, 1.0]) * np.outer(inside, cone.facets.sum(axis=0)) - float(rng.integers(0, 9)) * np.eye(n)
        A += rng.choice([0.0, 1e-3]) * rng.integers(-2, 3, (n, n))
        try:
            certificate = kp.linear_lyapunov(A, cone)
            certificate.save(path)
            content = json.loads(path.read_text())
            checker.verify(content, 10**5)
            agreed = kp.load_certificate(path).status.name == content["status"] == certificate.status.name
        except (checker.Wrong, ValueError, ArithmeticError, KposError) as error:
            out.append((A, rays, repr(error)))
            continue
        if not agreed:
            out.append((A, rays, "status"))
    return out
