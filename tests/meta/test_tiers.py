"""What the tiers of the tests promise."""

from pathlib import Path

from scipy.stats import binom

from tests.longest import LONGEST
from tests.tiers import limits

TESTS = Path(__file__).parents[1]


def test_the_longest_tests_are_there() -> None:
    text = "".join(path.read_text("utf-8") for path in TESTS.rglob("test_*.py"))
    missing = [name for name in LONGEST if f"def {name.partition('[')[0]}(" not in text]
    assert not missing


def test_limits_of_fewer_repetitions_leave_out_what_they_say() -> None:
    assert limits(600, 0.93, 0.97, full=600) == (0.93, 0.97)
    low, high = limits(150, 0.93, 0.97, full=600)
    below = binom.cdf(low * 150, 150, 0.95)
    above = binom.sf(high * 150, 150, 0.95)
    # the next count inwards would leave out more than the normal distribution beyond 3 sigma
    assert below < 0.00135 < binom.cdf(low * 150 + 1, 150, 0.95)
    assert above < 0.00135 < binom.sf(high * 150 - 1, 150, 0.95)
    # what is allowed of the full number for other reasons is allowed of fewer
    assert limits(150, 0.85, 1.0, full=600) == (0.85, 1.0)
