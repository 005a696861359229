"""Files of networks in shards: whatever is changed, missing or unfinished is found, and nothing forged is proven."""

import errno
import json
import shutil

import numpy as np
import pytest
from network_examples import cycle, lag, random_masses
from sharded_networks import certified, masses, written

import control_kpos as kp
from control_kpos.proof.files import digest
from control_kpos.shards import folders

# -- what was changed is found


@pytest.fixture(scope="module")
def proven(tmp_path_factory):
    """A network with feedthrough in three shards, two stacks each, and its certificate inside."""
    place = tmp_path_factory.mktemp("proven")
    masses = random_masses(np.random.default_rng(0), 3)
    nodes = [s for j in range(3) for s in (lag(4.0 + j, D=0.25), masses.take(j))]
    folder = written(place, nodes, 0.5 * cycle(6), 3)
    assert kp.shards.certify(folder, folder / "proof")
    return folder


def copied(folder, place):
    return shutil.copytree(folder, place / "copy")


def files_in(folder):
    return sorted(path.relative_to(folder) for path in folder.rglob("*.npy"))


NAMES = ["indptr", "targets", "weights", "halo", "members0", "members1", "A0", "B0", "C0", "D1", "A1", "B1", "C1"]
NAMES += [f"proof/{name}" for name in "vrqpt"]


def at(folder, name, p=1):
    *inside, stem = name.split("/")
    return folder.joinpath(*inside, f"shard-{p:05d}", f"{stem}.npy")


def test_the_files_are_those_tried_below(proven):
    assert {path.stem for path in files_in(proven)} == {name.rpartition("/")[2] for name in NAMES}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("damage", ["changed", "missing", "shortened", "swapped", "empty"])
def test_damaged_files_are_named(proven, tmp_path, name, damage):
    folder = copied(proven, tmp_path)
    path = at(folder, name)
    data = path.read_bytes()
    if damage == "missing":
        path.unlink()
    elif damage == "swapped":
        path.write_bytes(at(folder, {"halo": "A0", "members0": "halo"}.get(name, "halo"), 2).read_bytes())
    else:
        path.write_bytes({"changed": data[:-1] + bytes([data[-1] ^ 1]), "shortened": data[:-8], "empty": b""}[damage])
    with pytest.raises(kp.CertificateFileError, match=path.name.replace(".", r"\.")) as caught:
        kp.shards.check(folder / "proof")
    assert not isinstance(caught.value, kp.FalseClaimError)
    assert str(path.parent.name) in str(caught.value)
    if "/" not in name:
        with pytest.raises(kp.CertificateFileError, match=str(path.parent.name)):
            kp.shards.certify(folder, tmp_path / "again")
        assert not (tmp_path / "again" / "manifest.json").exists()


def forged(folder, change, *, inside="proof"):
    """The data of a manifest after a change, with a digest that fits."""
    path = folder / inside / "manifest.json"
    content = json.loads(path.read_text())
    change(content["data"])
    content["digest"] = digest(content["data"])
    path.write_text(json.dumps(content))


def forge_array(folder, name, change, p=1):
    """Another array with a digest that fits, in both manifests where it is about the data of the network."""
    path = at(folder, name, p)
    entry = folders.write_array(path, change(np.load(path)))
    inside, _, stem = name.rpartition("/")
    forged(folder, lambda data: data["shards"][p]["files"].update({stem: entry}), inside=inside)
    if not inside:
        now = json.loads((folder / "manifest.json").read_text())["data"]
        forged(folder, lambda data: data["network"].update(digest=digest(now)))


# Changes that leave the vectors proven: v and p may be smaller, t larger, by a little.
SOUND = {("v", 1 - 1e-9), ("p", 1 - 1e-9), ("t", 1 + 1e-9)}


@pytest.mark.parametrize("factor", [1 + 1e-9, 1 - 1e-9, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("name", list("vrqpt"))
def test_forged_vectors_prove_nothing(proven, tmp_path, name, factor):
    folder = copied(proven, tmp_path)

    def change(array):
        out = array.copy()
        out[0] *= factor
        return out

    forge_array(folder, f"proof/{name}", change)
    if (name, factor) in SOUND:
        assert kp.shards.check(folder / "proof").status == "PROVED"
        return
    with pytest.raises(kp.FalseClaimError, match=r"shard \d is not proven"):
        kp.shards.check(folder / "proof")


def test_forged_data_are_proven_or_refused(proven, tmp_path):
    folder = copied(proven, tmp_path)
    forge_array(folder, "weights", lambda w: w * 3)
    with pytest.raises(kp.FalseClaimError, match="shard 1"):
        kp.shards.check(folder / "proof")


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data["shards"][1].update(rate=(100.0).hex()),
        lambda data: data.update(status="REFUTED", refuted=1, shards=[]),
    ],
)
def test_false_claims_are_told(proven, tmp_path, change):
    folder = copied(proven, tmp_path)
    forged(folder, change)
    with pytest.raises(kp.FalseClaimError, match=r"shard 1"):
        kp.shards.check(folder / "proof")


def nothing(data):
    data.clear()


