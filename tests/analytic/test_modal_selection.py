"""Automatic modes on responses of stages: none that is not there, none missed that stands out.

Evidence (Measuring and centring): automatic modes, 100 responses: in 95 none false or missed 20 dB
above noise; *simulated* [*evidence*]
"""

import math
import re
from dataclasses import dataclass

import numpy as np
import pytest

from flexstage.base import progress
from flexstage.base.errors import ModelError
from flexstage.lumped import lumped_system
from flexstage.measure.modal.assessment import on_flank
from flexstage.measure.modal.fit import fit_modes
from flexstage.measure.modal.prepare import line_scatter, local_poles
from flexstage.measure.modal.result import ModalFit, Mode
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.quantities.estimate import Estimate
from flexstage.stage.designs import design
from flexstage.system import ModalDamping, modes
from tests.tiers import sizes

STAGES = ("vgtu-piezo", "vgtu-mechanical", "parallelogram")
#: A mode that is to be found stands this far above the noise of a line at its peak [dB].
CLEAR = 20.0


@dataclass(frozen=True, kw_only=True)
class Case:
    """A response of a stage as it may be measured, and the modes behind it."""

    response: MeasuredResponse
    frequency: np.ndarray
    damping: np.ndarray
    peak: np.ndarray
    above: np.ndarray
    spacing: np.ndarray
    delay: float

    @property
    def band(self) -> tuple[float, float]:
        lines = self.response.frequency_hz
        return float(lines[0]), float(lines[-1])

    def obliged(self) -> list[int]:
        """Modes that must be found: resolved, inside the band, apart from a stronger one."""
        f, half = self.frequency, self.damping * self.frequency
        low, high = self.band
        clear = (f - 2.0 * half > low) & (f + 2.0 * half < high) & (half > 2.0 * self.spacing)
        return [
            int(i)
            for i in np.flatnonzero(clear & (self.above >= CLEAR))
            if not any(
                j != i and abs(f[j] - f[i]) < half[i] + half[j] and self.peak[j] > self.peak[i]
                for j in range(f.size)
            )
        ]


def made(seed: int) -> Case:
    """One to five modes of a stage in the band, others beside it, uneven lines, a delay or none."""
    rng = np.random.default_rng(np.random.SeedSequence(77, spawn_key=(seed,)))
    while True:
        system = lumped_system(
            design(STAGES[int(rng.integers(3))]), damping=ModalDamping(ratio=0.01)
        )
        found = modes(system, drives="in place" if rng.random() < 0.5 else "removed", count=None)
        f = found.frequency_hz
        zeta = np.exp(rng.uniform(math.log(0.004), math.log(0.03))) * rng.uniform(0.7, 1.4, f.size)
        drive = system.drives[int(rng.integers(len(system.drives)))]
        count = min(int(rng.integers(1, 3)), len(system.probes))
        probes = [system.probes[i] for i in rng.choice(len(system.probes), count, replace=False)]
        own = 2.0 * np.pi * f
        parts = np.stack(
            [(p.vector @ found.shapes) * (drive.vector @ found.shapes) for p in probes]
        )
        size = np.abs(parts) / own**2
        strong = np.flatnonzero(
            (size > 1e-4 * size.max(axis=1, keepdims=True)).any(axis=0) & (f > 1.0)
        )
        if strong.size:
            break
    first = int(rng.integers(0, min(3, strong.size)))
    inside = strong[first : first + int(rng.integers(1, 6))]
    low = f[inside[0]] * rng.uniform(0.4, 0.85)
    high = f[inside[-1]] * rng.uniform(1.15, 1.8)
    lines = _lines(rng, low, high, f[inside], zeta[inside])
    omega = 2.0 * np.pi * lines[:, None]
    h = np.stack(
        [np.sum(a / (own**2 - omega**2 + 2j * zeta * own * omega), axis=1) for a in parts], axis=1
    )
    delay = float(rng.choice([0.0, 1.0]) * rng.uniform(0.05, 3.0) / high)
    h = h * np.exp(-1j * omega * delay)
    even = 10.0 ** (-rng.uniform(40.0, 90.0) / 20.0) * np.abs(h).max(axis=0)
    share = 10.0 ** (-rng.uniform(30.0, 70.0) / 20.0) * (rng.random() < 0.5)
    deviation = np.hypot(even, share * np.abs(h))
    noise = rng.standard_normal(h.shape) + 1j * rng.standard_normal(h.shape)
    noise *= deviation / math.sqrt(2.0)
    at = np.array([np.argmin(np.abs(lines - x)) for x in f])
    peak = np.abs(parts) / (2.0 * zeta * own**2)
    above = 20.0 * np.log10(np.maximum((peak / deviation[at].T).max(axis=0), 1e-15))
    response = MeasuredResponse(
        frequency_hz=lines,
        response=(h + noise)[:, :, None],
        inputs=("force",),
        outputs=tuple(p.name for p in probes),
        output_units=("m",) * len(probes),
        input_units=("N",),
    )
    return Case(
        response=response,
        frequency=f,
        damping=zeta,
        peak=peak.max(axis=0),
        above=above,
        spacing=np.gradient(lines)[at],
        delay=delay,
    )


