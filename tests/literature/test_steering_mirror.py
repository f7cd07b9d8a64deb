"""A fine steering mirror on three stacks: one model of all levels against published ones.

Evidence (Hysteresis and records): steering mirror, three stacks, three sensors, three levels
(M. Floren and others 2024: one nonlinear model 0.087, 0.131, 0.169 µm, three linear ones 0.114,
0.216, 0.228 µm): one model, stepped in time, held-out records 0.085, 0.112, 0.165 µm; stepped with
its commands for references through six resonances, 1e-5 µm [*slow*]
"""

import numpy as np
import pytest

from flexstage.hysteresis.coupled_drives.identify import (
    CoupledDriveIdentification,
    identify_coupled_drives,
)
from flexstage.hysteresis.coupled_drives.inverse import coupled_commands
from flexstage.records import Channel, Record
from tests.shared_data import DATA, needs

pytestmark = [pytest.mark.slow, needs("fine-steering-mirror")]

INPUTS, OUTPUTS = ("u1", "u2", "u3"), ("y1", "y2", "y3")
RATE, PERIOD = 6400.0, 8192
#: Largest errors allowed at 100, 200 and 300 mV [µm]: 1 % above those of this model, and below
#: those of a prototype, made by others (0.086, 0.115, 0.173).
ALLOWED = (0.0857, 0.1130, 0.1668)


@pytest.fixture(scope="module")
def records() -> list[Record]:
    """Return six records at each of three levels, two periods each; outputs in µm."""
    result = []
    for level in (100, 200, 300):
        with np.load(DATA / "fine-steering-mirror" / f"train_{level}mV.npz") as arrays:
            u, y = (np.asarray(arrays[name], dtype=float) for name in "uy")
        for k in range(6):
            columns = [
                a[:, :, k, :].transpose(2, 0, 1).reshape(-1, 3) * scale
                for a, scale in ((u, 1.0), (y, 1e6))
            ]
            values = np.ascontiguousarray(np.hstack(columns).T)
            named = zip((*INPUTS, *OUTPUTS), values, strict=True)
            channels = tuple(
                Channel(name=n, values=v, unit="V" if n in INPUTS else "um") for n, v in named
            )
            time = np.arange(values.shape[1]) / RATE
            source = f"{level} mV, realisation {k + 1}"
            result.append(Record(channels=channels, time=time, source=source))
    return result


@pytest.fixture(scope="module")
def identification(records: list[Record]) -> CoupledDriveIdentification:
    """Return the model of the realisations 4 to 6 of each level."""
    return identify_coupled_drives([r for k, r in enumerate(records) if k % 6 > 2], INPUTS, OUTPUTS)


def test_one_model_predicts_held_out_records_sample_by_sample(
    records: list[Record], identification: CoupledDriveIdentification
) -> None:
    model, squares = identification.model, [[], [], []]
    for k, record in enumerate(records):
        if k % 6 > 2 or k in (1, 2):  # fitted, or not in steady state
            continue
        u = np.column_stack([record.channel(n).values for n in INPUTS]).reshape(2, PERIOD, 3)
        y = np.column_stack([record.channel(n).values for n in OUTPUTS]).reshape(2, PERIOD, 3)
        simulated, _ = model.simulate(np.tile(u.mean(0), (4, 1)))
        difference = (y.mean(0) - simulated[-PERIOD:]) - (y.mean(0) - simulated[-PERIOD:]).mean(0)
        squares[k // 6].append(np.mean(difference**2))
    errors = [float(np.sqrt(np.mean(s))) for s in squares]
    assert all(error < allowed for error, allowed in zip(errors, ALLOWED, strict=True)), errors


def test_modes_soften_with_the_level_and_hardly_gain_damping(
    identification: CoupledDriveIdentification,
) -> None:
    levels = identification.levels
    strong = [i for i, f in enumerate(levels[1].frequency_hz) if f < 1400.0]
    frequency = np.array([level.frequency_hz[strong] for level in levels])
    # as others found in the same data, for the second mode
    assert frequency[:, 1] == pytest.approx([814.2, 809.6, 806.3], abs=0.3)
    assert np.all(np.diff(frequency[:, [0, 1, 2, 4, 5]], axis=0) < 0.0)
    assert identification.modes.imaginary_share[1] < 0.06


def test_commands_lead_the_model_along_references_through_its_resonances(
    identification: CoupledDriveIdentification,
) -> None:
    # random motion of 1 um to 300 Hz, and to 1.2 kHz: six resonances
    frequency = np.fft.rfftfreq(2 * PERIOD, 1.0 / RATE)
    phases = np.exp(2j * np.pi * np.random.default_rng(1).random((frequency.size, 3)))
    for highest in (300.0, 1200.0):
        within = (frequency > 2.0) & (frequency < highest)
        target = np.fft.irfft(within[:, None] * phases, axis=0)
        target /= np.sqrt(np.mean(target**2))
        # the largest commands are a twentieth above those of the records, the default limit
        result = coupled_commands(identification.model, target, limits=(-1.4, 1.4))
        assert result.limited == 0
        error = result.predicted - result.reference
        assert np.sqrt(np.mean(error**2)) < 1e-5
        assert result.rms_error.max() < 2e-3


def test_records_that_have_not_settled_are_named(records: list[Record]) -> None:
    result = identify_coupled_drives(records[:6], INPUTS, OUTPUTS)
    assert result.warnings[0].startswith(
        "not in steady state, and not used: 100 mV, realisation 2, 100 mV, realisation 3;"
    )
    assert result.levels[0].floor == pytest.approx(0.06, abs=0.002)
