"""The command line: the account it prints, the files it writes, its exit status."""

import json
import re

import numpy as np
import pytest
from tampering import redigested

import control_kpos as kp
from control_kpos.__main__ import main


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """Exit status and folder of one run with a small ring."""
    folder = tmp_path_factory.mktemp("demo") / "made" / "on demand"
    return main(["--output", str(folder), "--nodes", "7", "20"]), folder


def test_demo_succeeds_and_writes_its_files(demo):
    status, folder = demo
    assert status == 0
    assert {path.name for path in folder.iterdir()} == {
        "phase_portrait.png",
        "positive.json",
        "stable.json",
        "ring.json",
    }
    assert (folder / "phase_portrait.png").read_bytes().startswith(b"\x89PNG")


def test_account_states_the_numbers(tmp_path, capsys):
    main(["--output", str(tmp_path), "--nodes", "5"])
    out, err = capsys.readouterr()
    assert "no feedback" in out
    assert f"{(-13 + np.sqrt(85)) / 2:.6f}" in out
    assert re.search(r"-1\.48 .*wrong", out)
    assert "F2 = -13 - 1e-10: PROVED" in out
    assert "F2 = -13 + 1e-10: REFUTED" in out
    assert max(map(len, out.splitlines())) <= 110 + len(str(tmp_path))
    assert "..." in err


def test_paper_is_corrected():
    # the ring's modes are the roots of lambda^2 + 13 lambda + 22 - w over the N-th roots of unity w
    A, B, C, _ = kp.examples.mass_spring()
    W = kp.examples.ring(40).toarray()
    closed = np.kron(np.eye(40), A + B @ kp.examples.paper_gain()) + np.kron(W, B @ C)
    assert np.linalg.eigvals(closed).real.max() == pytest.approx((-13 + np.sqrt(85)) / 2)


@pytest.mark.parametrize("name", ["positive", "stable", "ring"])
def test_check_confirms_the_files_of_the_demo(demo, name, capsys):
    assert main(["check", str(demo[1] / f"{name}.json")]) == 0
    assert "PROVED" in capsys.readouterr().out


def test_check_tells_refuted_from_proved(tmp_path, capsys):
    kp.linear_lyapunov([[1, 0], [0, 1]], kp.orthant(2)).save(tmp_path / "unstable.json")
    assert main(["check", str(tmp_path / "unstable.json")]) == 1
    assert "REFUTED" in capsys.readouterr().out


def test_check_refuses_a_false_claim(tmp_path, capsys):
    kp.linear_lyapunov([[1, 0], [0, 1]], kp.orthant(2)).save(tmp_path / "file.json")
    content = json.loads((tmp_path / "file.json").read_text())
    content["status"] = "PROVED"
    (tmp_path / "file.json").write_text(json.dumps(content))
    assert main(["check", str(tmp_path / "file.json")]) == 2  # what proves nothing has no v to read
    assert "says PROVED, but its data give REFUTED" in capsys.readouterr().out.replace("\n  ", " ")
    kp.linear_lyapunov([[-2, 1], [1, -2]], kp.orthant(2)).save(tmp_path / "file.json")
    content = json.loads((tmp_path / "file.json").read_text())
    content["data"]["A"]["matrix"][0][0] = 2
    (tmp_path / "file.json").write_text(json.dumps(redigested(content)))
    assert main(["check", str(tmp_path / "file.json")]) == 1
    assert "WRONG" in capsys.readouterr().out


@pytest.mark.parametrize("content", ["", "{}", "not json", '{"format": "kpos-certificate/2"}', "[1.5]"])
def test_check_says_what_it_cannot_read(tmp_path, content, capsys):
    (tmp_path / "file.json").write_text(content)
    assert main(["check", str(tmp_path / "file.json")]) == 2
    assert "UNREADABLE" in capsys.readouterr().out


def test_check_of_a_missing_file(tmp_path, capsys):
    assert main(["check", str(tmp_path / "nothing.json")]) == 2
    assert "nothing.json" in capsys.readouterr().out


@pytest.mark.parametrize("arguments", [["--nodes", "0"], ["--nodes", "x"], ["--nonsense"], ["check"], ["other"]])
def test_wrong_arguments_are_explained(arguments, capsys):
    with pytest.raises(SystemExit) as exit_info:
        main(arguments)
    assert exit_info.value.code == 2
    assert "usage" in capsys.readouterr().err


def test_help_names_everything(capsys):
    with pytest.raises(SystemExit) as exit_info:
        main(["--help"])
    assert exit_info.value.code == 0
    out = capsys.readouterr().out
    assert all(word in out for word in ("--output", "--nodes", "check"))