def _lines(rng, low, high, f, zeta):
    kind = int(rng.integers(3))
    if kind == 0:
        lines = np.geomspace(low, high, int(rng.integers(300, 1200)))
    elif kind == 1:
        # a stepped sine, denser about resonances
        lines = np.geomspace(low, high, int(rng.integers(150, 400)))
        for x, z in zip(f, zeta, strict=True):
            lines = np.concatenate((lines, x * (1.0 + z * np.linspace(-5.0, 5.0, 41))))
        lines = np.unique(np.clip(lines, low, high))
    else:
        lines = np.linspace(low, high, int(rng.integers(400, 2000)))
    return np.unique(lines * (1.0 + 1e-4 * rng.standard_normal(lines.size)))


def faults(case: Case, fit: ModalFit) -> list[str]:
    """What a list of modes has that the stage has not, and the other way round."""
    f, half = case.frequency, case.damping * case.frequency
    got = np.array([mode.frequency_hz.value for mode in fit.modes])
    said = [
        f"missed {f[i]:.1f} Hz" for i in case.obliged() if not np.any(np.abs(got - f[i]) < half[i])
    ]
    for mode, value in zip(fit.modes, got, strict=True):
        known = np.maximum(half, 3.0 * mode.frequency_hz.uncertainty)
        if not (case.band[0] <= value <= case.band[1]) or not np.any(np.abs(value - f) < known):
            said.append(f"spurious {value:.1f} Hz")
    for i in range(f.size):
        beside = np.sum(np.abs(f - f[i]) < 3.0 * half[i])
        if np.sum(np.abs(got - f[i]) < half[i]) > beside:
            said.append(f"twice {f[i]:.1f} Hz")
    return said


def fitted(case: Case) -> ModalFit:
    late = case.delay > 0.0
    return fit_modes(case.response, delay=late, real_modes=late)


@pytest.mark.parametrize("seed", [11, 17, 21])
def test_modes_of_a_stage(seed):
    case = made(seed)
    assert faults(case, fitted(case)) == []


@pytest.mark.parametrize(("repeats", "allowed"), sizes(slow=(16, 1), evidence=(100, 5)))
def test_automatic_modes_are_those_of_the_stage(repeats, allowed):
    """Delay, modes beyond the band, uneven lines, and noise that nobody has stated."""
    wrong = {}
    for seed in range(repeats):
        case = made(seed)
        fit = fitted(case)
        assert [m.frequency_hz.value for m in fit.modes] == sorted(
            m.frequency_hz.value for m in fit.modes
        )
        assert (fit.delay is not None) == (case.delay > 0.0)
        said = faults(case, fit)
        if said:
            wrong[seed] = said
    assert len(wrong) <= allowed, wrong


