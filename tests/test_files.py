"""Certificate files: nothing is lost, nothing hostile gets through, nothing is half written."""

import json
import os
import resource
import signal
import subprocess
import sys
import textwrap
import time
from fractions import Fraction
from pathlib import Path

import campaigns
import certified
import numpy as np
import pytest
import tampering
from hostile import HOSTILE, WRONG_DATA, archives, thousand_parts, with_data, write_archive

import control_kpos as kp
from control_kpos import checker
from control_kpos.__main__ import main
from control_kpos.errors import CertificateFileError
from control_kpos.exact.intake import exact_matrix
from control_kpos.proof import files
from control_kpos.proof.files import load_certificate
from control_kpos.proof.numerals import double, number, number_text, number_texts, special_double

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
    exact = exact_matrix([[text]], "x").fractions()[0, 0]
    assert number(number_text(exact)) == exact == checker.number(number_text(exact))


@pytest.mark.parametrize("value", [0.1, 5e-324, -1.7e308, 2.0**-1074, 2.0**60, 1 / 3, -0.5])
def test_doubles_come_back_exactly(value):
    assert float(number(number_text(value))) == value == float(checker.number(number_text(value)))
    assert double(number_text(value)) == value


def test_many_doubles_are_written_as_each_of_them():
    values = np.array([0.0, -0.0, 1.0, -7.0, 0.1, 2.0**53, 2.0**53 - 1, 5e-324, -1.7e308, np.inf, -np.inf, np.nan])
    texts = number_texts(values)
    assert texts[:4] == [0, "-0x0.0p+0", 1, -7] and texts[-3:] == ["inf", "-inf", "nan"]
    assert texts == [number_text(float(x)) for x in values]
    assert np.array_equal([special_double(x) for x in texts], values, equal_nan=True)
    assert [double(x) for x in texts[:-3]] == values[:-3].tolist()


@pytest.mark.parametrize("text", ["0x1.0p+1024", "0x1.00000000000001p+0", "0x1.0p-1080", "1/3", 2**60 + 1, "nan"])
def test_what_is_no_double(text):
    with pytest.raises(CertificateFileError, match="is not a"):
        double(text)


@pytest.mark.parametrize("text", ["-0x0.0p", "-0x0.0pfoo", "-0x0.0p+0 ", "-0x0.0p+0x", "-0x0.0p+00000"])
def test_a_zero_with_a_sign_is_read_like_any_other_number(text):
    for read in (special_double, double, number, checker.number):
        with pytest.raises((CertificateFileError, ValueError)):
            read(text)
    assert np.signbit([special_double(x) for x in ("-0x0.0p+0", "-0x0p+7", "0x0.0p+0", "0x0p+0")]).tolist() == [
        1,
        1,
        0,
        0,
    ]


def test_doubles_may_be_written_in_other_ways():
    assert [double(x) for x in ("0x3.0p-1", "1.5", "3/2", "0x3/0x2")] == [1.5] * 4


def test_semantics_and_digest(tmp_path):
    for name, semantics in (("positive", "binary"), ("positive, decimals", "decimal")):
        EVERY[name]().save(tmp_path / "file.json")
        content = json.loads((tmp_path / "file.json").read_text())
        assert content["semantics"] == semantics and content["producer"].startswith("control_kpos ")
        assert tampering.redigested(content) == content


# -- what is damaged is refused, quickly and without much memory


