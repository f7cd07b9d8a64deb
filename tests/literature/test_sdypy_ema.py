"""Poles and residues beside those of sdypy-EMA, an independent implementation of both steps.

Evidence (Measuring and centring): poles, residues (sdypy-EMA): $10^{-8}$; noise-free frequency
$10^{-6}$, damping $10^{-4}$; at 3 % noise at most half its damping error, *simulated*
"""

import math
import warnings

import numpy as np
import pytest

from flexstage.measure.modal.fit import fit_modes
from flexstage.measure.modal.result import modal_assurance
from flexstage.measure.modal.stabilisation import stable_poles
from flexstage.measure.spectra.response import MeasuredResponse

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    EMA = pytest.importorskip("sdypy.EMA", reason="sdypy-EMA is not installed")

F = np.arange(0.0, 1000.5, 0.5)
LOWEST = 50.0
MODES = ((210.0, 0.013), (254.2, 0.01), (533.0, 0.02))


def frequency_responses(noise: float) -> np.ndarray:
    rng = np.random.default_rng(1)
    residues = rng.standard_normal((3, 4)) - 20j * rng.standard_normal((3, 4))
    s = 2j * np.pi * F[:, None]
    h = np.zeros((F.size, 4), dtype=np.complex128)
    for (f, zeta), residue in zip(MODES, residues, strict=True):
        p = 2.0 * np.pi * f * complex(-zeta, math.sqrt(1.0 - zeta * zeta))
        h += residue / (s - p) + residue.conj() / (s - p.conjugate())
    white = rng.standard_normal(h.shape) + 1j * rng.standard_normal(h.shape)
    return h + noise * np.abs(h).max() * white


def peer(h: np.ndarray, order: int):
    model = EMA.Model(frf=h.T, freq=F, lower=LOWEST, upper=1000.0, pol_order_high=order,
                      frf_form="receptance")  # fmt: skip
    model.get_poles("lscf", show_progress=False)
    return model


def ours(h: np.ndarray, frequency: np.ndarray, variance: np.ndarray | None) -> MeasuredResponse:
    size = frequency.size
    return MeasuredResponse(
        frequency_hz=frequency, response=h[:size, :, None], inputs=("force",),
        outputs=tuple("abcd"), output_units=("m",) * 4,
        variance=None if variance is None else np.broadcast_to(
            variance[:, None, None], (size, 4, 1)).copy(),
    )  # fmt: skip


def test_poles_of_each_order_are_equal():
    h = frequency_responses(0.01)
    model = peer(h, 12)
    # the peer leaves out the last line, and counts the one at half the sampling rate once where the
    # others stand for their negative frequencies too
    frequency = model.freq
    variance = np.ones(frequency.size)
    variance[-1] = 2.0
    found = stable_poles(
        ours(h, frequency, variance),
        band=(LOWEST, float(frequency[-1])),
        orders=range(2, 25, 2),
        coefficients="real",
    )
    for theirs, own in zip(model.all_poles, found.orders, strict=True):
        upper = theirs[(theirs.imag > 0.0) & (theirs.real < 0.0)]
        size = np.abs(upper)
        upper = upper[
            (-upper.real < 0.7 * size)
            & (size >= 2.0 * np.pi * LOWEST)
            & (size <= 2.0 * np.pi * frequency[-1])
        ]
        upper = upper[np.argsort(np.abs(upper))]
        # rounding in normal equations of order 24
        np.testing.assert_allclose(own.poles, upper, rtol=1e-8)
    assert found.orders[-1].poles.size >= 3


def test_residues_are_equal():
    h = frequency_responses(0.0)
    model = peer(h, 30)
    fit = fit_modes(ours(h, F, None), band=(LOWEST, 999.0), count=3)
    assert len(fit.modes) == 3
    # the second step of the peer, at the same poles
    model.all_poles = [np.array([mode.pole for mode in fit.modes])]
    model.pole_ind = [[0, n] for n in range(3)]
    _, constants = model.get_constants(f_lower=LOWEST, f_upper=999.0)
    for n, mode in enumerate(fit.modes):
        scale = np.abs(constants[:, n]).max()
        np.testing.assert_allclose(mode.residues[:, 0], constants[:, n], atol=1e-8 * scale)
        assert modal_assurance(mode.shape, constants[:, n])[0, 0] == pytest.approx(1.0, abs=1e-8)


def test_modes_without_noise_are_equal():
    h = frequency_responses(0.0)
    model = peer(h, 30)
    model.select_closest_poles([f for f, _ in MODES])
    fit = fit_modes(ours(h, F, None), band=(LOWEST, 1000.0))
    assert len(fit.modes) == 3
    for n, mode in enumerate(fit.modes):
        # both are the truth, but for rounding in the peer's normal equations
        assert mode.frequency_hz.value == pytest.approx(model.nat_freq[n], rel=1e-6)
        assert mode.damping_ratio.value == pytest.approx(model.nat_xi[n], rel=1e-4)


def test_refined_modes_are_nearer_to_the_truth():
    """Least squares with noise in the denominator is biased; greatest likelihood is not."""
    h = frequency_responses(0.03)
    model = peer(h, 30)
    model.select_closest_poles([f for f, _ in MODES])
    fit = fit_modes(ours(h, F, None), band=(LOWEST, 1000.0), count=3)
    truth = np.array([zeta for _, zeta in MODES])
    own = np.array([m.damping_ratio.value for m in fit.modes])
    assert (
        np.abs(own / truth - 1.0).max() < 0.5 * np.abs(np.array(model.nat_xi) / truth - 1.0).max()
    )
