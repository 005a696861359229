"""Entries of certificate files: each of its kind, none that nobody reads, all text printable."""

import json

import certified
import numpy as np
import pytest
import tampering

import control_kpos as kp
from control_kpos import checker
from control_kpos.__main__ import main
from control_kpos.errors import CertificateFileError
from control_kpos.proof.files import load_certificate

EVERY = certified.CERTIFICATES


def changed_by(name, change, path):
    """A saved certificate in which a function changed the content."""
    EVERY[name]().save(path)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(tampering.redigested(content)))


def at(*path):
    """What sets the entry at a path below `data`."""
    *inner, value = path

    def change(content):
        tampering.at(content["data"], inner[:-1])[inner[-1]] = value

    return change


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("stable, tightest rate", at("decay_rate_bound", {"fraction": "2"})),
        ("stable", at("decay_rate", {"array": [1]})),
        ("stable, at a rate", at("required_rate", {"double": (0.25).hex()})),
        ("dissipative", at("decay_rate", {"array": [1]})),
        ("network", at("decay_rate", {"fraction": "1/3"})),
        ("network, unstable", at("witness", "fields", "rate", {"array": [0]})),
        ("bracket", at("lower", {"array": [-2]})),
        ("bracket", at("upper", {"fraction": "-1"})),
        ("any number of nodes, exact link", at("weight", {"array": [1]})),
        ("not any feedback", at("rate", {"array": [0]})),
        ("not positive", at("witness", "fields", "ray", {"double": 1})),
        ("stable", at("v", "more", 1)),
        ("network, discrete", at("dt", {"double": "inf"})),
        ("network, discrete", at("dt", {"double": "nan"})),
    ],
)
def test_numbers_of_another_kind_are_refused(name, change, tmp_path, capsys):
    changed_by(name, change, tmp_path / "c.json")
    with pytest.raises(CertificateFileError):
        load_certificate(tmp_path / "c.json")
    assert main(["check", str(tmp_path / "c.json")]) == 2
    assert capsys.readouterr().out.startswith("UNREADABLE")


@pytest.mark.parametrize("path", [("claim",), ("status",), ("proof", "omitted"), ("data", "decay_rate", "double")])
def test_half_characters_are_refused_in_words(path, tmp_path, capsys):
    EVERY["stable"]().save(tmp_path / "c.json")
    content = json.loads((tmp_path / "c.json").read_text())
    tampering.at(content, path[:-1])[path[-1]] = "\ud800"
    (tmp_path / "c.json").write_text(json.dumps(tampering.redigested(content)))
    with pytest.raises(CertificateFileError):
        load_certificate(tmp_path / "c.json")
    assert checker.main(tmp_path / "c.json") == 2
    assert main(["check", str(tmp_path / "c.json")]) == 2
    capsys.readouterr().out.encode()


def test_characters_outside_of_the_first_plane_stay(tmp_path):
    nodes = [kp.ConeStateSpace([[-1]], [[1]], [[1]], 0, name=name) for name in ("\U0001f600", "é")]
    certificate = kp.feedback_interconnect(nodes, [[0, 0], [0, 0]]).certificate
    certificate.save(tmp_path / "c.json")
    assert load_certificate(tmp_path / "c.json") == certificate and checker.main(tmp_path / "c.json") == 0


@pytest.mark.parametrize("rate", ["inf", "nan"])
def test_what_is_read_as_undecided_can_be_saved_again(rate, tmp_path):
    def forged(content):
        content["status"] = "UNDECIDED"
        content["data"]["witness"]["fields"]["rate"] = {"double": rate}

    changed_by("network, unstable", forged, tmp_path / "c.json")
    certificate = load_certificate(tmp_path / "c.json")
    assert certificate.status is kp.Status.UNDECIDED
    certificate.save(tmp_path / "c.json")
    assert checker.main(tmp_path / "c.json") == 1


def test_underflow_is_no_error_in_files(tmp_path):
    with np.errstate(all="raise"):
        X = kp.PolyhedralCone([[1, 1, 1], [1, -1, 2.0**-1074], [-1, 1, 1], [-1, -1, 1]])
        certificate = kp.linear_lyapunov(np.diag([-1, -1, 0.5]), X)
        certificate.save(tmp_path / "c.json")
        again = load_certificate(tmp_path / "c.json")
        assert again == certificate and again.check() and again.status is kp.Status.REFUTED


