"""Ratios instead of raw times: every contender of a question is measured in the same run."""

import os
from dataclasses import dataclass

import peers
import pytest

# KPOS_SMALL=1 only shows that the benchmarks run; its ratios mean nothing.
SMALL = os.environ.get("KPOS_SMALL", "0") not in ("", "0")
TIMINGS = pytest.StashKey[list["Timing"]]()


@dataclass(frozen=True)
class Timing:
    """Best time of one contender, or what it took until it was ended."""

    question: str
    who: str
    seconds: float
    at_most: float | None
    remark: str = ""


@pytest.fixture
def size():
    """Choose the size to measure at, or the small one: size(500, 50)."""
    return lambda full, small: small if SMALL else full


@pytest.fixture
def contest(benchmark, request):
    """Time one contender: contest("question", "who", function, at_most=...).

    The contender called "ours" is divided by each of the others.  `at_most` is the ratio to reach, stated with
    the other contender; with "ours" it is a limit in seconds.
    """

    def run(question, who, function, *, at_most=None, rounds=5):
        benchmark.group = question
        result = benchmark.pedantic(function, rounds=1 if SMALL else rounds, warmup_rounds=0 if SMALL else 1)
        timings = request.config.stash.setdefault(TIMINGS, [])
        timings.append(Timing(question, who, benchmark.stats.stats.min, at_most))
        return result

    return run


@pytest.fixture
def slow_contest(benchmark, request, tmp_path):
    """One call of a slow peer in a process of its own: slow_contest("question", "who", "peer", data, at_most=...).

    It is ended after 300 s (20 s at small size) or at 12 GB; the table then says so, and in the first case by how
    much it is slower at least.
    """

    def run(question, who, peer, data, *, at_most=None):
        peers.save(tmp_path, **data)
        benchmark.group = question
        outcome = benchmark.pedantic(peers.ask, (peer, tmp_path, 20 if SMALL else 300), rounds=1)
        timings = request.config.stash.setdefault(TIMINGS, [])
        timings.append(Timing(question, who, outcome.seconds, at_most, outcome.remark))
        return outcome

    return run


def pytest_terminal_summary(terminalreporter, config):
    timings = config.stash.get(TIMINGS, [])
    if not timings:
        return
    write = terminalreporter.write_line
    terminalreporter.section("ratios" + (", at a size where they mean nothing" if SMALL else ""))
    write(f"{'question':42s} {'ours':>10s}  {'compared with':28s} {'other':>10s} {'ratio':>8s} {'to reach':>9s}")
    for ours in (t for t in timings if t.who == "ours"):
        others = [t for t in timings if t.question == ours.question and t is not ours]
        if ours.at_most is not None or not others:
            others.insert(0, Timing(ours.question, "the clock", 1.0, ours.at_most))
        for other in others:
            ratio = ours.seconds / other.seconds
            goal = "" if other.at_most is None else f"{other.at_most:g}"
            missed = "  MISSED" if not SMALL and other.at_most is not None and ratio > other.at_most else ""
            below = "<" if other.remark.endswith(" s") else "?" if other.remark else " "
            time = other.remark or _milliseconds(other)
            write(
                f"{ours.question:42s} {_milliseconds(ours)}  {other.who:28s} {time:>10s} "
                f"{below}{ratio:7.3g} {goal:>9s}{missed}"
            )


def _milliseconds(timing):
    return f"{1e3 * timing.seconds:7.4g} ms"
