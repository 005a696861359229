"""Whatever a numerical routine answers, nothing false is proven; and interrupted work leaves nothing behind."""

import os
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest
from injected_faults import CLAIMS, ERRORS, OUTCOMES, ROUTINES, VALUES, faulty, used_routines
from strategies import without_facets

import control_kpos as kp
from control_kpos.exact import programs as linear_programs


@pytest.fixture(scope="module")
def calls():
    with pytest.MonkeyPatch.context() as patch:
        return used_routines(patch)


def verdict(answer):
    return answer if isinstance(answer, kp.Status) else answer.status


def faulted(claim, routine, replacement):
    """The answer to a claim while one routine is replaced; None if no verdict was reached."""
    module, name = ROUTINES[routine]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, name, replacement(getattr(module, name)))
        try:
            return claim()
        except Exception as error:  # noqa: BLE001  (whatever a fault leads to)
            # an injected error, or arrays that do not fit; a routine that does not converge is no surprise
            if isinstance(error, np.linalg.LinAlgError) and "linalg" in routine and "injected" in str(error):
                pytest.fail(f"{routine} that does not converge shows: {error!r}")
            return None


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # numpy's, about garbage
@pytest.mark.filterwarnings("ignore::scipy.linalg.LinAlgWarning")
@pytest.mark.parametrize("fault", [*ERRORS, *VALUES])
@pytest.mark.parametrize("routine", ROUTINES)
def test_no_fault_makes_a_false_verdict(routine, fault, calls):
    rng = np.random.default_rng(11)
    for label, (claim, truth) in CLAIMS.items():
        for share in (1.0, 0.4) if calls[label].get(routine) else ():
            answer = faulted(claim, routine, lambda original, p=share: faulty(original, fault, p, rng))
            if answer is None or verdict(answer) is kp.Status.UNDECIDED:
                continue
            assert verdict(answer) is truth, label
            assert isinstance(answer, kp.Status) or answer.check(), label  # without the fault


@pytest.mark.parametrize("outcome", OUTCOMES)
def test_linear_programs_that_give_up_prove_nothing(outcome, calls):
    test_no_fault_makes_a_false_verdict("HiGHS", outcome, calls)


def many_generators():
    """A cone with too many generators to ask for facets first, the last one redundant."""
    rows = np.random.default_rng(0).standard_normal((40, 6))
    rows[:, 0] = np.abs(rows).sum(axis=1)
    return without_facets(np.vstack([rows, rows[:1] + rows[1:2]]))


PLANT = kp.ConeStateSpace(*kp.examples.mass_spring(), X=kp.examples.paper_cone())
WIDE = kp.ConeStateSpace(
    [[1, 0.1, 0], [0, -1, 0.2], [0, 0, 0.5]],
    [[1, 0], [0, 0], [0, 1]],
    [[0, 0, 1]],
    0,
    X=[[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]],
)
# Questions that do not hang on the decompositions that they use.
DECOMPOSED = {
    "redundant generators": lambda: kp.PolyhedralCone(many_generators().rays).n_rays,
    "from generators": lambda: kp.state_positivity(-np.eye(6), many_generators()).status,
    "growing, from generators": lambda: kp.linear_lyapunov(np.eye(6), many_generators()).status,
    "feedback": lambda: kp.state_feedback(PLANT).status,
    "feedback, four generators": lambda: kp.state_feedback(WIDE).status,
}


@pytest.mark.parametrize("routine", ["svd", "pinv", "eigvals", "eig"])
@pytest.mark.parametrize("question", DECOMPOSED)
def test_decompositions_that_do_not_converge_show_to_nobody(question, routine, monkeypatch):
    truth = DECOMPOSED[question]()

    def fail(*_, **__):
        raise np.linalg.LinAlgError("injected")

    monkeypatch.setattr(np.linalg, routine, fail)
    try:
        assert DECOMPOSED[question]() in (truth, kp.Status.UNDECIDED)
    except kp.TooLargeError:  # then facets are asked for, which these cones refuse
        assert "generators" in question


@pytest.mark.parametrize("fault", [RuntimeError, MemoryError, KeyError, SystemExit])
def test_a_solver_that_raises_is_an_answer(fault, monkeypatch):
    def fail(*_, **__):
        raise fault

    monkeypatch.setattr(linear_programs, "_run_highs", fail)
    answer = linear_programs.solve([1.0], A_ub=[[1.0]], b_ub=[1.0])
    assert answer.outcome == "failed" and "raised" in answer.message


def test_a_solver_that_hangs_is_left_behind(monkeypatch):
    monkeypatch.setattr(linear_programs, "_run_highs", lambda *_: time.sleep(30))
    start = time.monotonic()
    answer = linear_programs.solve([1.0], A_ub=[[1.0]], b_ub=[1.0], time_limit=0.2)
    assert answer.outcome == "failed" and time.monotonic() - start < 0.2 + 2


# -- interruptions


def interrupted(claim, routine, turn):
    """Ask while a routine is interrupted at one of its calls; True if there was such a call."""
    count = 0

    def replacement(original):
        def call(*arguments, **more):
            nonlocal count
            count += 1
            if count == turn:
                raise KeyboardInterrupt
            return original(*arguments, **more)

        return call

    try:
        faulted(claim, routine, replacement)
    except KeyboardInterrupt:
        return True
    assert count < turn, "the interruption was swallowed"
    return False


