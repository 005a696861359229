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
