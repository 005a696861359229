"""Certificate files: nothing is lost, nothing hostile gets through, nothing is half written."""

import json
import os
import resource
import signal
import subprocess
import sys
import textwrap
import time
import zipfile

import certified
import numpy as np
import pytest
import tampering

import control_kpos as kp
from control_kpos.__main__ import main
from control_kpos.certificates import checker
from control_kpos.certificates.encoding import number, number_text
from control_kpos.certificates.files import FORMAT, load_certificate
from control_kpos.errors import CertificateFileError

EVERY = {**certified.CERTIFICATES, **certified.FOR_THE_PACKAGE}


@pytest.fixture(scope="module")
def stable(tmp_path_factory):
    """A file that is in order, and its content."""
    path = tmp_path_factory.mktemp("stable") / "file.json"
    certified.CERTIFICATES["stable, product"]().save(path)
    return path, json.loads(path.read_text())


# -- what is saved comes back


@pytest.mark.parametrize("suffix", ["json", "npz"])
@pytest.mark.parametrize("name", EVERY)
def test_certificates_come_back(name, suffix, tmp_path):
    certificate = EVERY[name]()
    certificate.save(tmp_path / f"file.{suffix}")
    again = load_certificate(tmp_path / f"file.{suffix}")
    assert type(again) is type(certificate) and again.status is certificate.status and again.check()
    assert set(again.residuals) == set(certificate.residuals)
    again.save(tmp_path / f"again.{suffix}")
    if suffix == "json":
        assert (tmp_path / "again.json").read_text() == (tmp_path / "file.json").read_text()


def test_archives_tell_the_checker_the_same(tmp_path, capsys):
    for name in ("network", "not dissipative", "unstable"):
        certificate = EVERY[name]()
        certificate.save(tmp_path / "file.npz")
        assert main(["check", str(tmp_path / "file.npz")]) == (0 if certificate else 1)
        assert "independent checker confirms" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("text", ["1/3", "-21.3", "0.1", "123456789012345678901234567890", "1e-3", "-7"])
def test_numbers_come_back_exactly(text):
    exact = kp.arrays.exact_matrix([[text]], "x").fractions()[0, 0]
    assert number(number_text(exact)) == exact == checker.number(number_text(exact))


@pytest.mark.parametrize("value", [0.1, 5e-324, -1.7e308, 2.0**-1074, 2.0**60, 1 / 3, -0.5])
def test_doubles_come_back_exactly(value):
    assert float(number(number_text(value))) == value == float(checker.number(number_text(value)))


def test_semantics_and_digest(tmp_path):
    for name, semantics in (("positive", "binary"), ("positive, decimals", "decimal")):
        EVERY[name]().save(tmp_path / "file.json")
        content = json.loads((tmp_path / "file.json").read_text())
        assert content["semantics"] == semantics and content["producer"].startswith("control_kpos ")
        assert tampering.redigested(content) == content


# -- what is damaged is refused, quickly and without much memory


