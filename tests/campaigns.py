"""Random systems whose truth is known exactly, at any number; tests run few of them and the campaign many.

A Metzler matrix is Hurwitz if and only if all leading principal minors of its negative are positive, which
rational arithmetic decides.  Other cones come from unimodular changes of coordinates, which are exact.
"""

import contextlib
import hashlib
import json
import os
import random
import resource
import select
import signal
import time
from fractions import Fraction

import hostile
import numpy as np
import tampering

import control_kpos as kp
from control_kpos import checker
from control_kpos.design.certificates import GainBoundCertificate
from control_kpos.errors import CertificateFileError, FalseClaimError, UndecidedError
from control_kpos.exact.intake import exact_matrix
from control_kpos.families.common_vector import CommonVectorCertificate
from control_kpos.proof.encoding import Decoder
from control_kpos.proof.numerals import number
from control_kpos.proof.portable_cones import decode_cone


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


def judged(content, path):
    """What the package and the checker say of a file: its status, or WRONG or UNREADABLE."""
    path.write_text(json.dumps(content))
    try:
        certificate = kp.load_certificate(path)
        package = certificate.status.name if certificate.check() else "not checked"
    except FalseClaimError:
        package = "WRONG"
    except CertificateFileError:
        package = "UNREADABLE"
    try:
        checker.verify(content, len(path.read_text()) + 20_000)
        return package, content["status"]
    except checker.Wrong:
        return package, "WRONG"
    except Exception:  # noqa: BLE001 - whatever it raises
        return package, "UNREADABLE"


def divided(contents, count, seed, path):
    """Files with one thing changed of which the readers say two things; and how many are accepted."""
    out, accepted, rng = [], 0, random.Random(seed)
    for content in contents:
        every = list(tampering.single_changes(content))
        for place, other in rng.sample(every, min(count, len(every))):
            said = judged(tampering.replaced(content, place, other), path)
            accepted += said[1] in ("PROVED", "REFUTED")
            if len(set(said)) > 1:
                out.append((place, other, *said))
    return out, accepted


def truth(content, path):
    """What the package says about a file, or decides afresh about its system; None if it refuses the data."""
    try:
        return kp.load_certificate(path).status.name
    except CertificateFileError as error:
        told = str(error).partition("its data give ")[2].partition(" ")[0]
    if told != "UNDECIDED":
        return told or None
    decoder = Decoder(10**4, lambda *_: None, decode_cone)
    claim, data = content["claim"], content["data"]
    read = {
        key: decoder.value(data[key]) for key in ("A", "B", "C", "D", "W", "X", "U", "Y", "discrete") if key in data
    }
    if isinstance(read.get("A"), tuple) and "v" in data:
        return truth_of_family(read, content)
    if claim == "positive":
        return kp.cone_positivity(**read).status.name
    rate = decoder.value(data["required_rate"]) if "required_rate" in data else None
    if claim == "stable":
        return kp.linear_lyapunov(read["A"], read["X"], discrete=read["discrete"], rate=rate).status.name
    if claim in ("dissipative", "disturbance gain") and None not in (data["q"], data["r"]):
        q, r = (list(map(number, data[key]["array"])) for key in "qr")
        return kp.dissipativity(**read, q=q, r=r).status.name
    if claim == "network" and not rational(read["D"]).any() and content["proof"].get("shows", "growth") == "growth":
        return closed_loop_truth(read, rate)
    return None  # its witness was changed, which the proof does not need


def truth_of_family(read, content):
    """PROVED or REFUTED for every matrix of a family, positivity alone where no vector is claimed."""
    single = kp.state_positivity if content["data"]["v"] is None else kp.linear_lyapunov
    found = [single(A, read["X"], discrete=read["discrete"]).status.name for A in read["A"]]
    return "PROVED" if all(name == "PROVED" for name in found) else "REFUTED"


def rational(m):
    """An exact matrix, dense or sparse, as fractions."""
    return np.vectorize(Fraction, otypes=[object])(m.values.toarray()) if m.is_sparse else m.fractions()