BAD_CERTIFICATES = [
    nothing,
    lambda data: data["shards"].pop(),
    lambda data: data["shards"].append({}),
    lambda data: data["shards"].reverse(),
    lambda data: data.update(shards={}),
    lambda data: data.update(status="CERTAIN"),
    lambda data: data.update(status="REFUTED", refuted=9),
    lambda data: data.update(reason=1),
    lambda data: data["shards"][0].update(rate="-0x1p-1"),
    lambda data: data["shards"][0].update(rate="nan"),
    lambda data: data["shards"][0].update(rate="inf"),
    lambda data: data["shards"][0].update(rate="0x1p2000"),
    lambda data: data["shards"][0].update(files=5),
    lambda data: data["shards"][0].update(rate=None),
    lambda data: data["shards"][0].update(files=None),
    lambda data: data["shards"][0]["files"].pop("v"),
    lambda data: data["shards"][0]["files"].pop("t"),
    lambda data: data["shards"][0]["files"]["v"].update(dtype="|O"),
    lambda data: data["shards"][0]["files"]["v"].update(shape=[1]),
    lambda data: data["shards"][0]["files"]["v"].pop("sha256"),
    lambda data: data["network"].update(folder="elsewhere"),
    lambda data: data["network"].update(folder=1),
    lambda data: data["network"].update(digest="sha256:0"),
]


@pytest.mark.parametrize("change", BAD_CERTIFICATES)
def test_certificates_that_make_no_sense(proven, tmp_path, change):
    folder = copied(proven, tmp_path)
    forged(folder, change)
    with pytest.raises(kp.CertificateFileError):
        kp.shards.check(folder / "proof")


BAD_NETWORKS = [
    nothing,
    lambda data: data["shards"].clear(),
    lambda data: data["shards"].reverse(),
    lambda data: data["shards"].pop(),
    lambda data: data.update(dt="-0x1p0"),
    lambda data: data.update(dt="soon"),
    lambda data: data.update(dt="0x1p2000"),
    lambda data: data.update(dt=[0]),
    lambda data: data["cones"].clear(),
    lambda data: data["cones"].append([[1, {"rays": [[0]]}]]),
    lambda data: data["shards"][0].update(nodes=3),
    lambda data: data["shards"][0].update(nodes=-2),
    lambda data: data["shards"][0].update(files=[]),
    lambda data: data["shards"][0]["stacks"][0].update(nodes=0),
    lambda data: data["shards"][0]["stacks"][0].update(X=10**6),
    lambda data: data["shards"][0]["stacks"][0].update(X=1),
    lambda data: data["shards"][0]["stacks"][0].pop("X"),
    lambda data: data["shards"][0]["stacks"].pop(),
    lambda data: data["shards"][0]["files"].pop("A0"),
    lambda data: data["shards"][0]["files"].pop("halo"),
    lambda data: data["shards"][0]["files"].update(halo=data["shards"][0]["files"]["weights"]),
]


@pytest.mark.parametrize("change", BAD_NETWORKS)
def test_networks_that_make_no_sense(proven, tmp_path, change):
    folder = copied(proven, tmp_path)
    forged(folder, change, inside="")
    with pytest.raises(kp.CertificateFileError):
        kp.shards.check(folder / "proof")
    try:
        found = kp.shards.certify(folder, tmp_path / "again")
    except kp.CertificateFileError:
        return
    assert found.status != "PROVED"  # A of 0 where the file was left out


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("halo", lambda a: a[::-1] - 100),
        ("halo", lambda a: a + 10**6),
        ("halo", lambda a: a * 0 + 2),
        ("targets", lambda a: a + 10),
        ("targets", lambda a: a - 10),
        ("indptr", lambda a: a[::-1].copy()),
        ("weights", lambda a: a * np.nan),
        ("members0", lambda a: a + 1),
        ("A0", lambda a: np.full_like(a, np.inf)),
        ("A0", lambda a: a[0]),
    ],
)
def test_arrays_that_make_no_sense(proven, tmp_path, name, change):
    folder = copied(proven, tmp_path)
    forge_array(folder, name, change)
    with pytest.raises(kp.CertificateFileError) as caught:
        kp.shards.check(folder / "proof")
    assert not isinstance(caught.value, kp.FalseClaimError)


def test_a_certificate_is_about_one_network(proven, tmp_path):
    folder = copied(proven, tmp_path)
    other = written(tmp_path, [lag(3.0)] * 6, cycle(6), 3, "other")
    shutil.copytree(folder / "proof", other / "proof")
    with pytest.raises(kp.CertificateFileError, match="is not the network"):
        kp.shards.check(other / "proof")


# -- files that are not finished


def test_what_was_not_finished_is_not_read(tmp_path, monkeypatch):
    nodes, W = masses()
    original, count = folders.write_whole, iter(range(100))

    def no_space(stream):
        raise OSError(errno.ENOSPC, "No space left on device")

    def full(path, write, **more):
        original(path, no_space if next(count) == 9 else write, **more)

    monkeypatch.setattr(folders, "write_whole", full)
    with pytest.raises(OSError, match=r"shard-0000\d"):
        written(tmp_path, nodes, W, 4)
    with pytest.raises(kp.CertificateFileError, match=r"no manifest\.json"):
        kp.shards.certify(tmp_path / "network", tmp_path / "proof")
    monkeypatch.undo()
    assert certified(tmp_path, nodes, W, 4).status == "PROVED"  # what is left of it does not matter


def test_nothing_is_left_beside_the_files(tmp_path):
    found = certified(tmp_path, *masses(), 2)
    names = {path.name for path in found.path.iterdir()}
    assert names == {"manifest.json", "shard-00000", "shard-00001"}
    assert {path.name for path in (found.path / "shard-00000").iterdir()} == {"v.npy", "r.npy", "q.npy"}


def test_an_old_certificate_is_replaced(tmp_path):
    nodes, W = masses()
    first = certified(tmp_path, nodes, W, 2)
    second = kp.shards.certify(tmp_path / "network", first.path)
    assert (second.status, second.decay_rate) == (first.status, first.decay_rate)
