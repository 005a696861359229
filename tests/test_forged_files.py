"""Files whose parts are all proven, but do not prove what they say together: both readers refuse them."""

import json
from fractions import Fraction

import certified
import numpy as np
import pytest
import tampering

import control_kpos as kp
from control_kpos import checker
from control_kpos.errors import CertificateFileError
from control_kpos.families.common_vector import CommonVectorCertificate


def content_of(certificate, path):
    certificate.save(path)
    return json.loads(path.read_text())


def part(content):
    """A file as it stands inside another."""
    return {"certificate": {name: content[name] for name in ("claim", "status", "data", "proof")}}


def both_refuse(content, path):
    path.write_text(json.dumps(tampering.redigested(content)))
    with pytest.raises(CertificateFileError):
        kp.load_certificate(path)
    assert checker.main(path) != 0


def any_size(local, weight, status, link=((1,),)):
    data = {"local": part(local), "weight": {"double": weight}, "link": {"array": [list(row) for row in link]}}
    return {"format": "kpos-certificate/1", "claim": "out-weight", "status": status, "data": data, "proof": {}}


@pytest.mark.parametrize(("weight", "supply"), [(0, 0.4), (1, 0.4), (1, 1.1)])
def test_supplies_that_do_not_do_refute_no_network_of_any_size(weight, supply, tmp_path):
    """x' = -2 x + w y is stable although these supplies prove nothing."""
    local = certified.network([certified.node(-2)], [[weight]], supply_rates=[([-1], [supply])])
    assert local.status.name == "REFUTED"
    both_refuse(any_size(content_of(local, tmp_path / "c.json"), weight, "REFUTED"), tmp_path / "c.json")


def test_networks_of_any_size_have_the_links_of_nodes_to_themselves(tmp_path):
    """With the links as parts of the nodes W is zero, and (III) says nothing of them."""
    node = kp.ConeStateSpace([[-1, 1], [0, -1]], [[1, 0], [0, 1]], [[1, 0]], [[0, 0]])
    closed = certified.network([node], [[-1], [0]])
    local = content_of(closed, tmp_path / "c.json")
    assert local["data"]["own_links_closed"] and checker.main(tmp_path / "c.json") == 0
    both_refuse(any_size(local, 1, "PROVED", ((-1,), (0,))), tmp_path / "c.json")


@pytest.mark.parametrize("rate", [1, 0])
def test_a_node_that_is_unstable_by_itself_refutes_networks_without_weights(rate, tmp_path):
    refuted = kp.scale_free_certificate([certified.node(rate), certified.node(-2)], weight=0)
    assert refuted.status.name == "REFUTED"
    refuted.save(tmp_path / "c.json")
    assert checker.main(tmp_path / "c.json") == 1 and kp.load_certificate(tmp_path / "c.json").check()


# -- parts of a feedback


def files_of(name, path):
    return content_of(certified.CERTIFICATES[name](), path)


def with_parts(content, **parts):
    data = {name: {"tuple": list(map(part, files))} for name, files in parts.items()}
    return {**content, "data": {**content["data"], **data}}


def bare(content, name):
    return [p["certificate"] for p in content["data"][name]["tuple"]]


STRANGERS = {
    "a loop in another time": ("loops", lambda: kp.linear_lyapunov(np.eye(2) / 2, certified.PAPER, discrete=True)),
    "a loop of another size": ("loops", lambda: kp.linear_lyapunov(-np.eye(3), certified.SQUARE)),
    "a loop on another cone": ("loops", lambda: kp.linear_lyapunov(-np.eye(2), kp.orthant(2))),
    "a loop that is only positive": ("loops", lambda: kp.state_positivity(np.eye(2), certified.PAPER)),
    "a feedback as a loop": ("loops", lambda: certified.designed(gain_bound=[100.0])),
    "a feedback in a feedback": ("others", lambda: certified.designed(gain_bound=[100.0])),
    "a network": ("others", lambda: certified.network(certified.mass_springs(), kp.examples.ring(4))),
    "ports of another plant": ("others", lambda: kp.cone_positivity([[0, 1], [-22, -13]], *certified.PLANT)),
    "a loop on another cone beside": ("others", lambda: kp.linear_lyapunov(-np.eye(2), kp.orthant(2))),
    "a common vector of one": (
        "others",
        lambda: CommonVectorCertificate.of(
            (kp.state_positivity(-1000 * np.eye(2), certified.PAPER),), np.array([1.0, -1.0]), Fraction(0)
        ),
    ),
}


@pytest.mark.parametrize("name", STRANGERS)
def test_parts_of_a_feedback_are_about_one_thing(name, tmp_path):
    path, (kind, make) = tmp_path / "c.json", STRANGERS[name]
    content = files_of("feedback, common vector", path)
    stranger = make()
    assert stranger.status.name == "PROVED"
    parts = [*bare(content, kind), content_of(stranger, path)]
    both_refuse(with_parts(content, **{kind: parts}), path)