def closed_loop_truth(read, rate):
    """Stability of A + B W C on X, at a rate if one was asked for, for nodes without feedthrough."""
    A, B, W, C = (rational(read[key]) for key in "ABWC")
    return kp.linear_lyapunov(A + B @ W @ C, read["X"], discrete=read["discrete"], rate=rate).status.name


def proper_cone(rng, n):
    """A random cone in R^n with more generators than dimensions."""
    while True:
        p = n + int(rng.integers(1, 4))
        cone = kp.PolyhedralCone(np.column_stack([rng.integers(-3, 4, (p, n - 1)), np.full(p, 4)]).astype(float))
        if cone.is_proper:
            return cone


def positive_matrix(rng, target, source):
    """A matrix that maps a cone into another, nearly or exactly."""
    M = rng.choice([0.1, 0.5]) * np.outer(target.interior_point, source.facets.sum(axis=0))
    return M / np.abs(M).max() + rng.choice([0.0, 1e-3]) * rng.integers(-2, 3, M.shape)


def random_certificate(rng):
    """A certificate of any claim, on random polyhedral cones, in continuous or discrete time."""
    n, discrete = int(rng.integers(2, 5)), bool(rng.random() < 0.4)
    X, U, Y = proper_cone(rng, n), kp.orthant(1), kp.orthant(2)
    if rng.random() < 0.3:
        U = Y = proper_cone(rng, 2)
    shift = 0.0 if discrete else float(rng.integers(0, 9))
    scale = 10.0 ** -int(rng.integers(0, 3))
    matrices = [scale * positive_matrix(rng, X, X) - shift * np.eye(n) for _ in range(int(rng.integers(1, 4)))]
    A, B, C = matrices[0], scale * positive_matrix(rng, X, U), positive_matrix(rng, Y, X)
    D = np.zeros((Y.dim, U.dim)) if rng.random() < 0.5 else 0.1 * positive_matrix(rng, Y, U)
    kind = int(rng.integers(7))
    if kind == 0:
        return kp.cone_positivity(A, B, C, D, X, U, Y, discrete=discrete)
    if kind == 1:
        return kp.linear_lyapunov(A, X, discrete=discrete, rate=rng.choice([None, "max"]))
    if kind == 2:
        q = -np.asarray(Y.dual.interior_point)
        r = None if rng.random() < 0.3 else 10.0 ** int(rng.integers(-3, 3)) * np.asarray(U.dual.interior_point)
        return kp.dissipativity(A, B, C, D, X, U, Y, q=q, r=r, discrete=discrete)
    if kind == 3:
        return kp.differential_positivity(matrices, X, discrete=discrete)
    if kind == 4:
        positive = tuple(kp.state_positivity(M, X, discrete=discrete) for M in matrices)
        return CommonVectorCertificate.settle(loops=positive, x=np.asarray(X.interior_point))
    if kind == 5:
        F = exact_matrix(rng.integers(-3, 4, (2, n)) / 4, "F")
        largest = np.abs(F.values @ np.asarray(X.rays).T).max(axis=1)
        return GainBoundCertificate.settle(F=F, bound=largest * rng.choice([0.9, 1.0, 2.0]), X=X)
    node = kp.ConeStateSpace(A, B, C, D, X=X, U=U, Y=Y, dt=True if discrete else 0)
    count = int(rng.integers(1, 4))
    W = np.kron(rng.integers(0, 2, (count, count)), positive_matrix(rng, U, Y)) * 10.0 ** -int(rng.integers(0, 4))
    rates = None
    if rng.random() < 0.3:
        q, r = -np.asarray(Y.dual.interior_point), np.asarray(U.dual.interior_point)
        rates = [(q, r * 10.0 ** int(rng.integers(-2, 3)))] * count
    return kp.feedback_interconnect([node] * count, W, supply_rates=rates).certificate


