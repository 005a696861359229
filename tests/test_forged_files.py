"""Files whose parts are all proven, but do not prove what they say together: both readers refuse them."""

import json

import certified
import pytest
import tampering

import control_kpos as kp
from control_kpos import checker
from control_kpos.errors import CertificateFileError


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
    assert checker.main(path) == 1


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