DOUBLE = (
    [{"double": "0x1.8p+1"}, {"double": 3}, {"double": "3.0"}],
    [
        *(
            3,
            "3",
            {"fraction": 3},
            {"array": [3]},
            {"fractions": [3]},
            {"double": "10/3"},
            {"double": "2.9"},
            {"double": [3]},
        ),
        *(
            {"double": {"double": 3}},
            {"double": True},
            {"double": None},
            {"double": 3, "more": 1},
            [3],
            {},
            {"double": "1e0"},
        ),
    ],
)
FRACTION = (
    [{"fraction": "1/3"}, {"fraction": "0x1/0x3"}, {"fraction": "0.25"}],
    [
        *(
            "1/3",
            {"double": "0x1p-2"},
            {"fractions": ["1/3"]},
            {"array": [0]},
            {"fraction": ["1/3"]},
            {"fraction": "1/-3"},
            [1],
        ),
    ],
)
VECTOR_OF_TWO = (
    [{"array": [1, 1]}, {"array": ["0x1p+0", "1.0"]}],
    [
        *(
            [1, 1],
            {"array": [[1, 1]]},
            {"array": [[1], [1]]},
            {"array": [1, [1]]},
            {"array": [1]},
            {"array": [1, "4/3"]},
        ),
        *(
            {"fractions": [1, 1]},
            {"matrix": [[1, 1]]},
            {"tuple": [1, 1]},
            {"array": [1, 1], "more": 1},
            {"array": [1, "nan"]},
        ),
    ],
)
MATRIX_OF_TWO = (
    [
        {"matrix": [[-2, 1], ["1/2", "-2.0"]]},
        {"sparse": [[0, 0, -2], [0, 1, 1], [1, 0, "0.5"], [1, 1, -2]], "shape": [2, 2]},
    ],
    [
        *(
            [[-2, 1], [0, -2]],
            {"array": [[-2, 1], [0, -2]]},
            {"matrix": [[[-2, 1], [0, -2]]]},
            {"matrix": [[-2, 1], [0]]},
        ),
        *({"sparse": [[0, 0, -2], [0, 0, -2]], "shape": [2, 2]}, {"sparse": [[0, 0, "-7/3"]], "shape": [2, 2]}),
        *({"sparse": [[0, 0, -2], [1, 1, -2]], "shape": [2, 3]}, {"sparse": [[0, 0, -2], [1, 1, -2]]}),
    ],
)


@pytest.mark.parametrize(
    ("entry", "form", "accepted"),
    [
        (entry, form, k == 0)
        for entry, kinds in (
            ("decay_rate", DOUBLE),
            ("required_rate", FRACTION),
            ("v", VECTOR_OF_TWO),
            ("A", MATRIX_OF_TWO),
        )
        for k, forms in enumerate(kinds)
        for form in forms
    ],
)
def test_both_readers_have_one_grammar(entry, form, accepted, tmp_path, capsys):
    """A matrix, a vector and rates of a system that decays at 3: what is read is decided alike, or refused."""
    kp.linear_lyapunov([[-4, 1], [1, -4]], kp.orthant(2), rate="1/3").save(tmp_path / "c.json")
    content = json.loads((tmp_path / "c.json").read_text())
    content["data"] |= {"decay_rate": {"double": 0}, "required_rate": {"fraction": "1/4"}, "v": {"array": [1, 1]}}
    content["data"][entry] = form
    (tmp_path / "c.json").write_text(json.dumps(tampering.redigested(content)))
    status = 0 if accepted else 2
    assert checker.main(tmp_path / "c.json") == status == main(["check", str(tmp_path / "c.json")])
    if not accepted:
        with pytest.raises(CertificateFileError) as refusal:
            load_certificate(tmp_path / "c.json")
        assert type(refusal.value) is CertificateFileError
    capsys.readouterr()


