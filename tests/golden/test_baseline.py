"""The comparison with what was frozen finds what moved, and nothing else."""

import functools
import json
from typing import Any

import numpy as np
import pytest

from tests.golden import baseline
from tests.golden.baseline import Leaf, differences, from_lines, kept, leaf, measured, work

RNG = np.random.default_rng(18)
LONG = RNG.normal(2.7, 1.0, 12_345)


def answer(**changes: Any) -> Leaf:
    """An answer with a word, a short list and a long one, as a command prints it."""
    content = {
        "stage": {"name": "vgtu-piezo", "ratio": 1.6966},
        "frequency_hz": [865.25, 507.25, 1204.5],
        "response": LONG.tolist(),
        "created": "2026-11-23T15:44:22",
    } | changes
    return leaf("answer.json", json.dumps(content).encode())


@functools.cache
def was() -> Any:
    return kept(answer())


def test_every_name_is_frozen() -> None:
    assert sorted(path.stem for path in baseline.FOLDER.glob("*.json")) == sorted(work())


def test_studies_are_computed_and_not_read() -> None:
    studies = [line for lines in work().values() for line in lines if line[0] == "study"]
    assert len(studies) == len(baseline.STAGES)
    assert all("--no-cache" in line for line in studies)


@pytest.mark.parametrize(
    "same",
    [
        {},
        {"created": "2027-01-01T00:00:01"},
        {"frequency_hz": [865.25 * (1 + 5e-10), 507.25, 1204.5]},
    ],
)
def test_times_and_the_last_digits_are_no_difference(same: dict[str, Any]) -> None:
    assert differences(was(), answer(**same)) == []


def changed(place: int, factor: float) -> list[float]:
    values = LONG.copy()
    values[place] *= factor
    return values.tolist()


def swapped(a: int, b: int) -> list[float]:
    values = LONG.copy()
    values[[a, b]] = values[[b, a]]
    return values.tolist()


@pytest.mark.parametrize(
    ("other", "family"),
    [
        ({"stage": {"name": "vgtu-piezo", "ratio": 1.6966 * (1 + 3e-9)}}, ".stage.ratio"),
        ({"frequency_hz": [507.25, 865.25, 1204.5]}, ".frequency_hz"),
        ({"frequency_hz": [865.25, 507.25]}, ".frequency_hz"),
        ({"response": changed(7_000, 1.0 + 3e-6)}, ".response"),
        ({"response": swapped(1_000, 1_001)}, ".response"),
        ({"response": LONG[:-1].tolist()}, ".response"),
        ({"stage": {"name": "vgtu-mechanical", "ratio": 1.6966}}, "the words"),
        ({"stage": {"name": "vgtu-piezo"}}, ".stage.ratio"),
        ({"turns": 3}, ".turns"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_moved_is_found(other: dict[str, Any], family: str) -> None:
    assert [text for text in differences(was(), answer(**other)) if text.startswith(family)]


def figures(value: float) -> Leaf:
    row = {"quantity": "stroke", "value": value, "uncertainty": 2e-8, "interval": [5.9e-5, 5.91e-5]}
    return leaf("answer.json", json.dumps({"figures": [row]}).encode())


def test_a_run_may_differ_by_its_uncertainty_alone() -> None:
    before = kept(figures(5.905e-5))
    assert measured(before, figures(5.905e-5 + 4.9 * 2e-8)) == []
    assert measured(before, figures(5.905e-5 + 5.1 * 2e-8))
    assert measured(before, leaf("answer.json", b'{"figures": []}'))


def test_paths_and_checksums_are_no_words() -> None:
    one = from_lines([("", "wrote /tmp/a1/out/model.c 0123456789abcdef0123 in 3.2 s so far")])
    two = from_lines([("", "wrote /tmp/b2/x/model.c fedcba98765432100123 in 4.7 s so far")])
    assert one.words == two.words
    assert differences(kept(one), two) == []