def refused(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    start = time.perf_counter()
    with pytest.raises(CertificateFileError):
        load_certificate(path)
    assert checker.main(path) != 0
    return time.perf_counter() - start


def with_data(content, **data):
    return json.dumps(tampering.redigested({**content, "data": {**content["data"], **data}}))


HALF = {"rays": [[1]], "w": [1], "Z": [[1]]}
HOSTILE = {
    "empty": "",
    "binary": bytes(range(256)),
    "not an object": "[1, 2]",
    "deep nesting": "[" * 200_000,
    "deep objects": '{"a":' * 100_000,
    "a float": '{"format": "kpos-certificate/1", "x": 0.1}',
    "NaN": '{"format": "kpos-certificate/1", "x": NaN}',
    "infinity": '{"format": "kpos-certificate/1", "x": Infinity}',
    "a huge exponent": '{"format": "kpos-certificate/1", "x": 1e9999}',
    "a long integer": '{"format": "kpos-certificate/1", "x": ' + "9" * 10**5 + "}",
    "a key twice": '{"format": "kpos-certificate/1", "format": "kpos-certificate/1"}',
    "another version": '{"format": "kpos-certificate/2", "claim": "stable", "status": "PROVED", "data": {}}',
    "no format": '{"claim": "stable", "status": "PROVED", "data": {}}',
    "nothing else": json.dumps({"format": FORMAT}),
    "an unknown claim": json.dumps({"format": FORMAT, "claim": "lovely", "status": "PROVED", "data": {}, "proof": {}}),
    "an unknown key": json.dumps({"format": FORMAT, "run": "rm"}),
}
WRONG_DATA = {
    "a cone of 1e7 half-lines": {"X": {"cone": [[10**7, HALF]]}},
    "a cone of 1e18 half-lines": {"X": {"cone": [[10**18, HALF]]}},
    "a negative count": {"X": {"cone": [[-1, HALF]]}},
    "no cone": {"X": {"cone": []}},
    "a ragged cone": {"X": {"cone": [[1, {"rays": [[1, 2], [3]], "w": [1, 1], "Z": [[1]]}]]}},
    "a sparse matrix of 1e9 rows": {"A": {"sparse": [], "shape": [10**9, 10**9]}},
    "an index out of range": {"A": {"sparse": [[0, 4, 1]], "shape": [4, 4]}},
    "a negative index": {"A": {"sparse": [[-1, 0, 1]], "shape": [4, 4]}},
    "an entry twice": {"A": {"sparse": [[0, 0, 1], [0, 0, 2]], "shape": [4, 4]}},
    "a bool as index": {"A": {"sparse": [[True, 0, 1]], "shape": [4, 4]}},
    "a ragged matrix": {"A": {"matrix": [[1, 2], [3]]}},
    "text that is no number": {"A": {"matrix": [["one"]]}},
    "a decimal exponent": {"A": {"matrix": [["1e400000000"]]}},
    "a hexadecimal exponent": {"A": {"matrix": [["0x1p+999999999"]]}},
    "an overflowing double": {"A": {"matrix": [["0x1p+9999"]]}},
    "1e5 digits": {"A": {"matrix": [["9" * 10**5]]}},
    "a division by zero": {"A": {"matrix": [["1/0"]]}},
    "an unknown record": {"witness": {"record": "os.system", "fields": {}}},
    "a bare list": {"A": [[1]]},
    "a string": {"A": "x"},
    "nothing": {"A": None},
    "v that is not finite": {"v": {"array": ["nan", 1, 1, 1]}},
    "v of the wrong length": {"v": {"array": [1]}},
    "another v": {"v": {"array": [1, -1, 1, -1]}},
    "a rate that is not proven": {"decay_rate": {"double": 1000}},
    "unknown data": {"more": 1},
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_texts(name, tmp_path):
    assert refused(tmp_path / "file.json", HOSTILE[name]) < 5  # a second on a machine that does nothing else


@pytest.mark.parametrize("name", WRONG_DATA)
def test_wrong_data(name, stable, tmp_path):
    if name in ("unknown data", "an unknown record"):  # the checker proves the claim without looking at them
        (tmp_path / "file.json").write_text(with_data(stable[1], **WRONG_DATA[name]))
        with pytest.raises(CertificateFileError):
            load_certificate(tmp_path / "file.json")
    else:
        assert refused(tmp_path / "file.json", with_data(stable[1], **WRONG_DATA[name])) < 5


def test_prefixes_and_flipped_bytes(stable, tmp_path):
    text = stable[0].read_bytes()
    for end in range(0, len(text), 97):
        refused(tmp_path / "file.json", text[:end])
    rng = np.random.default_rng(0)
    for place in rng.integers(text.index(b'"data"') + 8, text.index(b'"proof"') - 2, 60):
        changed = bytearray(text)
        changed[place] ^= 1 << int(rng.integers(7))
        (tmp_path / "file.json").write_bytes(changed)
        with pytest.raises(CertificateFileError):
            load_certificate(tmp_path / "file.json")
        assert checker.main(tmp_path / "file.json") != 0


def header(kind, shape):
    text = str({"descr": kind, "fortran_order": False, "shape": shape}).ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def archives():
    """Hostile archives by name: lists of members (name, bytes, compression)."""
    good = json.dumps(
        {"format": FORMAT, "claim": "stable", "status": "PROVED", "data": {"A": {"matrix": {"member": "a0"}}}}
    )
    text = ("certificate.json", good.encode(), zipfile.ZIP_STORED)
    numbers = np.zeros(4).tobytes()
    yield "a bomb", [("certificate.json", b" " * 10**8, zipfile.ZIP_DEFLATED)]
    yield "a lying header", [text, ("a0.npy", header("<f8", (10**12,)) + numbers, zipfile.ZIP_STORED)]
    yield "a header too small", [text, ("a0.npy", header("<f8", (1,)) + numbers, zipfile.ZIP_STORED)]
    yield "a negative size", [text, ("a0.npy", header("<f8", (-4,)) + numbers, zipfile.ZIP_STORED)]
    yield "objects", [text, ("a0.npy", header("|O", (4,)) + numbers, zipfile.ZIP_STORED)]
    yield "complex", [text, ("a0.npy", header("<c16", (2,)) + numbers, zipfile.ZIP_STORED)]
    yield "many dimensions", [text, ("a0.npy", header("<f8", (1, 1, 1, 4)) + numbers, zipfile.ZIP_STORED)]
    yield "code in the header", [text, ("a0.npy", header("<f8", "__import__('os')") + numbers, zipfile.ZIP_STORED)]
    yield "no array", [text]
    yield "no text", [("a0.npy", header("<f8", (4,)) + numbers, zipfile.ZIP_STORED)]
    yield "not numpy", [text, ("a0.npy", b"x" * 200, zipfile.ZIP_STORED)]
    yield "a path", [text, ("../../a0.npy", header("<f8", (4,)) + numbers, zipfile.ZIP_STORED)]
    yield "a pickle", [text, ("a0.pkl", b"cos\nsystem\n", zipfile.ZIP_STORED)]
    yield "not finite", [text, ("a0.npy", header("<f8", (2, 2)) + np.full(4, np.nan).tobytes(), zipfile.ZIP_STORED)]


@pytest.mark.parametrize(("name", "members"), list(archives()))
def test_hostile_archives(name, members, tmp_path):
    with zipfile.ZipFile(tmp_path / "file.npz", "w") as archive:
        for member, data, compression in members:
            archive.writestr(member, data, compression)
    refused(tmp_path / "file.npz", (tmp_path / "file.npz").read_bytes())


def test_archives_cut_short_or_out_of_range(tmp_path):
    kp.feedback_interconnect(certified.mass_springs(), kp.examples.ring(4)).certificate.save(tmp_path / "file.npz")
    whole = (tmp_path / "file.npz").read_bytes()
    for end in range(0, len(whole), 301):
        refused(tmp_path / "cut.npz", whole[:end])


def test_reading_hostile_files_needs_little_memory(tmp_path):
    for name, text in HOSTILE.items():
        (tmp_path / f"{name}.json").write_bytes(text if isinstance(text, bytes) else text.encode())
    code = textwrap.dedent(f"""
        import pathlib, resource, control_kpos as kp
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for path in pathlib.Path({str(tmp_path)!r}).iterdir():
            try:
                kp.load_certificate(path)
            except kp.CertificateFileError:
                pass
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    """)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert int(done.stdout) * (1 if sys.platform == "darwin" else 1024) < 200 * 10**6
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > 0


def test_a_missing_file_is_an_oserror(tmp_path):
    with pytest.raises(OSError, match="nothing"):
        load_certificate(tmp_path / "nothing.json")


# -- written whole or not at all

WRITER = """
import sys, control_kpos as kp
one = kp.linear_lyapunov([[-2, 1], [1, -2]], kp.orthant(2))
other = kp.linear_lyapunov([[1, 0], [0, 1]], kp.orthant(2))
print("ready", flush=True)
while True:
    one.save(sys.argv[1])
    other.save(sys.argv[1])
"""


@pytest.mark.parametrize("suffix", ["json", "npz"])
def test_a_kill_leaves_a_whole_file(suffix, tmp_path):
    path = tmp_path / f"file.{suffix}"
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(2):
        writer = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE)
        writer.stdout.readline()
        time.sleep(0.02 + 0.05 * rng.random())
        os.kill(writer.pid, signal.SIGKILL)
        writer.wait()
        writer.stdout.close()
        if path.exists():
            seen.add(load_certificate(path).status.name)
    assert seen <= {"PROVED", "REFUTED"} and seen


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    EVERY["stable"]().save(tmp_path / "file.json")
    before = (tmp_path / "file.json").read_bytes()

    def fail(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="no space"):
        EVERY["unstable"]().save(tmp_path / "file.json")
    assert (tmp_path / "file.json").read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["file.json"]
