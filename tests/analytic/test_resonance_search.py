"""The resonance that a record shows, against the mode that made it.

Evidence (Hysteresis and records): identified resonance 0.2 %, creep 0.15 points per decade, delay
0.06 samples; *simulated*
"""

import numpy as np
import pytest

from flexstage.hysteresis import PrandtlIshlinskii
from flexstage.hysteresis.chain.creep import LogCreep
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes
from flexstage.hysteresis.excitations.design import excitation
from flexstage.hysteresis.identification.identify import identify
from flexstage.hysteresis.identification.measurement import measurement
from flexstage.hysteresis.identification.resonance_search import find_resonance
from flexstage.records import Channel, Record

RATE = 4000.0
# memory that is wiped out: one that fades, as that of Bouc-Wen, is taken for creep in part
STACK = PrandtlIshlinskii(
    gain=0.31e-6,
    thresholds=np.array([3.0, 9.0, 17.0, 31.0]),
    weights=np.array([0.06e-6, 0.05e-6, 0.07e-6, 0.04e-6]),
)


def record(
    *,
    multisine: bool,
    mode: StageModes | None,
    noise: float = 4e-9,
    delay: float = 0.00031,
    duration: float = 15.0,
) -> Record:
    made = excitation(
        (0.0, 113.0),
        sample_rate=RATE,
        rates=(1.1, 9.0),
        frequency=412.0,
        multisine=multisine,
        hold_time=2.0,
        duration=duration,
    )
    y = LogCreep(rate_per_decade=0.011).simulate(STACK.simulate(made.voltage).values, 1.0 / RATE)
    moved = y.values if mode is None else mode.simulate(y.values, 1.0 / RATE).values
    moved = Lag(delay=delay).simulate(moved, 1.0 / RATE).values
    moved = moved + noise * np.random.default_rng(8).standard_normal(moved.size)
    return Record(
        channels=(
            Channel(name="u", values=made.voltage, unit="V"),
            Channel(name="y", values=moved, unit="m"),
        ),
        time=made.time,
    )


@pytest.mark.parametrize(("frequency", "damping"), [(412.7, 0.0131), (431.0, 0.045)])
def test_frequency_and_damping_are_found(frequency: float, damping: float) -> None:
    mode = StageModes(frequency_hz=(frequency,), damping_ratio=(damping,))
    section = measurement([record(multisine=True, mode=mode)], "u", "y").sections[0]
    found = find_resonance(section)
    assert found is not None
    # the memory that the multisine moves a little, and creep, are in what is left: 0.2 %
    assert found.frequency_hz == pytest.approx(frequency, rel=2e-3)
    assert found.damping_ratio == pytest.approx(damping, rel=0.04)
    assert 0.0 < found.frequency_error_hz < 0.5


def test_nothing_is_found_where_nothing_rings_or_nothing_is_shown() -> None:
    without_mode = measurement([record(multisine=True, mode=None)], "u", "y").sections[0]
    assert find_resonance(without_mode) is None
    mode = StageModes(frequency_hz=(412.7,), damping_ratio=(0.0131,))
    unexcited = measurement([record(multisine=False, mode=mode)], "u", "y").sections[0]
    assert find_resonance(unexcited) is None


@pytest.mark.parametrize(
    ("frequency", "damping", "delay"),
    [(412.7, 0.0131, 0.0006), (412.0, 0.28, 0.0003), (700.0, 0.02, 0.0003), (150.0, 0.02, 0.0003)],
    ids=["delay beyond the longest", "damping beyond the largest", "above the band", "below it"],
)
def test_a_mode_at_the_edge_of_the_search_is_not_taken(
    frequency: float, damping: float, delay: float
) -> None:
    mode = StageModes(frequency_hz=(frequency,), damping_ratio=(damping,))
    made = record(multisine=True, mode=mode, delay=delay)
    assert find_resonance(measurement([made], "u", "y").sections[0]) is None


def test_a_delay_short_of_the_longest_is_found() -> None:
    mode = StageModes(frequency_hz=(412.7,), damping_ratio=(0.0131,))
    made = record(multisine=True, mode=mode, delay=0.00046)
    found = find_resonance(measurement([made], "u", "y").sections[0])
    assert found is not None
    # a tenth of a period of the slowest content that is looked at, which is 204 Hz
    assert found.delay == pytest.approx(0.00046, abs=2e-6)
    assert found.frequency_hz == pytest.approx(412.7, rel=1e-4)


@pytest.mark.slow
def test_the_chain_holds_what_was_found() -> None:
    mode = StageModes(frequency_hz=(412.7,), damping_ratio=(0.0131,))
    made = record(multisine=True, mode=mode, duration=25.0)
    found = identify(made, "u", "y", model="preisach")
    chain = {e.name: e for e in found.chain}
    assert chain["resonance_hz"].value == pytest.approx(412.7, rel=2e-3)
    assert found.model.modes is not None
    # the phase of the multisine tells the delay to some hundredths of a sample
    assert chain["delay"].value == pytest.approx(0.00031, abs=1.5e-5)
    assert chain["creep_per_decade"].value == pytest.approx(0.011, abs=1.5e-3)
    # the plays of the grid lie between those of the stack
    assert found.rms_percent < 0.08


@pytest.mark.slow
def test_jumps_show_it_as_well() -> None:
    rate, mode = 5000.0, StageModes(frequency_hz=(287.0,), damping_ratio=(0.014,))
    t = np.arange(int(6.0 * rate)) / rate
    slow = 55.0 - 52.0 * np.cos(2.0 * np.pi * 1.1 * t)
    jumps = np.repeat([0.0, 40.0, 12.0, 71.0, 33.0, 96.0, 3.0], int(0.4 * rate))
    u = np.concatenate((slow, jumps, slow))
    y = mode.simulate(STACK.simulate(u).values, 1.0 / rate).values
    y = Lag(delay=0.0007).simulate(y, 1.0 / rate).values
    y = y + 4e-9 * np.random.default_rng(3).standard_normal(y.size)
    whole = Record(
        channels=(Channel(name="u", values=u), Channel(name="y", values=y)),
        time=np.arange(u.size) / rate,
    )
    found = identify(whole, "u", "y", model="preisach")
    assert found.model.modes is not None
    assert found.model.modes.frequency_hz[0] == pytest.approx(287.0, rel=1e-4)
    assert found.model.modes.damping_ratio[0] == pytest.approx(0.014, rel=0.01)
    # and not a period of the ringing more, which fits almost as well
    assert found.model.lag is not None
    assert found.model.lag.delay == pytest.approx(0.0007, abs=1e-5)
    # a jump takes one sample, and is no rate; slow motion up to a jump may count as one
    assert found.measurement.rates_hz[0] == pytest.approx(1.1, rel=0.02)
    assert found.measurement.rates_hz[-1] < 4.0
    assert found.rms_percent < 0.08


@pytest.mark.slow
def test_what_is_held_out_does_not_show_a_resonance() -> None:
    mode = StageModes(frequency_hz=(412.7,), damping_ratio=(0.0131,))
    made = record(multisine=True, mode=mode)
    # the multisine is at the end of the record
    found = identify(made, "u", "y", model="dahl", train=(0, int(0.8 * made.size)))
    assert "resonance_hz" not in {e.name for e in found.chain}
    assert found.model.modes is None