@pytest.mark.parametrize("routine", ROUTINES)
def test_interruptions_are_not_swallowed(routine, calls):
    for label, (claim, truth) in CLAIMS.items():
        count = calls[label].get(routine, 0)
        for turn in sorted({1, (count + 1) // 2, count}) if count else ():
            if interrupted(claim, routine, turn):
                assert verdict(claim()) is truth, label


def objects():
    """Things with caches, and questions to them with their answers."""
    nodes = [kp.examples.mass_spring_node()] * 4
    network = kp.feedback_interconnect(nodes, kp.examples.ring(4))
    cone = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])
    system = kp.ConeStateSpace([[-2, 1], [1, -2]], [[1], [0]], [[1, 0]], 0)
    plant = kp.ConeStateSpace([[1.0, 1.0], [1.0, -3.0]], [[1.0], [0.0]], [[1.0, 0.0]], 0)
    return {
        "certificate": lambda: network.certificate.status.name,
        "abscissa": lambda: round(network.spectral_abscissa()[1], 3),
        "simulation": lambda: network.initial_response([0, 0.5, 1], np.ones(8)).y.round(3).tolist(),
        "poles": lambda: np.sort(network.poles(2).real).round(3).tolist(),
        "edit": lambda: network.with_node(nodes[0], incoming={0: 0.1}).certificate.status.name,
        "facets": lambda: (cone.n_facets, cone.dual.n_rays, bool(cone.is_proper)),
        "system": lambda: (system.is_cone_positive(), system.linear_lyapunov().status.name),
        "gain": lambda: round(system.gain(), 6),
        "design": lambda: kp.state_feedback(plant).status.name,
        "network design": lambda: kp.network_feedback([plant] * 2, [[0, 0.1], [0.1, 0]]).status.name,
        "cone": lambda: kp.find_cone(plant.A, time_limit=3.0).status.name,
        "common cone": lambda: kp.find_cone([plant.A, plant.A - np.eye(2)], time_limit=3.0).status.name,
        "cone and gain": lambda: kp.design_cone_and_feedback(plant, time_limit=3.0).status.name,
    }


@pytest.mark.filterwarnings("ignore::control_kpos.errors.ActuatorLossWarning")
@pytest.mark.parametrize("question", objects())
def test_objects_answer_after_any_interruption(question):
    """An interruption at any line: trace the run, interrupt it at lines drawn at random, ask again."""
    expected = objects()[question]()
    lines = traced(objects()[question], None)
    for line in np.random.default_rng(3).integers(1, lines + 1, size=12).tolist():
        ask = objects()[question]
        with pytest.raises(KeyboardInterrupt):
            traced(ask, line)
        assert ask() == expected, f"interrupted at line {line} of {lines}"


def traced(call, stop):
    """Run, counting the lines of this package, and interrupt at one of them."""
    count, home = 0, os.path.dirname(kp.__file__)

    def trace(frame, event, _):
        nonlocal count
        if not frame.f_code.co_filename.startswith(home):
            return None
        if event == "line":
            count += 1
            if count == stop:
                raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    finally:
        sys.settrace(before)
    return count


def test_ctrl_c_ends_a_long_search_and_a_long_save(tmp_path):
    """A real signal, in a process of its own."""
    script = tmp_path / "long.py"
    script.write_text(
        textwrap.dedent(
            """
            import pathlib, signal, sys, threading, time
            import numpy as np, control_kpos as kp

            signal.signal(signal.SIGINT, signal.default_int_handler)
            rng = np.random.default_rng(0)
            family = [rng.standard_normal((6, 6)) - 3 * np.eye(6) for _ in range(6)]
            certificate = kp.linear_lyapunov([[-2, 1], [1, -2]], kp.orthant(2))
            target = pathlib.Path(sys.argv[1])

            def search():
                print("ready", flush=True)
                while True:
                    kp.find_cone(family, restarts=10**6, time_limit=60.0)

            def save():
                print("ready", flush=True)
                while True:
                    certificate.save(target)

            try:
                {"search": search, "save": save}[sys.argv[2]]()
            except KeyboardInterrupt:
                assert certificate.check() and kp.find_cone([[-1, 0], [0, -2]]).status is kp.Status.PROVED
                print("interrupted", flush=True)
            """
        )
    )
    for work in ("search", "save"):
        target = tmp_path / "certificate.json"
        process = subprocess.Popen(
            [sys.executable, str(script), str(target), work], stdout=subprocess.PIPE, text=True, env=environment()
        )
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            time.sleep(0.5)
            process.send_signal(signal.SIGINT)
            output, _ = process.communicate(timeout=60)
        finally:
            process.kill()
        assert output == "interrupted\n" and process.returncode == 0
        if work == "save":
            assert kp.load_certificate(target)
            assert [file.name for file in tmp_path.iterdir() if file.suffix == ".part"] == []


def environment():
    home = os.path.dirname(os.path.dirname(kp.__file__))
    return {**os.environ, "PYTHONPATH": os.pathsep.join([home, os.environ.get("PYTHONPATH", "")])}
