"""Progress without a terminal: a line of each long phase, and one every ten seconds."""

import time

import pytest

from flexstage.base import progress
from flexstage.base.progress import ProgressLines, in_lines


def lines_of(phases: dict[float, tuple[str, float]], until: float) -> list[tuple[float, str]]:
    """What is written, and when, of work whose phases begin at these times."""
    lines = ProgressLines("identify", 0.0)
    made = []
    for k in range(1, int(2 * until) + 1):
        now = 0.5 * k
        if now in phases:
            lines.update(*phases[now])
        line = lines.line(now)
        if line is not None:
            made.append((now, line))
    return made


def test_short_work_says_nothing() -> None:
    assert lines_of({0.5: ("mesh", 0.1), 3.0: ("modes", 0.6)}, 4.9) == []


def test_a_long_phase_is_named_and_then_every_ten_seconds() -> None:
    phases = {0.5: ("Dahl", 0.0), 7.0: ("Duhem", 0.2), 7.5: ("Preisach", 0.4), 30.0: ("end", 1.0)}
    assert lines_of(phases, 31.0) == [
        (5.0, "identify: Dahl, 0 %, 5 s so far"),
        # Duhem was over before two seconds had passed
        (9.5, "identify: Preisach, 40 %, 10 s so far"),
        (19.5, "identify: Preisach, 40 %, 20 s so far"),
        (29.5, "identify: Preisach, 40 %, 30 s so far"),
    ]


def test_work_that_changes_its_phase_all_the_time_is_named_every_ten_seconds() -> None:
    phases = {0.5 * k: (f"model {k}", k / 100.0) for k in range(1, 80)}
    assert [at for at, _ in lines_of(phases, 35.0)] == [10.0, 20.0, 30.0]


def test_work_that_says_nothing_is_reported_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"_LONG": 0.01, "_EVERY": 0.05, "_POLL": 0.005}.items():
        monkeypatch.setattr(progress, name, value)
    lines: list[str] = []
    with in_lines(lines.append, "study", 0.02), progress.subtask(0.5, 1.0):
        progress.update("stress", 0.5)
        until = time.monotonic() + 30.0
        while len(lines) < 3 and time.monotonic() < until:
            time.sleep(0.01)
    assert len(lines) >= 3
    assert lines[-1].startswith("study: stress, 75 %, ")