LOCAL = ("local", "certificate", "data")
COMMON = ("others", "tuple", 0, "certificate", "data")
GAIN = ("others", "tuple", 1, "certificate", "data")
VECTOR = {"array": [5, 7]}


def unread(*path):
    """What sets an entry that means nothing there."""
    return at(*path, {"fraction": "1/3"})


@pytest.mark.parametrize(
    ("name", "change"),
    [
        *((name, unread("foo")) for name in ("stable", "network", "bracket", "cone", "any number of nodes")),
        *((name, unread("required_rate")) for name in ("bracket", "dissipative", "not any feedback", "Jacobians")),
        *(("feedback, common vector", unread(*COMMON, key)) for key in ("foo", "decay_rate_bound", "source", "member")),
        ("feedback, common vector", at(*COMMON, "slow_direction", VECTOR)),
        ("feedback, common vector", at(*COMMON, "x", VECTOR)),
        *(("feedback, disturbance gain", unread(*GAIN, key)) for key in ("upper", "member", "foo")),
        ("any number of nodes", unread(*LOCAL, "foo")),
        ("bracket", at("v_exact", {"fractions": ["5", "7"]})),
        ("bracket", unread("model")),
        ("network", at("loop_weights", {"tuple": [VECTOR, VECTOR]})),
        ("network", at("slow_direction", VECTOR)),
        ("cone", at("U", {"tuple": []})),
        ("cone with ports", at("U", {"cone": [[1, {"rays": [[-1]], "w": [-1], "Z": [[-1]]}]]})),
        ("cone with ports", at("Y", None)),
        *(
            (name, at(key, value))
            for name in ("unstable", "not stable, at a rate", "unstable because not positive")
            for key, value in {
                "v": VECTOR,
                "slow_direction": VECTOR,
                "v_exact": {"fractions": ["5", "7"]},
                "slow_direction_exact": {"fractions": ["5", "7"]},
            }.items()
        ),
        ("unstable", at("v", {"array": ["nan", 7]})),
        ("not dissipative", at("v", {"array": [1]})),
        ("network, unstable", at("v", {"array": [[1, 1]] * 4})),
        ("network, unstable", at("sigma", {"array": [1] * 4})),
        ("network, not to be weighted", at("v", {"array": [[1], [1]]})),
        ("Jacobians, one not positive", at("v", VECTOR)),
        ("not any cone, ahead", at("v", VECTOR)),
    ],
)
def test_entries_that_nobody_reads_are_refused(name, change, tmp_path):
    changed_by(name, change, tmp_path / "c.json")
    with pytest.raises(CertificateFileError):
        load_certificate(tmp_path / "c.json")
    assert checker.main(tmp_path / "c.json") != 0


def test_entries_that_are_null_may_stay(tmp_path):
    for name in ("network", "bracket"):
        changed_by(name, at("anything", None), tmp_path / "c.json")
        assert load_certificate(tmp_path / "c.json").check()


def test_weights_of_a_loop_stand_where_they_are_needed(tmp_path, capsys):
    """With feedthrough: beside a node that does not satisfy its supply rate nothing is said of the loop."""
    node = kp.ConeStateSpace([[-1]], [[1]], [[1]], [[0.1]])
    c = kp.feedback_interconnect([node] * 2, [[0, 0.1], [0.1, 0]], supply_rates=[([-1], [0.01])] * 2).certificate
    assert c.status is kp.Status.REFUTED
    c.save(tmp_path / "rates.json")
    assert kp.load_certificate(tmp_path / "rates.json") == c and checker.main(tmp_path / "rates.json") == 1
    assert capsys.readouterr().out.startswith("REFUTED")


def test_a_certificate_that_proves_nothing_comes_back_from_its_file(tmp_path, capsys):
    proven = kp.linear_lyapunov([[-2, 1], [1, -2]], kp.orthant(2))
    undecided = type(proven).settle(positivity=proven.positivity)
    undecided.save(tmp_path / "c.json")
    assert load_certificate(tmp_path / "c.json") == undecided and undecided.status is kp.Status.UNDECIDED
    assert main(["check", str(tmp_path / "c.json")]) == 1 and checker.main(tmp_path / "c.json") == 1
    assert "UNDECIDED" in capsys.readouterr().out
