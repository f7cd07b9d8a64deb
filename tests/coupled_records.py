"""Simulated records of two drives and three sensors whose stage softens with the level."""

from functools import cache

import numpy as np

from flexstage.base.arrays import Array
from flexstage.hysteresis.coupled_drives.model import CoupledDriveModel
from flexstage.hysteresis.coupled_drives.softening import Softening
from flexstage.hysteresis.coupled_drives.state_space import ModalSystem
from flexstage.records import Channel, Record

RATE, PERIOD = 2000.0, 1024
FREQUENCY = np.array([130.0, 210.0, 340.0])
DAMPING = np.array([0.01, 0.015, 0.012])
SHAPES = np.array([[0.8, 0.6], [-0.6, 0.8], [0.96, -0.28]])


def linear_system() -> ModalSystem:
    """Return a system of three modes seen by three sensors, with a delay of one sample."""
    omega = 2.0 * np.pi * FREQUENCY / RATE
    poles = np.exp(omega * (-DAMPING + 1j * np.sqrt(1.0 - DAMPING**2)))
    outputs = np.array([[1.0, 0.4, -0.5], [0.3, -0.9, 0.2], [-0.2, 0.5, 0.7]])
    return ModalSystem(
        poles=poles,
        output_shapes=outputs * (0.5 - 0.3j),
        input_shapes=np.asarray(SHAPES * (omega * 1j)[:, None], dtype=np.complex128),
        feedthrough=np.array([[0.1, 0.02], [-0.03, 0.2], [0.0, 0.05]]),
    )


def softening_drives(strength: float = 1.0) -> Softening:
    """Return drives that soften by some tenths of a per cent between the levels."""
    return Softening(
        compliance=np.array([0.06, 0.1, 0.04]),
        force_gains=np.array([[-0.4, 0.05], [0.02, -0.6]]),
        strength=strength * np.array([0.9, 0.5]),
        exponent=0.5,
        memory_gains=np.array([0.04, 0.06, 0.05]),
        frequency_hz=FREQUENCY,
        damping_ratio=DAMPING,
        input_shapes=SHAPES,
        force_reference=np.array([0.5, 0.55]),
        voltage_reference=np.array([0.5, 0.5]),
    )


def coupled_model(strength: float = 1.0) -> CoupledDriveModel:
    """Return the model of both."""
    return CoupledDriveModel(
        drives=softening_drives(strength),
        system=linear_system(),
        sample_rate_hz=RATE,
        inputs=("a", "b"),
        outputs=("x", "y", "z"),
        input_unit="V",
        output_unit="um",
        level_range=((0.2, 0.6), (0.2, 0.6)),
        band_hz=(RATE / PERIOD, 229 * RATE / PERIOD),
        largest_input=(2.5, 2.5),
    )


def multisine(rms: float, seed: int) -> Array:
    """Return a period of two independent random-phase multisines to 450 Hz, shape (n, 2)."""
    lines = np.arange(1, 230)
    spectrum = np.zeros((PERIOD // 2 + 1, 2), complex)
    spectrum[lines] = np.exp(2j * np.pi * np.random.default_rng(seed).random((lines.size, 2)))
    signal = np.fft.irfft(spectrum, axis=0)
    return signal * (rms / np.sqrt(np.mean(signal**2, axis=0)))


def record_of(u: Array, y: Array, source: str = "") -> Record:
    """Return a record of voltages and readings."""
    named = [*zip(("a", "b"), u.T, strict=True), *zip(("x", "y", "z"), y.T, strict=True)]
    channels = tuple(
        Channel(name=n, values=np.ascontiguousarray(v), unit="V" if n in "ab" else "um")
        for n, v in named
    )
    return Record(channels=channels, time=np.arange(len(u)) / RATE, source=source)


@cache
def simulated_records() -> tuple[Record, ...]:
    """Return two periods in steady state of four realisations at three levels, with noise."""
    model, rng, records = coupled_model(), np.random.default_rng(7), []
    for k, rms in enumerate((0.2, 0.4, 0.6)):
        for seed in range(4):
            u = np.tile(multisine(rms, 10 * k + seed), (8, 1))
            y, _ = model.simulate(u, time_constant=1.0)
            y += 1e-4 * rng.standard_normal(y.shape)
            last = slice(-2 * PERIOD, None)
            records.append(record_of(u[last], y[last], f"level {k}, {seed}"))
    return tuple(records)
