"""The independent checker: against the package, on changed files, and with its own operators changed."""

import ast
import json
import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import campaigns
import certified
import checker_bounded
import checker_chains
import checker_claims
import checker_compartments
import checker_cones
import checker_costs
import checker_data
import checker_delays
import checker_families
import checker_gains
import checker_intervals
import checker_nonlinear
import checker_observers
import checker_pieces
import checker_realizations
import checker_uncertain
import numpy as np
import pytest
import tampering
from checker_cases import BY_HAND, SIZES

import control_kpos as kp
from control_kpos import checker
from control_kpos.__main__ import main as command_line
from control_kpos.errors import CertificateFileError
from control_kpos.proof.portable_cones import encode_cone

SOURCE = Path(checker.__file__).read_text(encoding="utf-8")
OF_SHARDS = SOURCE[SOURCE.index("# -- networks in shards") : SOURCE.index("# -- files")]  # test_shards_checker
LIMIT = 10**5
LIMITS = SIZES + checker_costs.PAIRS + checker_nonlinear.PAIRS + checker_compartments.PAIRS + checker_realizations.PAIRS
HAND = BY_HAND | checker_pieces.CASES | checker_claims.CASES | checker_costs.COSTS | checker_intervals.CASES
HAND |= checker_cones.CASES | checker_families.CASES | checker_uncertain.CASES | checker_gains.CASES
HAND |= checker_chains.CASES | checker_delays.CASES | checker_nonlinear.CASES | checker_bounded.CASES
HAND |= checker_observers.CASES | checker_data.CASES | checker_compartments.CASES | checker_realizations.CASES


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The contents of a file of every kind, by name."""
    folder, out = tmp_path_factory.mktemp("files"), {}
    for name, make in certified.CERTIFICATES.items():
        make().save(folder / "file.json")
        out[name] = json.loads((folder / "file.json").read_text())
    return out


def outcome(names, content, limit=LIMIT):
    """PROVED or REFUTED, with its note, where the content proves it, WRONG where it does not, UNREADABLE."""
    try:
        note = names["verify"](content, limit)
        return f"{content['status']} ({note})" if note else content["status"]
    except names["Wrong"]:
        return "WRONG"
    except Exception:  # noqa: BLE001 - whatever it raises
        return "UNREADABLE"


@pytest.mark.parametrize("name", HAND)
def test_cases_by_hand(name):
    content, expected = HAND[name]
    assert outcome(vars(checker), content) == expected


def test_sizes_are_bounded():
    assert [outcome(vars(checker), content, limit) for content, limit, _ in LIMITS] == [case[2] for case in LIMITS]


# -- with the package


@pytest.mark.parametrize("seed", range(12))
def test_the_checker_finds_the_facets(seed):
    rng = np.random.default_rng(seed)
    n = 2 + seed % 4
    points = rng.integers(-3, 4, size=(n + int(rng.integers(0, 8)), n - 1))
    points = np.vstack([points, np.eye(n - 1, dtype=int), -np.eye(n - 1, dtype=int)])
    X = kp.PolyhedralCone(np.hstack([points, np.ones((len(points), 1), dtype=int)]))
    X = X if seed % 3 else kp.product([X, kp.orthant(1), X])
    found = checker.facets(checker.cone({"cone": encode_cone(X)}, LIMIT), LIMIT)
    rows = [[h.get(i, 0) / max(map(abs, h.values())) for i in range(X.dim)] for h in found]
    wanted = [[x / max(map(abs, h)) for x in h] for h in X.exact_facets.plain().fractions().tolist()]
    assert sorted(rows) == sorted(wanted)


@pytest.mark.parametrize("name", certified.CERTIFICATES)
def test_package_and_checker_agree(name, tmp_path, capsys):
    certificate = certified.CERTIFICATES[name]()
    expected = "REFUTED" if "not" in name.split() or "unstable" in name or "wrong" in name else "PROVED"
    assert certificate.status.name == expected
    certificate.save(tmp_path / "file.json")
    assert checker.main(tmp_path / "file.json") == (0 if certificate else 1)
    assert capsys.readouterr().out.split()[0] == certificate.status.name
    assert kp.load_certificate(tmp_path / "file.json").status is certificate.status
    assert command_line(["check", str(tmp_path / "file.json")]) == (0 if certificate else 1)
    assert "independent checker confirms" in " ".join(capsys.readouterr().out.split())


def test_what_the_checker_takes_for_given_is_said(tmp_path, capsys):
    certified.CERTIFICATES["Jacobians within bounds"]().save(tmp_path / "file.json")
    command_line(["check", str(tmp_path / "file.json")])
    said = " ".join(capsys.readouterr().out.split())
    assert "confirms it in rational arithmetic (given the bounds on the Jacobians)." in said


@pytest.mark.parametrize("name", certified.FOR_THE_PACKAGE)
def test_files_without_a_proof_say_so(name, tmp_path, capsys):
    certified.FOR_THE_PACKAGE[name]().save(tmp_path / "file.json")
    assert checker.main(tmp_path / "file.json") == 2
    assert "leaves out its proof" in capsys.readouterr().out
    command_line(["check", str(tmp_path / "file.json")])
    assert "Not checked independently" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("number", range(len(certified.CERTIFICATES)))
def test_changed_files_are_never_accepted_by_one_and_contradicted_by_the_other(number, files, tmp_path):
    name = list(certified.CERTIFICATES)[number]
    for content in tampering.mutants(files[name], 20, seed=number):
        verdict = outcome(vars(checker), content).split()[0]
        (tmp_path / "file.json").write_text(json.dumps(content))
        try:
            package = kp.load_certificate(tmp_path / "file.json").status.name
        except CertificateFileError:
            package = None
        if verdict in ("PROVED", "REFUTED") and package is not None:
            assert package == verdict


# -- files with one thing changed: both readers, and the command, say the same of them


@pytest.mark.parametrize("number", range(len(certified.CERTIFICATES)))
def test_readers_agree_on_files_with_one_thing_changed(number, files, tmp_path):
    """What is accepted, what is false and what is malformed; 40 changes of a kind, all if the profile is thorough."""
    content = files[list(certified.CERTIFICATES)[number]]
    count = 10**9 if os.environ.get("HYPOTHESIS_PROFILE") == "thorough" else 40
    wrong, _ = campaigns.divided([content], count, number, tmp_path / "file.json")
    assert not wrong, "\n".join(map(str, wrong[:20]))


OF_THE_CHECKER = [name for name in certified.CERTIFICATES if "four" in name or "generators" in name or "cone" in name]


@pytest.mark.parametrize("name", OF_THE_CHECKER)
def test_numbers_of_a_proof_are_read_by_both(name, files, tmp_path):
    """Cones with more generators than dimensions, and discs of eigenvalues: every number of their proofs matters."""
    content = files[name]
    of_cones = {"w", "Z"}
    changes = [(p, x) for p, x in tampering.single_changes(content) if p[0] == "proof" or of_cones.intersection(p)]
    for path, other in random.Random(0).sample(changes, min(60, len(changes))):
        said = campaigns.judged(tampering.replaced(content, path, other), tmp_path / "file.json")
        assert said[0] == said[1], (path, other, *said)


COMMAND = {"PROVED": 0, "REFUTED": 1, "WRONG": 1, "UNREADABLE": 2}


@pytest.mark.parametrize("number", range(len(certified.CERTIFICATES)))
def test_the_command_says_what_the_readers_say(number, files, tmp_path, capsys):
    content, path = files[list(certified.CERTIFICATES)[number]], tmp_path / "file.json"
    for place, other in random.Random(number).sample(list(tampering.single_changes(content)), 8):
        said = campaigns.judged(tampering.replaced(content, place, other), path)[0]
        assert command_line(["check", str(path)]) == COMMAND[said]
        assert capsys.readouterr().out.split()[0] == said


# -- the frame of a file


def test_it_runs_alone(tmp_path):
    copy = tmp_path / "alone.py"
    copy.write_text(SOURCE)
    certified.CERTIFICATES["stable"]().save(tmp_path / "file.json")
    for arguments, status in ((["file.json"], 0), (["nothing.json"], 2), ([], 2)):
        done = subprocess.run(
            [sys.executable, "-I", "-S", str(copy), *arguments],
            cwd=tmp_path,
            capture_output=True,
            check=False,
            timeout=60,
        )
        assert done.returncode == status and not done.stderr
        assert arguments or b"checker.py FILE" in done.stdout  # how it is used


def test_archives_are_left_to_the_package(tmp_path, capsys):
    certified.CERTIFICATES["stable"]().save(tmp_path / "file.npz")
    assert checker.main(tmp_path / "file.npz") == 2
    assert "python -m control_kpos check reads it" in capsys.readouterr().out


def test_it_is_a_command_without_warnings(tmp_path):
    certified.CERTIFICATES["stable"]().save(tmp_path / "file.json")
    command = [sys.executable, "-W", "error::RuntimeWarning", "-m", "control_kpos.checker", str(tmp_path / "file.json")]
    done = subprocess.run(command, capture_output=True, check=False, timeout=60)
    assert done.returncode == 0 and not done.stderr


def test_it_stands_alone():
    modules = {n.split(".")[0] for node in ast.walk(ast.parse(SOURCE)) for n in imported(node)}
    assert modules <= sys.stdlib_module_names


def imported(node):
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [("." * node.level) + (node.module or "")] if isinstance(node, ast.ImportFrom) else []


def texts(content):
    """Texts of a file that is in order, and what exit status they deserve."""
    good = json.dumps(tampering.redigested({"format": "kpos-certificate/1", **content}))
    yield good, 0
    yield json.dumps({**json.loads(good), "format": "kpos-certificate/2"}), 2
    yield json.dumps({**json.loads(good), "digest": "sha256:0"}), 2
    yield good[:-1] + ', "claim": "stable"}', 2
    yield good[:-1] + ', "producer": 12345678901234567890, "semantics": "binary"}', 0
    yield good[:-1] + ', "producer": 123456789012345678901}', 2
    yield good[:-1] + ', "producer": 1.5}', 2
    yield good[:-1] + ', "producer": NaN}', 2
    yield good[:-1] + ', "note": 1}', 2
    yield good[:-1], 2
    yield "", 2
    refuted = BY_HAND["a witness"][0]
    yield json.dumps(tampering.redigested({"format": "kpos-certificate/1", **refuted})), 1
    yield json.dumps(tampering.redigested({"format": "kpos-certificate/1", **BY_HAND["constant"][0]})), 1


def test_frames(tmp_path, capsys):
    for k, (text, status) in enumerate(texts(BY_HAND["stable"][0])):
        (tmp_path / "file.json").write_text(text)
        assert checker.main(tmp_path / "file.json") == status, k
    assert capsys.readouterr().out


# -- every comparison, sign, connective and negation of the checker matters

# Changes that leave every verdict as it is, and why.
EQUIVALENT = {
    "binary: abs(x.numerator) < 2 ** 53 -> abs(x.numerator) <= 2 ** 53": "2^53 is a double",
    "matrix: 0 <= j < n -> 0 <= j <= n": "column n is missing in the list of columns: an error either way",
    "dot: len(f) < len(x) -> len(f) <= len(x)": "f'x = x'f",
    "dot: len(f) < len(x) -> len(f) > len(x)": "f'x = x'f",
    "inside: a >= 0 -> a > 0": "entries that are zero are not stored",
    "system: a >= 0 -> a > 0": "entries that are zero are not stored",
    "jacobian: a >= 0 -> a > 0": "entries that are zero are not stored",
    "no_bounded_feedback: a >= 0 -> a > 0": "entries that are zero are not stored",
    "nonnegative: a >= 0 -> a > 0": "entries that are zero are not stored",
    "structured_gain: min(x.values()) > 0 -> min(x.values()) >= 0": "entries that are zero are not stored",
    "contracts: dot(p, y) > 0 -> dot(p, y) >= 0": "p'D u <= t'u, D U in Y, W Y in U: 0 <= t'W y < p'y",
    "changes: a > 0 -> a >= 0": "only signs of numbers that are not zero are compared",
    "changes: a > 0 -> a < 0": "the opposites change where the signs do",
    "root_ahead: re * value[0] - im * value[1] + a -> re * value[0] - im * value[1] - a": "sizes of -p, -p'",
    "root_beside: 2 * len(p) ** 2 -> 2 + len(p) ** 2": "an order N has degree phi(N) >= sqrt(N) but for N = 2 and 6",
    "root_beside: order - 1 -> order + 1": "orders 1 and 2 divide 3 and 4",
    "root_beside: len(p) - 1 -> len(p) + 1": "a positive factor of all coefficients",
    "at: value * x + a -> value * x - a": "p(x) and its opposite",
    "touching_response: 0 < low < high <= 1 -> 0 < low <= high <= 1": "no root is between a number and itself",
    "any_size: ratio >= 0 -> ratio > 0": "p'D u <= t'u, and D is not 0",
    "slopes: 0 <= own[i] < q -> 0 <= own[i] <= q": "there is no output q: an error either way",
    "differentially_positive_network: a >= 0 -> a > 0": "entries that are zero are not stored",
    "by_e: a > 0 -> a >= 0": "entries that are zero are not stored",
    "applied: x + a * y -> x - a * y": "p(M) V and its opposite",
    "dwells_long_enough: dot(v, x) > 0 -> dot(v, x) >= 0": "v'M x >= 0, so that v'A x < 0 needs v'x > 0",
    "mean_stable: dot(v, x) > 0 -> dot(v, x) >= 0": "where v'x = 0, (L'v)'x >= 0 as the cone is kept",
    "stabilising_switching: dot(v, x) > 0 -> dot(v, x) >= 0": "where v'x = 0, f'x >= 0 as the cone is kept",
    "from_data: a < 0 -> a <= 0": "entries that are zero are not stored",
    "from_data: h[i] < 0 -> h[i] <= 0": "entries that are zero are not stored",
    "from_data: dot(h, x) > 0 -> dot(h, x) >= 0": "where h'e = 0, h'(A + BF) e >= 0 as X is kept",
    "slope.get((i, j), Fraction(0)) + a * b -> slope.get((i, j), Fraction(0)) - a * b": "the sum has to be 0",
}


class Endless(BaseException):
    """The changed checker does not come to an end."""


def endless(*_):
    raise Endless


def functions_run(names, case):
    """Names of the functions of the checker that a file makes run."""
    run = set()
    sys.setprofile(lambda frame, *_: run.add(frame.f_code.co_name))
    try:
        outcome(names, *case)
    finally:
        sys.setprofile(None)
    return run


def notices(names, top, battery):
    """True if a file is judged differently, of those that make this function run."""
    for case, expected, run in battery:
        if top.name not in run:
            continue
        signal.setitimer(signal.ITIMER_VIRTUAL, 1)  # what runs for ever is noticed
        try:
            if outcome(names, *case) != expected:
                return True
        except Endless:
            return True
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    return False


def notices_a_frame(names, frames, path, capsys):
    for text, said in frames:
        path.write_text(text)
        if answer(names["main"], path, capsys) != said:
            return True
    return False


def answer(main, path, capsys):
    """Exit status and what is printed."""
    try:
        return main(path), capsys.readouterr().out
    except Exception:  # noqa: BLE001 - whatever it raises
        return None


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="nothing stops what runs for ever")
@pytest.mark.timeout(1800)
def test_changed_operators_are_noticed(files, tmp_path, capsys):
    """Files by hand are tried before those of the package."""
    source, path = SOURCE.split("if __name__")[0], tmp_path / "file.json"
    cases = [(case[0], LIMIT) for case in HAND.values()] + [case[:2] for case in LIMITS]
    cases += [(content, LIMIT) for content in files.values()]
    names = tampering.compiled(ast.parse(source), "changed")
    battery = [(case, outcome(names, *case), functions_run(names, case)) for case in cases]
    frames = []
    for text, _ in texts(BY_HAND["stable"][0]):
        path.write_text(text)
        frames.append((text, answer(names["main"], path, capsys)))
    previous, survivors, count = signal.signal(signal.SIGVTALRM, endless), [], 0
    try:
        for count, (where, top) in enumerate(tampering.changed_functions(source.replace(OF_SHARDS, "")), 1):  # noqa: B007
            with tampering.installed(top, names):
                known = any(where.endswith(text) for text in EQUIVALENT)
                if not known and not notices(names, top, battery) and not notices_a_frame(names, frames, path, capsys):
                    survivors.append(where)
    finally:
        signal.signal(signal.SIGVTALRM, previous)
    assert count > 400
    assert not survivors, "\n".join(survivors)


def test_harmless_changes_are_still_there():
    changes = [where for where, _ in tampering.changed_functions(SOURCE.split("if __name__")[0])]
    for text in EQUIVALENT:
        assert any(where.endswith(text) for where in changes), text
