"""Error, interval and band of held-out stretches: against known scatter, and with one another."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.hysteresis import Dahl, identify
from flexstage.hysteresis.identification.fit_rows import ChainValues, Rows
from flexstage.hysteresis.identification.measurement import IdentificationData
from flexstage.hysteresis.identification.model_fit import fit_data
from flexstage.hysteresis.identification.residuals import held_out_errors, stretches_of
from flexstage.records import Channel, Record
from flexstage.report.identification import heldout_in_words
from flexstage.virtual.stack import virtual_stack

EACH = 30


def data_of(*records, used=None):
    """Return rows of records of so many cycles, of which some cycles are in use."""
    cycles = [np.repeat(np.arange(count), EACH) for count in records]
    use = [np.ones(c.size, dtype=bool) if used is None else np.isin(c, used) for c in cycles]
    nothing = IdentificationData(
        sections=(), sign=1.0, input_unit="", output_unit="", stroke=100.0, warnings=()
    )
    rows = tuple(Rows(at=np.arange(c.size), cycle=c) for c in cycles)
    return replace(fit_data(nothing, ChainValues()), rows=rows, use=tuple(use))


def errors_of(*rms):
    """Return the figures of stretches whose errors are of one size each [% of the stroke]."""
    return held_out_errors([[r * np.tile([1.0, -1.0], EACH)] for r in rms], data_of(1))


def test_the_interval_in_closed_form():
    rms = np.array([0.20, 0.25, 0.22, 0.28, 0.21])
    # the 97.5 % point of the distribution of Student for four degrees of freedom: 2.7764
    by_chance = 2.7764 * np.std(np.log(rms), ddof=1) * np.sqrt(1.2)
    factor = np.exp(np.hypot(by_chance, 1.96 * 0.4))
    mean = np.sqrt(np.mean(rms**2))
    assert errors_of(*rms).interval_percent == pytest.approx((mean / factor, mean * factor), 1e-4)


def test_too_few_stretches_or_one_that_dominates_determine_no_interval():
    assert errors_of(0.2, 0.21, 0.2).interval_percent is None
    found = errors_of(0.9, 1.1, 0.8, 1.0, 37.0)
    assert found.interval_percent is None
    assert (found.median_percent, found.worst_percent) == pytest.approx((1.0, 37.0))


def test_the_interval_holds_another_stretch():
    """Stretches scatter by a tenth, and another one by 0.4 more, in the logarithm."""
    rng, inside = np.random.default_rng(7), []
    for _ in range(600):
        interval = errors_of(*0.3 * np.exp(rng.normal(0.0, 0.1, 5))).interval_percent
        assert interval is not None
        inside.append(
            interval[0] <= 0.3 * np.exp(rng.normal(0.0, np.hypot(0.1, 0.4))) <= interval[1]
        )
    assert 0.93 < np.mean(inside) < 0.985


def test_the_band_holds_errors_of_another_stretch():
    """Stretches of noise whose standard deviations differ by a fifth."""
    rng, held = np.random.default_rng(8), []
    for _ in range(200):
        sizes = np.exp(rng.normal(0.0, 0.2, 6))
        *stretches, other = (size * rng.normal(size=400) for size in sizes)
        band = held_out_errors([[e] for e in stretches], data_of(1)).band_percent
        held.append(np.mean(np.abs(other) <= band))
    assert 0.94 < np.mean(held) < 0.99


def test_records_are_held_out_whole_and_one_record_in_stretches():
    one = stretches_of(data_of(20))
    assert [int(stretch[0].sum()) // EACH for stretch in one] == [4] * 5
    # one run of neighbours each
    assert all(np.count_nonzero(np.diff(stretch[0].astype(int))) <= 2 for stretch in one)
    several = stretches_of(data_of(9, 3, 5))
    assert [[bool(rows.all()) for rows in stretch] for stretch in several] == np.eye(3).tolist()
    assert [[bool(rows.any()) for rows in stretch] for stretch in several] == np.eye(3).tolist()
    # rows that are not in use are held out of nothing
    part = stretches_of(data_of(20, used=[0, 1, 2]))
    assert [int(stretch[0].sum()) // EACH for stretch in part] == [1] * 3
    assert stretches_of(data_of(20, used=[])) == []
    assert len(stretches_of(data_of(*[2] * 33))) == 10


def record_of(seed):
    """Return one or several short records of a stack, with a drift or a few cycles for some."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(rng.integers(300, 900))) * 0.02
    grows = np.clip(0.1 + (t / t[-1]) ** rng.uniform(0.2, 3.0), 0.0, 1.0)
    u = 60.0 - 60.0 * grows * np.cos(2.0 * np.pi * rng.uniform(0.3, 1.5) * t)
    y = virtual_stack((0.0, 120.0), 38e-6, 0.12).simulate(u).values
    y = y + rng.normal(0.0, 4e-8, t.size) + 10 ** rng.uniform(-8.0, -5.5) * (t / t[-1]) ** 2
    channels = (Channel(name="u", values=u, unit="V"), Channel(name="y", values=y, unit="m"))
    return Record(channels=channels, time=t, source="a drive")


@pytest.mark.parametrize("seed", range(3))
def test_the_figures_of_a_line_do_not_contradict_each_other(seed):
    records = [record_of(10 * seed + k) for k in range(1 + 2 * (seed % 3))]
    found = identify(records, "u", "y", model="dahl", chain=ChainValues())
    rms, band = found.heldout_rms_percent, found.heldout_band_percent
    median, worst = found.heldout_median_percent, found.heldout_worst_percent
    assert None not in (rms, band, median, worst, found.heldout_max_percent)
    assert median <= worst
    assert min(median, rms) <= worst <= found.heldout_max_percent
    assert 0.0 <= band <= found.heldout_max_percent
    text = heldout_in_words(found)
    if found.heldout_interval_percent is None:
        assert f"median of the stretches {median:.3g}, worst {worst:.3g}" in text
    else:
        low, high = found.heldout_interval_percent
        assert 0.0 < low < rms < high <= 4.0 * rms
        assert "not determined" not in text
    assert "+-" not in text


def test_a_model_that_is_exact_has_no_held_out_error():
    u = 60.0 - 60.0 * np.cos(np.arange(900) / 17.0)
    y = Dahl(gain=3.3e-7, stiffness=1.1e-7, limit=2.1e-6).simulate(u).values
    channels = (Channel(name="u", values=u, unit="V"), Channel(name="y", values=y, unit="m"))
    record = Record(channels=channels, time=np.arange(900) * 0.01, source="a drive")
    found = identify(record, "u", "y", model="dahl", chain=ChainValues())
    assert found.heldout_max_percent is not None
    assert found.heldout_max_percent < 0.01
