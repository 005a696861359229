"""Certificates in shards that were tampered with: package and checker refuse the same, and take none for proven."""

import json
import os
import random
import shutil
import subprocess
import sys

import numpy as np
import pytest
from network_examples import cycle, lag, random_masses
from sharded_networks import written
from test_shards_files import BAD_CERTIFICATES, BAD_NETWORKS, at, forge_array, forged

import control_kpos as kp
from control_kpos import checker
from control_kpos.__main__ import main as command_line
from control_kpos.proof.files import digest

PROVEN = {"PROVED": 0, "REFUTED": 1, "WRONG": 1, "UNREADABLE": 2}


@pytest.fixture(scope="module")
def proven(tmp_path_factory):
    """A network with feedthrough in three shards, two stacks each, and its certificate inside."""
    place = tmp_path_factory.mktemp("proven")
    masses = random_masses(np.random.default_rng(0), 3)
    nodes = [s for j in range(3) for s in (lag(4.0 + j, D=0.25), masses.take(j))]
    folder = written(place, nodes, 0.5 * cycle(6), 3)
    assert kp.shards.certify(folder, folder / "proof")
    return folder


@pytest.fixture
def copy(proven, tmp_path):
    return shutil.copytree(proven, tmp_path / "copy")


def by_package(out):
    try:
        return kp.shards.check(out).status.name
    except kp.FalseClaimError:
        return "WRONG"
    except (kp.CertificateFileError, OSError):
        return "UNREADABLE"


def by_checker(out, capsys):
    status = checker.main(out)
    said = capsys.readouterr().out.split()[0]
    assert PROVEN[said] == status
    return said


def change(array, factor=None, place=0, value=None):
    out = array.copy()
    out[place] = out[place] * factor if value is None else value
    return out


# -- one table of changes: how, and what both must say

FORGED = {
    f"{name} times {factor}": (
        lambda folder, name=name, factor=factor: forge_array(folder, f"proof/{name}", lambda a: change(a, factor)),
        "PROVED" if (name, factor) in {("v", 1 - 1e-9), ("p", 1 - 1e-9), ("t", 1 + 1e-9)} else "WRONG",
    )
    for name in "vrqpt"
    for factor in (1 + 1e-9, 1 - 1e-9, -1.0, np.nan, np.inf)
}
# A of zeros, and no proper cone: what is left makes sense, but proves nothing
FALSE = {9: "WRONG or damaged", 18: "WRONG"}
FORGED |= {
    f"network {k}": (lambda folder, bad=bad: rebound(folder, bad), FALSE.get(k, "UNREADABLE"))
    for k, bad in enumerate(BAD_NETWORKS)
}
FORGED |= {
    f"certificate {k}": (lambda folder, bad=bad: forged(folder, bad), "UNREADABLE")
    for k, bad in enumerate(BAD_CERTIFICATES)
}


def rebound(folder, bad):
    """A change of the network, to which the digest in the certificate is adapted."""
    forged(folder, bad, inside="")
    now = json.loads((folder / "manifest.json").read_text())["data"]
    forged(folder, lambda data: data["network"].update(digest=digest(now)))


def array(name, values):
    return lambda folder: forge_array(folder, name, values)