# --------------------------------------------------------------------- what a fit is asked and says

LINES = np.arange(20.0, 400.0, 0.5)


def response(deviation: float = 0.0, *, delay: float = 0.0, lines=LINES, third=470.0):
    """Two modes and the flank of a third, which is beyond the band."""
    s = 2j * np.pi * lines
    h = np.zeros(lines.size, dtype=complex)
    for f, zeta, size in ((86.3, 0.012, 1.0), (211.7, 0.017, -0.7), (third, 0.01, 0.8)):
        w = 2.0 * np.pi * f
        h += size * w * 1e3 / (s * s + 2.0 * zeta * w * s + w * w)
    rng = np.random.default_rng(8)
    noise = rng.standard_normal(lines.size) + 1j * rng.standard_normal(lines.size)
    h = h * np.exp(-s * delay) + deviation * np.abs(h).max() * noise
    return MeasuredResponse(
        frequency_hz=lines,
        response=h[:, None, None],
        inputs=("force",),
        outputs=("table",),
        output_units=("m",),
        input_units=("N",),
    )


@pytest.mark.slow
def test_a_steady_phase_slope_is_named():
    late = fit_modes(response(1e-3, delay=2.1e-3), delay=False)
    assert any("fit a delay as well" in note and "delay of 2.2 ms" in note for note in late.notes)
    untold = fit_modes(response(1e-3, delay=2.1e-3))
    assert untold.delay is not None
    assert untold.delay.value == pytest.approx(2.1e-3, rel=2e-2)
    assert [m.frequency_hz.value for m in untold.modes] == pytest.approx([86.3, 211.7], rel=1e-3)
    assert any("it is fitted too" in note for note in untold.notes)
    assert not any("delay" in note for note in fit_modes(response(1e-3)).notes)
    told = fit_modes(response(1e-3, delay=2.1e-3), delay=True, real_modes=True)
    assert told.delay is not None
    assert told.delay.value == pytest.approx(2.1e-3, rel=2e-2)
    assert not any("option delay" in note for note in told.notes)


def test_a_delay_that_is_asked_for_is_given_even_without_modes():
    rng = np.random.default_rng(4)
    noise = rng.standard_normal((LINES.size, 1, 1)) + 1j * rng.standard_normal((LINES.size, 1, 1))
    bare = MeasuredResponse(
        frequency_hz=LINES, response=noise, inputs=("force",), outputs=("table",)
    )
    fit = fit_modes(bare, delay=True)
    assert fit.modes == ()
    assert fit.delay is not None


def test_guessed_modes_are_those_nearest():
    fit = fit_modes(response(1e-3), frequency_guess=[210.0])
    (mode,) = fit.modes
    assert mode.frequency_hz.value == pytest.approx(211.7, rel=1e-3)
    assert any("not requested" in note for note in fit.notes)
    nothing = fit_modes(response(1e-3), frequency_guess=[150.0])
    assert any("does not exceed the noise" in note for note in nothing.notes)
    with pytest.raises(ModelError, match="be in the band from 20 to"):
        fit_modes(response(1e-3), frequency_guess=[900.0])


def scanned(seed: int):
    """A stage for a scanning microscope: four modes behind an amplifier and a delay."""
    lines = np.geomspace(30.0, 1200.0, 300)
    s = 2j * np.pi * lines
    h = np.full(lines.size, -0.02 + 0.0j)
    for f, zeta, size in SCANNER:
        w = 2.0 * np.pi * f
        h += size * w * w / (s * s + 2.0 * zeta * w * s + w * w)
    h *= np.exp(-120e-6 * s) / (1.0 + s / (2.0 * np.pi * 900.0))
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((2, lines.size)) + 1j * rng.standard_normal((2, lines.size))
    h = h * (1.0 + 1.4e-3 * noise[0]) + 7e-5 * noise[1]
    return MeasuredResponse(
        frequency_hz=lines, response=h[:, None, None], inputs=("u",), outputs=("y",)
    )


