"""Progress: every line to a callable, one overwritten line where somebody watches, nothing elsewhere."""

import io
import sys
import time

from control_kpos import progress
from control_kpos.progress import Reporter


class Terminal(io.StringIO):
    def isatty(self):
        return True


def terminal(monkeypatch, patience=0.0):
    """Set inside a test, not in a fixture: pytest puts its own stderr in place between the two."""
    out = Terminal()
    monkeypatch.setattr(sys, "stderr", out)
    monkeypatch.setattr(progress, "_PATIENCE", patience)
    return out


def test_a_callable_hears_every_line_at_once():
    lines = []
    with Reporter(lines.append) as report:
        report("one")
        report("two")
    assert lines == ["one", "two"]


def test_lines_overwrite_each_other_and_the_last_is_ended(monkeypatch):
    out = terminal(monkeypatch)
    with Reporter(None) as report:
        report("a long line")
        report("short")
    first, second = out.getvalue().split("\r")[1:]
    assert (first.strip(), second.strip()) == ("a long line", "short")
    assert len(first) == len(second.rstrip("\n")) and second.endswith("\n")


def test_silent_where_nobody_watches_unless_asked(monkeypatch):
    monkeypatch.setattr(progress, "_PATIENCE", 0.0)
    for target, said in ((None, False), (False, False), (True, True)):
        out = io.StringIO()
        monkeypatch.setattr(sys, "stderr", out)
        with Reporter(target) as report:
            report("working")
        assert ("working" in out.getvalue()) is said


def test_silent_on_a_terminal_if_asked(monkeypatch):
    out = terminal(monkeypatch)
    with Reporter(False) as report:
        report("working")
    assert out.getvalue() == ""


def test_short_work_says_nothing(monkeypatch):
    out = terminal(monkeypatch, 60.0)
    with Reporter(None) as report:
        report("working")
    assert out.getvalue() == ""


def test_the_last_word_before_a_long_silence_is_shown(monkeypatch):
    out = terminal(monkeypatch, 0.01)
    with Reporter(None) as report:
        report("solving a large program")
        for _ in range(500):
            if out.getvalue():
                break
            time.sleep(0.01)
        assert "solving a large program" in out.getvalue()
