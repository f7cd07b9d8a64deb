"""The benchmarks of measuring and centring run, at sizes at which they prove nothing."""

from collections.abc import Iterator

import pytest

from benchmarks import centring, frequency_response, measuring
from benchmarks.cases import Row

SMALL = {
    "record": lambda: frequency_response.long_record(samples=60_000, runs=1),
    "lengths": lambda: frequency_response.lengths(samples=20_000, sizes=(512,), runs=1),
    "growth": lambda: frequency_response.growth(sizes=(120_000,), runs=1),
    "fit": lambda: centring.fit(count=3, turns=3, per_turn=(90,), runs=1),
    "heads": lambda: centring.heads(counts=(1, 2), samples=36, runs=1),
    "turns": lambda: centring.turns(counts=(1, 3), samples=72, runs=1),
    "budget": lambda: measuring.budget(trials=10_000, runs=1),
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n == "growth" else n for n in SMALL]
)
def test_a_case_runs(name: str) -> None:
    work: Iterator[Row] = SMALL[name]()
    rows = list(work)
    assert len(rows) > 1
    assert all(row.time.seconds > 0.0 and row.limit for row in rows)
    first = rows[0].time.seconds
    assert [row.ratio for row in rows] == pytest.approx([r.time.seconds / first for r in rows])
