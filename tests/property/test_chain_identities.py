"""Identities of the linear chain: cutting, undoing, adding up."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flexstage.base.arrays import Array
from flexstage.hysteresis import BoucWen
from flexstage.hysteresis.chain.amplifier import Amplifier
from flexstage.hysteresis.chain.creep import CreepSpectrum, LogCreep
from flexstage.hysteresis.chain.element import ChainElement
from flexstage.hysteresis.chain.lag import Lag
from flexstage.hysteresis.chain.stage_modes import StageModes

times = st.floats(1e-6, 10.0)
sequences = st.lists(st.floats(-100.0, 100.0), min_size=2, max_size=30).map(np.array)


@st.composite
def spectra(draw: st.DrawFn) -> CreepSpectrum:
    rising = draw(st.lists(times, min_size=1, max_size=4, unique=True).map(sorted))
    weight = st.floats(1e-6, 2.0)
    weights = draw(st.lists(weight, min_size=len(rising), max_size=len(rising)))
    return CreepSpectrum(times=tuple(rising), weights=tuple(weights))


@st.composite
def linear_elements(draw: st.DrawFn) -> ChainElement:
    kind = draw(st.sampled_from(("lag", "creep", "spectrum", "stage")))
    if kind == "lag":
        return Lag(time_constant=draw(times), delay=draw(st.floats(0.0, 0.05)))
    if kind == "creep":
        shortest = draw(times)
        return LogCreep(
            rate_per_decade=draw(st.floats(0.0, 0.2)),
            shortest=shortest,
            longest=shortest * draw(st.floats(1.5, 1e4)),
            per_decade=draw(st.integers(1, 3)),
        )
    if kind == "spectrum":
        return draw(spectra())
    k = draw(st.integers(1, 3))

    def several(low: float, high: float) -> list[float]:
        return draw(st.lists(st.floats(low, high), min_size=k, max_size=k))

    return StageModes(
        frequency_hz=several(0.5, 3e3), damping_ratio=several(0.0, 2.0), share=several(-0.4, 1.0)
    )


@given(linear_elements(), sequences, st.floats(1e-5, 0.02), st.integers(2, 5))
def test_cutting_lines_changes_nothing(
    element: ChainElement, x: Array, dt: float, parts: int
) -> None:
    fine = np.interp(np.arange((x.size - 1) * parts + 1) / parts, np.arange(x.size), x)
    whole = element.simulate(x, dt).values
    cut = element.simulate(fine, dt / parts).values[::parts]
    assert np.abs(whole - cut).max() < 1e-9


@given(linear_elements(), sequences, st.floats(1e-5, 0.02), st.data())
def test_cutting_records_changes_nothing(
    element: ChainElement, x: Array, dt: float, data: st.DataObject
) -> None:
    at = data.draw(st.integers(1, x.size - 1))
    whole = element.simulate(x, dt)
    first = element.simulate(x[:at], dt)
    second = element.simulate(x[at:], dt, first.state)
    assert np.array_equal(np.concatenate((first.values, second.values)), whole.values) or (
        np.abs(np.concatenate((first.values, second.values)) - whole.values).max() < 1e-11
    )
    assert np.allclose(second.state, whole.state, rtol=1e-9, atol=1e-9)


@given(linear_elements(), sequences, sequences, st.floats(-3.0, 3.0), st.floats(1e-5, 0.02))
def test_linear_elements_add_up(
    element: ChainElement, a: Array, b: Array, factor: float, dt: float
) -> None:
    n = min(a.size, b.size)
    both = element.simulate(a[:n] + factor * b[:n], dt).values
    apart = element.simulate(a[:n], dt).values + factor * element.simulate(b[:n], dt).values
    assert np.abs(both - apart).max() < 1e-10


@given(spectra(), sequences, st.floats(1e-5, 10.0))
def test_a_spectrum_undoes_itself_both_ways(creep: CreepSpectrum, x: Array, dt: float) -> None:
    there = creep.simulate(creep.inverse(x, dt).values, dt).values
    back = creep.inverse(creep.simulate(x, dt).values, dt).values
    assert np.abs(there - x).max() < 1e-10
    assert np.abs(back - x).max() < 1e-10


@given(st.floats(0.0, 0.2), times, st.floats(1.5, 1e4), sequences, st.floats(1e-5, 10.0))
def test_creep_undoes_itself_both_ways(
    rate: float, shortest: float, span: float, x: Array, dt: float
) -> None:
    creep = LogCreep(rate_per_decade=rate, shortest=shortest, longest=shortest * span)
    there = creep.simulate(creep.inverse(x, dt).values, dt).values
    back = creep.inverse(creep.simulate(x, dt).values, dt).values
    assert np.abs(there - x).max() < 1e-10
    assert np.abs(back - x).max() < 1e-10


@given(
    sequences,
    st.floats(1e-5, 0.02),
    st.integers(2, 6),
    st.floats(5.0, 3e3),
    st.floats(1e2, 1e6),
    st.floats(0.3, 3.0),
)
def test_cutting_lines_changes_nothing_for_a_limited_amplifier(
    x: Array, dt: float, parts: int, bandwidth_hz: float, slew: float, gain: float
) -> None:
    amplifier = Amplifier(
        bandwidth_hz=bandwidth_hz, slew_limit=slew, voltage_range=(-31.0, 83.0), gain=gain
    )
    fine = np.interp(np.arange((x.size - 1) * parts + 1) / parts, np.arange(x.size), x)
    whole = amplifier.simulate(x, dt).values
    cut = amplifier.simulate(fine, dt / parts).values
    assert np.abs(whole - cut[::parts]).max() < 1e-8
    assert cut.min() >= -31.0
    assert cut.max() <= 83.0
    assert np.abs(np.diff(cut)).max(initial=0.0) <= slew * dt / parts * (1.0 + 1e-9) + 1e-12


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.floats(0.0, 120.0), min_size=2, max_size=25).map(np.array),
    st.floats(1e-5, 5e-3),
    st.integers(2, 4),
    st.sampled_from((-0.02, 0.0, 0.03, 0.05)),
)
def test_hysteresis_and_stage_do_not_depend_on_cuts(
    u: Array, dt: float, parts: int, gamma: float
) -> None:
    model = BoucWen(gain=0.593, hysteresis_gain=0.544, beta=0.05, gamma=gamma)
    stage = StageModes(frequency_hz=[339.0], damping_ratio=[0.012], share=[0.9])
    fine = np.interp(np.arange((u.size - 1) * parts + 1) / parts, np.arange(u.size), u)
    form, finer = model.segments(u), model.segments(fine)
    assert form is not None
    assert finer is not None
    whole, cut = stage.through(form, dt), stage.through(finer, dt / parts)
    assert np.abs(whole.values - cut.values[::parts]).max() < 2e-11