SCANNER = (
    (213.0, 0.0227, 1.0), (361.0, 0.0121, -0.22), (487.0, 0.0472, 0.55), (801.0, 0.0196, -0.3)
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_no_hidden_pole_eats_the_damping_of_a_mode_that_is_asked_for(seed):
    """An amplifier that the model lacks makes many poles significant: they are punished."""
    fit = fit_modes(
        scanned(seed), frequency_guess=[215.0, 364.0, 492.0, 809.0], delay=True, real_modes=True
    )
    for mode, (f, zeta, _) in zip(fit.modes, SCANNER, strict=True):
        assert mode.frequency_hz.value == pytest.approx(f, rel=2e-3)
        assert mode.damping_ratio.value == pytest.approx(zeta, rel=0.05)
        for other in fit.background:
            apart = abs(other.frequency_hz.value - mode.frequency_hz.value)
            assert apart > 3.0 * zeta * f or other.damping_ratio.value > 5.0 * zeta


def test_an_interval_holds_the_fit_with_and_without_a_background():
    record = scanned(1)
    guess = [f for f, _, _ in SCANNER]
    near = fit_modes(record, frequency_guess=guess)
    alone = fit_modes(record, count=4)
    assert len(near.background) == 1
    for mode, other in zip(near.modes, alone.modes, strict=True):
        assert mode.damping_ratio.covers(other.damping_ratio.value)
        assert "background" in [c.name for c in mode.damping_ratio.components]


def test_a_mode_that_is_only_a_flank():
    def mode(f, zeta, size):
        exact = Estimate(value=f, unit="Hz"), Estimate(value=zeta, unit="1")
        one = np.ones((1, 1))
        return Mode(
            frequency_hz=exact[0], damping_ratio=exact[1], shape=one[0], residues=size * one + 0j,
            shape_uncertainty=np.zeros((1, 2)),
            significance=1e3,
        )  # fmt: skip

    sharp = mode(486.0, 0.046, 100.0)
    assert on_flank(mode(435.0, 0.073, 30.0), sharp)
    # its own peak is above the flank; it is far away; it is the sharper one
    assert not on_flank(mode(435.0, 0.073, 90.0), sharp)
    assert not on_flank(mode(300.0, 0.073, 30.0), sharp)
    assert not on_flank(mode(435.0, 0.01, 30.0), sharp)


def test_many_modes_are_refined_where_the_model_changes():
    """More than are refined together: each is found, and whoever waits sees how far it is."""
    rng = np.random.default_rng(4)
    f, zeta = 40.0 + 22.3 * np.arange(20) + rng.uniform(-5, 5, 20), rng.uniform(0.004, 0.012, 20)
    lines = np.arange(20.0, 500.0, 0.4)
    s, w = 2j * np.pi * lines[:, None], 2.0 * np.pi * f
    size = rng.uniform(0.4, 1.0, (20, 2)) * rng.choice([-1.0, 1.0], (20, 2))
    h = (w * w / (s * s + 2.0 * zeta * w * s + w * w)) @ size
    h = h + 0.02 * (rng.standard_normal(h.shape) + 1j * rng.standard_normal(h.shape))
    record = MeasuredResponse(
        frequency_hz=lines, response=h[:, :, None], inputs=("u",), outputs=("a", "b")
    )
    shares = []
    with progress.listen(lambda _, done: shares.append(done)):
        fit = fit_modes(record)
    assert [m.frequency_hz.value for m in fit.modes] == pytest.approx(f, rel=1e-3)
    assert [m.damping_ratio.value for m in fit.modes] == pytest.approx(zeta, rel=0.1)
    assert shares == sorted(shares)
    assert len(set(shares)) > 4


def test_a_peak_without_a_mode_is_said():
    """A phase that rises through a peak is that of no decaying mode, as of a swapped sign."""
    lines = np.arange(1.0, 500.0, 0.3)
    w, s = 2.0 * np.pi * 192.5, 2j * np.pi * lines
    h = np.conj(1e3 * w * w / (s * s + 2e-3 * w * s + w * w))
    rng = np.random.default_rng(3)
    h = h + 3.0 * (rng.standard_normal(lines.size) + 1j * rng.standard_normal(lines.size))
    turned = MeasuredResponse(
        frequency_hz=lines, response=h[:, None, None], inputs=("u",), outputs=("y",)
    )
    fit = fit_modes(turned)
    assert fit.modes == ()
    assert re.search(r"peaks at 192\.\d+ Hz, \S+ times its median, with \d lines?", fit.notes[0])


def test_relative_weights_show_what_is_small():
    """Four decades down, noise in proportion: with even weights the small mode is of no account."""
    lines = np.geomspace(20.0, 4000.0, 900)
    s = 2j * np.pi * lines
    h = np.zeros(lines.size, dtype=complex)
    for f, zeta, size in ((86.3, 0.012, 1.0), (1900.0, 0.01, 3e-4)):
        w = 2.0 * np.pi * f
        h += size * w * w / (s * s + 2.0 * zeta * w * s + w * w)
    rng = np.random.default_rng(5)
    noise = rng.standard_normal(lines.size) + 1j * rng.standard_normal(lines.size)
    h = h * (1.0 + 0.01 * noise)
    measured = MeasuredResponse(
        frequency_hz=lines, response=h[:, None, None], inputs=("u",), outputs=("y",)
    )
    fit = fit_modes(measured, weighting="relative")
    assert [m.frequency_hz.value for m in fit.modes] == pytest.approx([86.3, 1900.0], rel=1e-3)
    with pytest.raises(ModelError, match="'relative'"):
        fit_modes(measured, weighting="inverse")  # type: ignore[arg-type]


def test_poles_that_are_no_modes_are_named_and_kept():
    fit = fit_modes(response(1e-4, third=409.0))
    assert [m.frequency_hz.value for m in fit.modes] == pytest.approx([86.3, 211.7], rel=1e-3)
    assert fit.correlation.shape == (4, 4)
    (beyond,) = [m for m in fit.background if m.frequency_hz.value > LINES[-1]]
    assert beyond.frequency_hz.value == pytest.approx(409.0, rel=0.01)
    assert any("not listed" in note and "outside the band" in note for note in fit.notes)


def test_a_window_is_blamed_only_where_there_is_one():
    lines = np.arange(20.0, 400.0, 4.0)
    notes = fit_modes(response(1e-3, lines=lines), count=2).notes
    assert any("may be inaccurate" in note for note in notes)
    assert not any("window" in note for note in notes)


def test_scatter_of_lines_is_their_noise():
    """A resonance of three lines in its half-power width, and noise that falls over the band."""
    lines = np.arange(20.0, 400.0, 0.7)
    clean = response(lines=lines).response
    deviation = np.abs(clean).max() * np.geomspace(1e-2, 1e-4, lines.size)[:, None, None]
    found = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal(clean.shape) + 1j * rng.standard_normal(clean.shape)
        found.append(line_scatter(lines, clean + deviation * noise / math.sqrt(2.0)) / deviation)
    mean = np.sqrt(np.mean(np.square(found), axis=0))
    assert np.median(mean) == pytest.approx(1.0, abs=0.06)
    assert np.quantile(mean, 0.9) < 1.3


def test_poles_of_stretches_do_not_mind_a_delay():
    poles, gains = local_poles(LINES, response(1e-3, delay=2.1e-3).response)
    strongest = poles[np.argsort(gains)[::-1][:6]]
    assert np.abs(np.abs(strongest) / (2.0 * np.pi) - 86.3).min() < 0.3
    assert gains.min() > 0.0