FORGED |= {
    "halo reversed": (array("halo", lambda a: a[::-1] - 100), "UNREADABLE"),
    "halo beyond": (array("halo", lambda a: a + 10**6), "UNREADABLE"),
    "halo of its own": (array("halo", lambda a: a * 0 + 2), "UNREADABLE"),
    "halo of others": (array("halo", lambda a: a * 0), "WRONG"),
    "halo in doubles": (array("halo", lambda a: a.astype(float)), "UNREADABLE"),
    "targets beyond": (array("targets", lambda a: a + 10), "UNREADABLE"),
    "targets below": (array("targets", lambda a: a - 10), "UNREADABLE"),
    "indptr reversed": (array("indptr", lambda a: a[::-1].copy()), "UNREADABLE"),
    "indptr longer": (array("indptr", lambda a: np.append(a, a[-1])), "UNREADABLE"),
    "weights without value": (array("weights", lambda a: a * np.nan), "UNREADABLE"),
    "weights without bound": (array("weights", lambda a: a * np.inf), "UNREADABLE"),
    "weights times three": (array("weights", lambda a: a * 3), "WRONG"),
    "weights turned": (array("weights", lambda a: -a), "WRONG"),
    "members moved": (array("members0", lambda a: a + 1), "UNREADABLE"),
    "members below": (array("members0", lambda a: a - 1), "UNREADABLE"),
    "A without bound": (array("A0", lambda a: np.full_like(a, np.inf)), "UNREADABLE"),
    "A of another shape": (array("A0", lambda a: a[0]), "UNREADABLE"),
    "A that grows": (array("A0", lambda a: -a), "WRONG"),
    "B turned": (array("B0", lambda a: -a), "WRONG"),
    "C in integers": (array("C0", lambda a: a.astype(int)), "UNREADABLE"),
    "D ten times": (array("D1", lambda a: 10 * a), "WRONG"),
    "a rate of 100": (lambda f: forged(f, lambda d: d["shards"][1].update(rate=(100.0).hex())), "WRONG"),
    "a rate in short": (lambda f: forged(f, lambda d: d["shards"][1].update(rate="0x1p-3")), "UNREADABLE"),
    "refuted": (lambda f: forged(f, lambda d: d.update(status="REFUTED", refuted=1, shards=[])), "WRONG"),
    "refuted from behind": (
        lambda f: forged(f, lambda d: d.update(status="REFUTED", refuted=-1, shards=[])),
        "UNREADABLE",
    ),
    "refuted, with vectors": (lambda f: forged(f, lambda d: d.update(status="REFUTED", refuted=1)), "UNREADABLE"),
    "vectors exchanged": (lambda f: forged(f, lambda d: d["shards"].insert(0, d["shards"].pop())), "UNREADABLE"),
    "shards exchanged": (lambda f: exchange(f), "UNREADABLE"),
    "shards exchanged in the manifest": (
        lambda f: rebound(f, lambda d: d["shards"].insert(0, d["shards"].pop())),
        "UNREADABLE",
    ),
    "a shard missing": (lambda f: shutil.rmtree(f / "shard-00001"), "UNREADABLE"),
    "vectors missing": (lambda f: shutil.rmtree(f / "proof" / "shard-00001"), "UNREADABLE"),
    "a shard more": (lambda f: rebound(f, lambda d: d["shards"].append(d["shards"][0])), "UNREADABLE"),
    "a file outside": (lambda f: rebound(f, lambda d: d["shards"][1]["files"].update({"../x": {}})), "UNREADABLE"),
    "an endless file": (lambda f: endless(at(f, "A0")), "UNREADABLE"),
    "endless vectors": (lambda f: endless(at(f, "proof/v")), "UNREADABLE"),
    "a pipe": (lambda f: (at(f, "halo").unlink(), os.mkfifo(at(f, "halo"))), "UNREADABLE"),
    "an endless manifest": (lambda f: endless(f / "manifest.json"), "UNREADABLE"),
    "links in a ring": (lambda f: (at(f, "A0").unlink(), at(f, "A0").symlink_to(at(f, "A0"))), "UNREADABLE"),
    "a key twice": (lambda f: doubled(f / "proof" / "manifest.json"), "UNREADABLE"),
    "huge": (lambda f: rebound(f, huge), "UNREADABLE"),
    "huge in the halo": (lambda f: rebound(f, lambda d: huge(d, 2)), "UNREADABLE"),
    "large cones": (lambda f: rebound(f, lambda d: d["cones"].append([[10**12, {"rays": [[1]]}]])), "UNREADABLE"),
    "no cone": (lambda f: rebound(f, lambda d: d["cones"].append([[1, {"rays": [[1, 0], [2, 0]]}]])), "WRONG"),
    "moved elsewhere": (lambda f: forged(f, lambda d: d["network"].update(folder="elsewhere")), "UNREADABLE"),
}


def exchange(folder):
    one, two, aside = folder / "shard-00001", folder / "shard-00002", folder / "aside"
    one.rename(aside), two.rename(one), aside.rename(two)


