"""Certificates in shards of states that grow, and of networks in one piece: package and checker say the same."""

import hashlib
import json
import random
import shutil

import numpy as np
import pytest
import random_networks
from network_examples import cycle, lag, random_masses
from sharded_networks import certified
from test_shards_agreement import by_checker, by_package, change, exchange, json_or_none, rebound
from test_shards_files import BAD_CERTIFICATES, BAD_NETWORKS, forge_array, forged

import control_kpos as kp
from control_kpos import checker
from control_kpos.shards import certifying


@pytest.fixture(scope="module")
def grown(tmp_path_factory):
    """A network with feedthrough in three shards, two stacks each, that grows."""
    place = tmp_path_factory.mktemp("grown")
    masses = random_masses(np.random.default_rng(0), 3)
    nodes = [s for j in range(3) for s in (lag(1.0 + j, D=0.25), masses.take(j))]
    found = certified(place, nodes, 30 * cycle(6), 3)
    assert found.status == "REFUTED" and found.whole is None
    assert (found.path / "shard-00001" / "p.npy").exists()
    return found.path.parent


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A network on the margin."""
    found = certified(tmp_path_factory.mktemp("whole"), [lag(1.0)] * 6, cycle(6), 3)
    assert found.status == "REFUTED" and found.whole is not None
    return found.path.parent


@pytest.fixture
def copies(grown, whole, tmp_path):
    return {"grown": shutil.copytree(grown, tmp_path / "grown"), "whole": shutil.copytree(whole, tmp_path / "whole")}


def vector(name, factor, p=1):
    return lambda folder: forge_array(folder, f"proof/{name}", lambda a: change(a, factor), p)


def stated(**entries):
    return lambda folder: forged(folder, lambda data: data.update(**entries))


def rewritten(change):
    """Another file in one piece, described as it is."""

    def forge(folder):
        path = folder / "proof" / "whole.json"
        path.write_text(change(path.read_text()))
        forged(folder, lambda data: data.update(whole={"sha256": hashlib.sha256(path.read_bytes()).hexdigest()}))

    return forge


def redigested(change):
    def apply(text):
        content = json.loads(text)
        change(content)
        data = json.dumps(content["data"], sort_keys=True, separators=(",", ":"))
        return json.dumps({**content, "digest": "sha256:" + hashlib.sha256(data.encode()).hexdigest()})

    return rewritten(apply)


def still(folder):
    for p in range(3):
        for name in "xuyz":
            forge_array(folder, f"proof/{name}", lambda a: 0 * a, p)


def z_exchanged(folder):
    one, two = (folder / "proof" / f"shard-0000{p}" / "z.npy" for p in (0, 2))
    a, b = one.read_bytes(), two.read_bytes()
    one.write_bytes(b), two.write_bytes(a)


GROWN = {f"{name} times {by}": (vector(name, by), "WRONG") for name in "xuyzpt" for by in (-1.0, 0.0, np.nan, np.inf)}
GROWN |= {f"{name} times {by}": (vector(name, by), None) for name in "xuyzpt" for by in (1 + 1e-3, 1 - 1e-3, 2.0)}
GROWN |= {f"network {k}": (lambda folder, bad=bad: rebound(folder, bad), None) for k, bad in enumerate(BAD_NETWORKS)}
GROWN |= {
    "nothing": (still, "WRONG"),
    "z exchanged": (z_exchanged, "UNREADABLE"),
    "z without its file": (lambda f: (f / "proof" / "shard-00002" / "z.npy").unlink(), "UNREADABLE"),
    "z of another size": (lambda f: forge_array(f, "proof/z", lambda a: np.append(a, 0.0)), "UNREADABLE"),
    "no z": (lambda f: forged(f, lambda d: d["shards"][1]["files"].pop("z")), "UNREADABLE"),
    "v": (lambda f: forged(f, lambda d: d["shards"][1]["files"].update(v=d["shards"][1]["files"]["x"])), "UNREADABLE"),
    "a rate of a shard": (lambda f: forged(f, lambda d: d["shards"][1].update(rate="0x0.0p+0")), "UNREADABLE"),
    "vectors exchanged": (lambda f: forged(f, lambda d: d["shards"].insert(0, d["shards"].pop())), "UNREADABLE"),
    "shards exchanged": (exchange, "UNREADABLE"),
    "a shard less": (lambda f: forged(f, lambda d: d["shards"].pop()), "UNREADABLE"),
    "a shard more": (lambda f: forged(f, lambda d: d["shards"].append({})), "UNREADABLE"),
    "a rate of 100": (stated(growth=(100.0).hex()), "WRONG"),
    "a rate of 0": (stated(growth=(0.0).hex()), "REFUTED"),
    "a rate below 0": (stated(growth=(-0.5).hex()), "UNREADABLE"),
    "a rate in short": (stated(growth="0x1p-10"), "UNREADABLE"),
    "no rate": (stated(growth=None), "UNREADABLE"),
    "a number": (stated(growth=0), "UNREADABLE"),
    "proven": (stated(status="PROVED"), "UNREADABLE"),
    "a shard as well": (stated(refuted=0), "UNREADABLE"),
    "one piece as well": (stated(whole={"sha256": "0"}), "UNREADABLE"),
    "weights turned": (lambda f: forge_array(f, "weights", lambda a: -a), "WRONG"),
    "weights of a third": (lambda f: forge_array(f, "weights", lambda a: a / 3), "WRONG"),
    "B turned": (lambda f: forge_array(f, "B0", lambda a: -a), "WRONG"),
    "A that decays": (lambda f: forge_array(f, "A0", lambda a: 100 * a), "WRONG"),
}
WHOLE = {f"network {k}": (lambda folder, bad=bad: rebound(folder, bad), None) for k, bad in enumerate(BAD_NETWORKS)}
WHOLE |= {
    "proven": (stated(status="PROVED"), "WRONG"),
    "a shard as well": (stated(refuted=0), "UNREADABLE"),
    "growth as well": (stated(growth=(0.0).hex()), "UNREADABLE"),
    "vectors": (stated(shards=[{}, {}, {}]), "UNREADABLE"),
    "no digest": (stated(whole={}), "UNREADABLE"),
    "no entry": (stated(whole=None), "UNREADABLE"),
    "another digest": (stated(whole={"sha256": "0" * 64}), "UNREADABLE"),
    "more": (lambda f: forged(f, lambda d: d["whole"].update(more=1)), "UNREADABLE"),
    "no file": (lambda f: (f / "proof" / "whole.json").unlink(), "UNREADABLE"),
    "no JSON": (rewritten(lambda text: text[:-1]), "UNREADABLE"),
    "blanks": (rewritten(lambda text: text.replace(",", ", ")), "REFUTED"),
    "another rate": (
        redigested(lambda c: c["data"]["witness"]["fields"].update(rate={"double": (1.0).hex()})),
        "WRONG",
    ),
    "another A": (redigested(lambda c: c["data"]["A"]["sparse"][0].__setitem__(2, "-0x1.8p-1")), "WRONG"),
    "another claim": (redigested(lambda c: c.update(claim="stable")), None),
    "undecided": (redigested(lambda c: c.update(status="UNDECIDED")), None),
    "another weight": (lambda f: forge_array(f, "weights", lambda a: a * (1 + 2**-52)), "WRONG"),
    "weights exchanged": (lambda f: forge_array(f, "targets", lambda a: a[::-1]), "WRONG"),
    "another node": (lambda f: forge_array(f, "A0", lambda a: a * (1 - 2**-53)), "WRONG"),
    "B of others": (lambda f: forge_array(f, "B0", lambda a: 2 * a), "WRONG"),
    "other steps": (lambda f: rebound(f, lambda d: d.update(dt="0x1.0000000000000p-1")), "WRONG"),
    "steps of True": (lambda f: rebound(f, lambda d: d.update(dt=True)), "WRONG"),
    "another cone": (lambda f: rebound(f, lambda d: d.update(cones=[[[1, {"rays": [[-1]]}]]])), "WRONG"),
}
FORGED = {("grown", name): case for name, case in GROWN.items()} | {("whole", k): case for k, case in WHOLE.items()}
FORGED |= {
    (kind, f"certificate {k}"): (lambda folder, bad=bad: forged(folder, bad), None)
    for kind in ("grown", "whole")
    for k, bad in enumerate(BAD_CERTIFICATES)
}
# No generator of a cone; in one piece also other nodes: the package looks at the cones, and at all shards, first.
OTHERWISE = {("grown", "network 9"), ("whole", "network 9"), ("whole", "network 3")}


@pytest.mark.parametrize(("kind", "name"), FORGED)
def test_both_say_the_same_of_what_was_changed(kind, name, copies, capsys):
    forge, expected = FORGED[kind, name]
    try:
        forge(copies[kind])
    except (KeyError, IndexError, ValueError, TypeError):
        pytest.skip("there is nothing of this kind to change")
    out = copies[kind] / "proof"
    said = by_package(out), by_checker(out, capsys)
    if (kind, name) in OTHERWISE:
        assert {*said} == {"WRONG", "UNREADABLE"}
    else:
        assert said[0] == said[1]
        assert expected in (None, said[0])


@pytest.mark.parametrize("kind", ["grown", "whole"])
@pytest.mark.parametrize("seed", range(20))
def test_flipped_bits_are_found(kind, seed, copies, capsys):
    rng, out = random.Random(seed), copies[kind] / "proof"
    paths = sorted(path for path in copies[kind].rglob("*") if path.is_file())
    for _ in range(10):
        path = rng.choice(paths)
        before = path.read_bytes()
        data = bytearray(before)
        k = rng.randrange(len(data))
        data[k] ^= 1 << rng.randrange(8)
        path.write_bytes(bytes(data))
        blank = path.name == "manifest.json" and json_or_none(bytes(data)) == json_or_none(before)
        said = by_package(out), by_checker(out, capsys)
        assert said == (("REFUTED", "REFUTED") if blank else ("UNREADABLE", "UNREADABLE")), (path, k)
        path.write_bytes(before)


def test_random_networks(tmp_path, capsys, monkeypatch):
    """At the margin, on cones of all kinds, also with more facets than dimensions; growing ones with and without D."""
    kinds = set()
    for seed in range(15):
        rng = np.random.default_rng(seed)
        nodes, W, _ = random_networks.marginal_network(rng) or ([lag(1.0)] * 3, cycle(3), False)
        if seed % 3:
            nodes, blocks, _ = random_networks.random_network(rng)
            W = 3 * random_networks.dense_coupling(nodes, blocks)
        with monkeypatch.context() as patch:
            patch.setattr(certifying, "fits", lambda network, small=not seed % 3: small)
            found = certified(tmp_path, nodes, W, int(rng.integers(1, len(nodes) + 3)), f"{seed}")
        if found.status != "UNDECIDED":
            assert by_checker(found.path, capsys) == by_package(found.path) == found.status.name
            kinds.add(("one piece" if found.whole is not None else type(found.witness).__name__, found.discrete))
    assert {("Growth", False), ("Growth", True)} <= kinds
    assert "one piece" in {kind for kind, _ in kinds}


def test_numbers_that_are_no_doubles(tmp_path, capsys):
    links = [["0.34" if j == (k + 1) % 4 else 0 for k in range(4)] for j in range(4)]
    for k, part in enumerate((["-1/3", "-1/3"], ["-0.34", "-17/50"])):
        found = certified(tmp_path, kp.stack([[[x]] for x in part * 2], [[1]], [[1]]), links, 3, f"{k}")
        assert found.status == "REFUTED" and (found.whole is not None) == bool(k)
        assert by_checker(found.path, capsys) == by_package(found.path) == "REFUTED"


def test_a_network_with_names(tmp_path, capsys):
    for k, gain in enumerate((0.5, 1.0, 1.5)):
        found = certified(tmp_path, [lag(1.0, name=f"node {j}") for j in range(4)], gain * cycle(4), 2, f"{k}")
        assert by_checker(found.path, capsys) == by_package(found.path) == found.status.name


def test_a_part_alone_is_proven(grown, capsys):
    for p in range(3):
        assert by_checker_alone(grown / "proof", p, capsys) == "REFUTED"
    assert by_checker_alone(grown / "proof", 3, capsys) == "UNREADABLE"


def by_checker_alone(out, p, capsys):
    checker.main(out, p)
    return capsys.readouterr().out.split()[0]
