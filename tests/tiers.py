"""How much of the same thing `make slow` and `make evidence` do, and what a share may be then."""

from typing import Any

import pytest
from scipy.stats import binom

#: Tests of `make slow` that take longest, by their durations: runs side by side begin with them.
LONGEST = (
    "test_in_three_dimensions[vgtu-piezo]",
    "test_commands_run_as_printed[run-the-piezo-stage.md]",
    "test_a_stage_is_analysed_in_the_page",
    "test_better_piezo_stage_by_superelements",
    "test_it_holds_in_space[part]",
    "test_commands_run_as_printed[finite-elements.md1]",
    "test_against_the_solid_model[bridge]",
    "test_a_scale_is_centred_in_the_page",
    "test_stages_are_explored_in_the_page",
    "test_against_the_solid_model[double-parallelogram]",
    "test_from_a_record_to_the_waveform_in_a_browser",
    "test_the_whole_piezo_plan_reaches_what_it_is_for",
    "test_a_run_that_is_killed_again_and_again_ends_with_all_it_acquired[part]",
    "test_the_bench_is_sound_and_does_its_task",
    "test_a_record_outlives_its_page_and_its_server",
    "test_a_drawing_is_dropped_and_opened",
    "test_a_stage_is_designed_in_the_page",
    "test_a_3_rrr_in_space",
    "test_commands_run_as_printed[optimise.md]",
    "test_a_report_is_written_read_printed_and_kept_in_the_page",
)


def sizes(*, slow: object, evidence: object) -> list[Any]:
    """One test body at two sizes: what a change must pass, and what a release must."""
    return [
        pytest.param(*_tuple(slow), marks=pytest.mark.slow, id="part"),
        pytest.param(*_tuple(evidence), marks=pytest.mark.evidence, id="full"),
    ]


def _tuple(values: object) -> tuple[object, ...]:
    return values if isinstance(values, tuple) else (values,)


def limits(
    count: int, low: float, high: float, *, full: int, share: float = 0.95
) -> tuple[float, float]:
    """What share of `count` intervals may hold the truth, where the true share is as stated.

    Of the full number, from low to high. Of fewer, what scatters more is allowed as well: what a
    binomial leaves out in 0.13 % of all cases on either side, as three standard deviations do.
    """
    if count >= full:
        return low, high
    least, most = binom.ppf([0.00135, 0.99865], count, share)
    # between two counts, so that it does not matter whether the limit itself is allowed
    return min(low, float(least - 0.5) / count), max(high, float(most + 0.5) / count)