def refused(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(CertificateFileError) as refusal:
        load_certificate(path)
    assert str(path) in str(refusal.value)
    assert checker.main(path) != 0


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_texts(name, tmp_path):
    refused(tmp_path / "file.json", HOSTILE[name])


@pytest.mark.parametrize("name", WRONG_DATA)
def test_wrong_data(name, stable, tmp_path):
    refused(tmp_path / "file.json", with_data(stable[1], **WRONG_DATA[name]))


def test_a_thousand_parts_share_what_a_file_may_hold(stable, tmp_path):
    refused(tmp_path / "file.json", json.dumps(tampering.redigested(thousand_parts(stable[1]))))


def test_work_for_facets_is_limited_unless_the_file_is_trusted(stable, tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    rays = np.column_stack([rng.integers(-9, 10, (26, 9)), np.full(26, 30)]).astype(float)
    kp.state_positivity(-np.eye(10), kp.PolyhedralCone(rays)).save(tmp_path / "file.json")
    assert load_certificate(tmp_path / "file.json")  # within what every file may ask for
    refused(tmp_path / "short.json", with_data(stable[1], **WRONG_DATA["facets without end"]))
    monkeypatch.setattr(files, "_FREE_WORK", 1000)
    monkeypatch.setattr(files, "_WORK_PER_BYTE", 0)
    with pytest.raises(CertificateFileError, match="trusted=True"):
        load_certificate(tmp_path / "file.json")
    assert load_certificate(tmp_path / "file.json", trusted=True)


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


@pytest.mark.parametrize(("name", "members"), list(archives()))
def test_hostile_archives(name, members, tmp_path):
    write_archive(tmp_path / "file.npz", members)
    refused(tmp_path / "file.npz", (tmp_path / "file.npz").read_bytes())


def test_archives_cut_short_or_out_of_range(tmp_path):
    kp.feedback_interconnect(certified.mass_springs(), kp.examples.ring(4)).certificate.save(tmp_path / "file.npz")
    whole = (tmp_path / "file.npz").read_bytes()
    for end in range(0, len(whole), 301):
        refused(tmp_path / "cut.npz", whole[:end])


def test_reading_hostile_files_needs_little_memory(tmp_path):
    assert len(list(campaigns.hostile_files(tmp_path))) > 60
    (tmp_path / "good.json").unlink()
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
    for _ in range(3):
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


# -- one grammar of numbers, and the files of version 0.1

NUMBERS = {
    "-7": -7,
    "-21.3": "-213/10",
    "1/3": "1/3",
    "0x1.8p+1": 3,
    "0x1.p+1": 2,
    "0x123456789abcp+0": 0x123456789ABC,
    "-0x1f/0x3": "-31/3",
}
NO_NUMBERS = ["0x1.8", "1e5", ".5", "5.", "+1", "0X1p+0", "1/-3", "inf", "", " 1", "\u0663"]


@pytest.mark.parametrize("read", [number, checker.number])
def test_both_readers_read_the_same_numbers(read):
    assert [read(text) for text in NUMBERS] == [Fraction(value) for value in NUMBERS.values()]
    for text in NO_NUMBERS:
        with pytest.raises(ValueError, match="number"):
            read(text)


@pytest.mark.parametrize("path", sorted((Path(__file__).parent / "files_of_0_1").iterdir()), ids=lambda path: path.stem)
def test_files_of_version_0_1_load_and_check(path):
    certificate = load_certificate(path)
    assert certificate.status.name in ("PROVED", "REFUTED") and certificate.check()
    if path.suffix == ".json":
        proof = json.loads(path.read_text())["proof"]
        assert checker.main(path) == (2 if "omitted" in proof else 0 if certificate else 1)


def test_saving_keeps_links_and_modes_and_names_the_path_given(tmp_path):
    certificate = certified.CERTIFICATES["stable"]()
    certificate.save(tmp_path / "file.json")
    (tmp_path / "file.json").chmod(0o640)
    (tmp_path / "link.json").symlink_to(tmp_path / "file.json")
    certificate.save(tmp_path / "link.json")
    assert (tmp_path / "link.json").is_symlink() and (tmp_path / "file.json").stat().st_mode & 0o777 == 0o640
    with pytest.raises(FileNotFoundError) as missing:
        certificate.save(tmp_path / "nowhere" / "file.json")
    assert missing.value.filename == str(tmp_path / "nowhere" / "file.json")
    assert str(missing.value).endswith(repr(missing.value.filename))
    os.mkfifo(tmp_path / "pipe.json")
    refusals = (load_certificate, certificate.save)
    for refuse in refusals:
        with pytest.raises(CertificateFileError, match="regular"):
            refuse(tmp_path / "pipe.json")
    assert checker.main(tmp_path / "pipe.json") == 2


@pytest.mark.parametrize(
    "change", [{"decay_rate": {"double": -1}}, {"decay_rate_bound": {"double": "0.5"}}, {"discrete": 0}]
)
def test_numbers_that_nothing_proves_are_refused(change, tmp_path):
    certified.CERTIFICATES["stable"]().save(tmp_path / "file.json")
    refused(tmp_path / "file.json", with_data(json.loads((tmp_path / "file.json").read_text()), **change))


@pytest.mark.parametrize("rays", [[[1, 0], [0, 1], [-1, 0], [0, -1]], [[1, 0], [1, 0]]])
def test_cones_that_are_not_proper_are_refused(rays, tmp_path):
    """On the whole plane A x in X says nothing: x' = -x would be called unstable."""
    kp.linear_lyapunov([[1, 0], [0, 1]], kp.PolyhedralCone([[1, 1], [1, -1]])).save(tmp_path / "file.json")
    content = json.loads((tmp_path / "file.json").read_text())
    content["data"]["witness"]["fields"]["x"] = {"array": [1, 0]}
    factor = {"rays": rays, "w": [1, 0], "Z": [[1, 0], [0, 1], [0, 0], [0, 0]][: len(rays)]}
    data = {"A": {"matrix": [[-1, 0], [0, -1]]}, "X": {"cone": [[1, factor]]}}
    refused(tmp_path / "file.json", with_data(content, **data))


@pytest.mark.parametrize(
    ("name", "key", "value"),
    [
        *(
            ("network, own links closed", "own_links_closed", value)
            for value in (False, "false", 0, 1, "true", [0], None)
        ),
        *(("Jacobians", "source", value) for value in ("given", "0", "sampled", None, 1)),
    ],
)
def test_marks_of_another_kind_are_refused_by_both_readers(name, key, value, tmp_path):
    path = tmp_path / "c.json"
    certified.CERTIFICATES[name]().save(path)
    content = json.loads(path.read_text())
    assert key in content["data"]
    content["data"][key] = value
    path.write_text(json.dumps(tampering.redigested(content)))
    with pytest.raises(CertificateFileError):
        load_certificate(path)
    assert checker.main(path) != 0


@pytest.mark.parametrize("X", [kp.PolyhedralCone([[1]]), kp.product([kp.orthant(1), kp.PolyhedralCone([["1/3"]])])])
def test_cones_that_are_read_as_others_give_equal_certificates(X, tmp_path):
    certificate = kp.linear_lyapunov(-np.eye(X.dim), X)
    certificate.save(tmp_path / "c.json")
    assert load_certificate(tmp_path / "c.json") == certificate