def test_a_common_vector_is_that_of_all_loops(tmp_path):
    content = files_of("feedback, common vector", tmp_path / "c.json")
    loops = bare(content, "loops")
    assert len(loops) == 2
    for wrong in (loops[:1], loops[::-1], [*loops, loops[0]]):
        both_refuse(with_parts(content, loops=wrong), tmp_path / "c.json")


def test_a_gain_from_disturbances_is_that_of_the_loop(tmp_path):
    one, other = (
        files_of(name, tmp_path / "c.json") for name in ("feedback, disturbance gain", "feedback, common vector")
    )
    both_refuse(with_parts(one, loops=bare(other, "loops")), tmp_path / "c.json")


# -- what belongs to other claims


@pytest.mark.parametrize(
    "name", ["positive", "stable", "dissipative", "network", "bracket", "cone", "network, unstable", "unstable"]
)
@pytest.mark.parametrize("key", ["radii", "source"])
def test_bounds_are_for_jacobians(key, name, tmp_path):
    content = files_of(name, tmp_path / "c.json")
    n = sum(count * len(factor["rays"][0]) for count, factor in content["data"]["X"]["cone"])
    said = {"tuple": [{"array": [[1000] * n] * n}]} if key == "radii" else "enclosed"
    both_refuse({**content, "data": {**content["data"], key: said}}, tmp_path / "c.json")


@pytest.mark.parametrize(
    "entry", [{"radii": {"tuple": []}}, {"source": "enclosed"}, {"decay_rate_bound": {"double": 1}}]
)
@pytest.mark.parametrize("name", ["feedback, common vector", "feedback, disturbance gain"])
def test_entries_that_say_nothing_in_a_part(name, entry, tmp_path):
    content = files_of(name, tmp_path / "c.json")
    content["data"]["others"]["tuple"][-1]["certificate"]["data"] |= entry
    both_refuse(content, tmp_path / "c.json")


# -- products that no cone allows

FAMILIES = {
    False: [[[0, 1], [0, 0]], [[0, 0], [-1, 0]]],  # resolvents of nilpotent matrices, one of them with the wrong sign
    True: [[[1, 1], [0, 1]], [[1, 0], [-1, 1]]],  # the product has the eigenvalues (1 +- i sqrt 3) / 2
}


def refuted_by_a_product(discrete, path):
    found = kp.find_cone(FAMILIES[discrete], discrete=discrete)
    content = content_of(found.certificate, path)
    assert content["data"]["witness"]["record"] == "PerronObstruction"
    assert kp.load_certificate(path).check() and checker.main(path) == 1
    return content


def _wrong_products():
    """What is changed in the witness, in the matrices and in the proof."""
    fields = {
        "one letter left out": {"cycle": [0], "shifts": [1]},
        "one shift left out": {"shifts": [1]},
        "no letters": {"cycle": [], "shifts": []},
        "the same matrix twice": {"cycle": [0, 0]},
        "another matrix": {"cycle": [0, 2]},
        "a matrix from the end": {"cycle": [0, -1]},
        "a power below 1, or a resolvent at an eigenvalue": {"shifts": [0, 1]},
        "a negative power, or a resolvent to the left of an eigenvalue": {"shifts": [-1, -1]},
        "a bound beyond all eigenvalues": {"bound": "1000000"},
        "a negative bound": {"bound": "-1/2"},
    }
    for name, changed in fields.items():
        yield name, {"fields": changed}
    yield "matrices that have a common cone", {"matrices": [[[0, 1], [0, 0]], [[0, 0], [1, 0]]]}
    yield "one matrix", {"matrices": [[[0, 1], [0, 0]]]}
    yield "the status", {"status": "PROVED"}
    yield "no disc", {"z": None}
    yield "a disc inside", {"z": [0, 0, 0]}
    yield "a disc too large", {"z": [2, 0, 3]}
    yield "a disc without eigenvalues", {"z": [1000, 1000, 1]}


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize(("name", "change"), list(_wrong_products()))
def test_products_that_do_not_exclude_cones(name, change, discrete, tmp_path):
    content = refuted_by_a_product(discrete, tmp_path / "c.json")
    said = content["data"]["witness"]["fields"]
    kinds = {"cycle": ("tuple", "tuple"), "shifts": ("fractions", "tuple"), "bound": ("fraction", "fraction")}
    for key, value in change.get("fields", {}).items():
        said[key] = {kinds[key][not value]: value}
    content["data"]["matrices"]["matrix"] = change.get("matrices", content["data"]["matrices"]["matrix"])
    content["status"] = change.get("status", content["status"])
    content["proof"] = {"z": change["z"]} if "z" in change else content["proof"]
    both_refuse(content, tmp_path / "c.json")


def test_a_product_in_another_time(tmp_path):
    """Resolvents are not powers: 0.03 is no power, and 1 is an eigenvalue of the matrices of the other family."""
    for discrete in (False, True):
        content = refuted_by_a_product(discrete, tmp_path / "c.json")
        content["data"]["discrete"] = not discrete
        both_refuse(content, tmp_path / "c.json")