def endless(path):
    path.unlink()
    path.symlink_to("/dev/zero")


def doubled(path):
    text = path.read_text()
    path.write_text(text.replace('"format"', '"format": 1, "format"', 1))


def huge(data, p=1):
    """Sizes of which no file has a byte."""
    shard = data["shards"][p]
    shard["nodes"] += 10**13
    shard["stacks"][0]["nodes"] += 10**13


@pytest.mark.parametrize("name", FORGED)
def test_package_and_checker_agree_on_what_was_changed(name, copy, capsys):
    forge, expected = FORGED[name]
    forge(copy)
    said = by_package(copy / "proof"), by_checker(copy / "proof", capsys)
    assert said == ((expected, expected) if expected != "WRONG or damaged" else ("UNREADABLE", "WRONG"))


@pytest.mark.parametrize("seed", range(30))
def test_flipped_bits_are_found(seed, copy, capsys):
    """Ten bits, one after the other, in files of the network and the certificate."""
    rng = random.Random(seed)
    paths = sorted(path for path in copy.rglob("*") if path.is_file())
    for _ in range(10):
        path = rng.choice(paths)
        data = bytearray(path.read_bytes())
        k = rng.randrange(len(data))
        data[k] ^= 1 << rng.randrange(8)
        before = path.read_bytes()
        path.write_bytes(bytes(data))
        blank = path.suffix == ".json" and json_or_none(bytes(data)) == json_or_none(before)
        said = by_package(copy / "proof"), by_checker(copy / "proof", capsys)
        assert said == (("PROVED", "PROVED") if blank else ("UNREADABLE", "UNREADABLE")), (path, k)
        path.write_bytes(before)


def json_or_none(data):
    try:
        return json.loads(data)
    except ValueError:
        return None


# -- where things are


def test_a_network_that_was_moved_is_named(proven, tmp_path, capsys):
    out, elsewhere = tmp_path / "proof", tmp_path / "elsewhere"
    shutil.copytree(proven / "proof", out)
    shutil.copytree(proven, elsewhere)
    with pytest.raises(kp.CertificateFileError, match="network=FOLDER"):
        kp.shards.check(out)
    found = kp.shards.check(out, network=elsewhere)
    assert found.status == "PROVED" and found.check()
    assert command_line(["check", str(out)]) == 2
    assert command_line(["check", str(out), "--network", str(elsewhere)]) == 0
    with pytest.raises(SystemExit):
        command_line(["check", str(out / "manifest.json"), "--network", str(elsewhere)])
    capsys.readouterr()
    assert checker.main(out) == 2
    assert checker.main(out, network=elsewhere) == 0
    other = written(tmp_path, [lag(3.0)] * 6, cycle(6), 3, "other")
    with pytest.raises(kp.CertificateFileError, match="is not the network"):
        kp.shards.check(out, network=other)


def test_the_command_of_the_checker(proven, tmp_path):
    """One file, copied and run alone, on all shards and on one of them."""
    alone = shutil.copy(checker.__file__, tmp_path / "alone.py")
    out = str(proven / "proof")
    answers = {
        (out,): 0,
        (out, "--shard", "1"): 0,
        (out, "--shard", "1", "--network", str(proven)): 0,
        (out, "--network", str(proven)): 0,
        (out, "--shard", "9"): 2,
        (out, "--network", str(tmp_path)): 2,
        (out, "--shard", "x"): 2,
        (out, "--shard"): 2,
        (out, "--other", "1"): 2,
        (str(tmp_path),): 2,
    }
    for arguments, status in answers.items():
        command = [sys.executable, "-I", "-S", alone, *arguments]
        done = subprocess.run(command, capture_output=True, check=False, timeout=60)
        assert done.returncode == status and not done.stderr, arguments


def test_rates_of_shards_are_those_of_the_package(proven, capsys):
    rates = kp.shards.check(proven / "proof").rates
    for p, rate in enumerate(rates.tolist()):
        assert checker.main(proven / "proof", p) == 0
        assert f"shard {p} of 3, decay rate {rate};" in capsys.readouterr().out