def disagreements(count, seed, path):
    """Random certificates of all claims: files on which the two readers differ; and how many there were of each."""
    rng, out, seen = np.random.default_rng(seed), [], {}
    for k in range(count):
        state = rng.bit_generator.state
        try:
            certificate = random_certificate(rng)
        except UndecidedError:
            continue
        name = f"{certificate.claim} {certificate.status.name}"
        seen[name] = seen.get(name, 0) + 1
        if certificate.status is kp.Status.UNDECIDED:
            continue
        certificate.save(path)
        content = json.loads(path.read_text())
        try:
            checker.verify(content, 10**5)
            agreed = kp.load_certificate(path).status.name == content["status"] == certificate.status.name
        except Exception as error:  # noqa: BLE001 - whatever it is, they do not agree
            out.append((k, name, repr(error), state))
            continue
        if not agreed:
            out.append((k, name, "status", state))
    return out, seen


def verdicts(count, seed):
    """What is decided about random systems of all kinds, small and large, as lines of text."""
    rng, out = np.random.default_rng(seed), []
    for k in range(count):
        A = near_margin(rng)
        out.append(f"{k} {kp.linear_lyapunov(A, kp.orthant(len(A))).status.name}")
        try:
            certificate = random_certificate(rng)
            out.append(f"{k} {certificate.claim} {certificate.status.name}")
        except UndecidedError:
            out.append(f"{k} undecided")
        if k % 20 == 0:
            A = rng.random((150, 150))
            A -= np.diag(A.sum(axis=1)) + 10.0 ** -rng.integers(8, 15) * rng.choice([-1, 1]) * np.eye(150)
            out.append(f"{k} large {kp.linear_lyapunov(A, kp.orthant(150)).status.name}")
    return out


def digest(count, seed):
    """SHA-256 of the verdicts: the same on every machine, with any number of threads, and in every Python."""
    return hashlib.sha256("\n".join(verdicts(count, seed)).encode()).hexdigest()


def hostile_files(folder):
    """Every hostile file, written into a folder: pairs of name and path."""
    linear = kp.linear_lyapunov([[-2, 1, 0, 0], [1, -2, 0, 0], [0, 0, -1, 0], [0, 0, 0, -1]], kp.orthant(4))
    linear.save(folder / "good.json")
    for k, (name, text) in enumerate(hostile.texts(json.loads((folder / "good.json").read_text()))):
        path = folder / f"{k}.json"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        yield name, path
    for k, (name, members) in enumerate(hostile.archives()):
        hostile.write_archive(folder / f"{k}.npz", members)
        yield name, folder / f"{k}.npz"


def cost(read, path):
    """Seconds, megabytes and outcome of a reader on a file, in a process of its own; 60 seconds at most."""
    receiver, sender = os.pipe()
    child = os.fork()
    if child == 0:
        before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
        with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
            try:
                outcome = str(getattr(read(path), "status", "read"))
            except Exception as error:  # noqa: BLE001 - told to the parent
                outcome = type(error).__name__
        more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        os.write(sender, f"{time.perf_counter() - start} {more / 1024} {outcome}".encode())
        os._exit(0)
    os.close(sender)
    if not select.select([receiver], [], [], 60)[0]:
        os.kill(child, signal.SIGKILL)
    answer = os.read(receiver, 1000).decode().split(maxsplit=2) or ["60", "nan", "killed"]
    os.close(receiver)
    os.waitpid(child, 0)
    return float(answer[0]), float(answer[1]), answer[2]


def half_written(count, seed, path):
    """Kills of a process that writes two certificates in turn, after which the file is neither of them."""
    rng, out = np.random.default_rng(seed), []
    pair = [kp.linear_lyapunov(sign * np.eye(6) + 0.01, kp.orthant(6)) for sign in (-1, 1)]
    pair[0].save(path)
    for k in range(count):
        child = os.fork()
        if child == 0:
            while True:
                for certificate in pair:
                    certificate.save(path)
        time.sleep(0.05 * rng.random())
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        try:
            if kp.load_certificate(path).status is kp.Status.UNDECIDED:
                out.append((k, "undecided"))
        except CertificateFileError as error:
            out.append((k, str(error)))
    return out
