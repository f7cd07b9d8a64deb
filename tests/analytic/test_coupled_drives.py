"""Coupled drives: their linear systems, steady state, steps, derivatives and identification."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import ModelError, RecordError
from flexstage.hysteresis.coupled_drives.identify import identify_coupled_drives
from flexstage.hysteresis.coupled_drives.inverse import coupled_commands
from flexstage.hysteresis.coupled_drives.model import CoupledDriveModel, CoupledDriveState
from flexstage.hysteresis.coupled_drives.model_file import coupled_model_text, read_coupled_model
from flexstage.hysteresis.coupled_drives.periodic import (
    best_linear,
    period_of,
    periodic_spectra,
)
from flexstage.hysteresis.coupled_drives.softening import (
    SofteningFit,
    rms_levels,
    steady_state,
)
from flexstage.hysteresis.coupled_drives.state_space import (
    ModalSystem,
    modes_of,
    subspace_systems,
)
from flexstage.records import Record
from tests.coupled_records import (
    DAMPING,
    FREQUENCY,
    PERIOD,
    RATE,
    SHAPES,
    coupled_model,
    linear_system,
    multisine,
    record_of,
    simulated_records,
    softening_drives,
)


def test_a_subspace_system_is_the_one_whose_response_is_given() -> None:
    system = linear_system()
    lines = np.arange(1, PERIOD // 2)
    z = np.exp(2j * np.pi * lines / PERIOD)
    response = system.response(z)
    form = coupled_model(0.0).linear()
    assert form.inputs == ("a [V]", "b [V]")
    resolvent = z[:, None, None] * np.eye(len(form.A)) - form.A
    direct = form.C @ np.linalg.solve(resolvent, np.tile(form.B, (z.size, 1, 1))) + form.D
    assert np.abs(response - direct).max() < 1e-12 * np.abs(response).max()
    (fit,) = subspace_systems(response, lines, PERIOD, [6], blocks=40)
    assert fit.order == 6
    # the impulse response is longer than the period: poles are found to the ends of its tail
    assert np.abs(fit.response(z) - response).max() < 2e-3 * np.abs(response).max()
    modes = modes_of(fit, RATE, 0.5 * RATE)
    assert modes.frequency_hz == pytest.approx(FREQUENCY, rel=1e-4)
    assert modes.damping_ratio == pytest.approx(DAMPING, rel=0.02)
    assert np.abs(np.sum(modes.input_shapes * SHAPES, axis=1)) == pytest.approx(1.0, abs=1e-4)


def test_a_mode_that_many_states_split_is_one_and_two_of_other_directions_are_two() -> None:
    system = linear_system()
    for direction, count in ((SHAPES[1], 3), (SHAPES[0], 4)):
        weak = 0.05j * np.linalg.norm(system.input_shapes[1]) * direction
        more = replace(
            system,
            poles=np.append(system.poles, system.poles[1] * np.exp(0.004j)),
            input_shapes=np.vstack((system.input_shapes, weak)),
            output_shapes=np.column_stack((system.output_shapes, system.output_shapes[:, 1])),
        )
        modes = modes_of(more, RATE, 0.5 * RATE)
        assert modes.frequency_hz.size == count
        assert modes.frequency_hz[1] == pytest.approx(FREQUENCY[1], rel=1e-6)


def test_a_growing_mode_is_mirrored_into_a_decaying_one() -> None:
    system = linear_system()
    growing = replace(system, poles=system.poles / np.abs(system.poles) * 1.01)
    lines = np.arange(1, PERIOD // 2)
    response = growing.response(np.exp(2j * np.pi * lines / PERIOD))
    (fit,) = subspace_systems(response, lines, PERIOD, [12], blocks=40)
    assert np.abs(fit.poles).max() < 1.0


def test_steps_reach_the_steady_state_that_the_loop_at_each_line_has() -> None:
    model, u = coupled_model(), multisine(0.5, 3)
    spectra = periodic_spectra([record_of(u, u[:, [0, 1, 0]])], ["a", "b"], ["x", "y", "z"])
    state = steady_state(model.drives, spectra, fitted=False)
    steady = np.einsum("lpm,lm->lp", model.system.response(spectra.z), state.total[0])
    start = replace(
        model.rest(),
        force_square=state.sigma[0] ** 2,
        voltage_square=rms_levels(spectra.inputs)[0] ** 2,
    )
    y, after = model.simulate(np.tile(u, (20, 1)), start, time_constant=np.inf)
    stepped = np.fft.rfft(y[-PERIOD:], axis=0)[spectra.lines] * np.sqrt(2.0) / PERIOD
    assert np.abs(stepped - steady).max() < 1e-8 * np.abs(steady).max()
    assert after.force_square == pytest.approx(start.force_square, rel=1e-14)
    # in two parts as at once, and the loop matters
    first, between = model.simulate(u[:300])
    second, _ = model.simulate(u[300:], between)
    at_once, _ = model.simulate(u)
    assert np.array_equal(np.vstack((first, second)), at_once)
    still = np.einsum("lpm,lm->lp", model.system.response(spectra.z), spectra.inputs[0])
    assert np.abs(still - steady).max() > 0.02 * np.abs(steady).max()


@pytest.mark.parametrize("modes", [False, True])
def test_derivatives_are_those_of_the_residual(modes: bool) -> None:
    spectra = periodic_spectra(simulated_records()[::2], ["a", "b"], ["x", "y", "z"])
    fit = SofteningFit(spectra, np.array([1.2, 1.2, 1.0, 1.0, 0.7, 0.7]))
    start = replace(softening_drives(0.8), voltage_reference=np.full(2, 0.45))
    vector = start.vector(modes)
    point = fit._point(start, None)
    jacobian = fit._jacobian(start, point, modes).view(np.float32).astype(float)
    weighted = np.moveaxis(point.residuals * fit._weights[:, None, None], 0, -1)
    residual = np.ascontiguousarray(weighted).reshape(-1).view(float)
    slope = 2.0 * (jacobian @ residual) / (6 * 3)
    for i in range(vector.size):
        changed = []
        for sign in (1.0, -1.0):
            moved = vector.copy()
            moved[i] += sign * 1e-4
            changed.append(fit._point(start.moved(moved), None).cost)
        numerical = (changed[0] - changed[1]) / 2e-4
        assert slope[i] == pytest.approx(numerical, rel=2e-3, abs=2e-3 * np.abs(slope).max()), i


def test_a_simulated_stage_is_identified_at_all_levels() -> None:
    records = simulated_records()
    fitted = [r for k, r in enumerate(records) if k % 4]
    result = identify_coupled_drives(fitted, ["a", "b"], ["x", "y", "z"], test_records=records[::4])
    # one linear system of all levels is off by the softening
    for level, held_out in zip(result.levels, result.held_out, strict=True):
        assert level.records == 3
        assert level.error < 0.01 * level.output_rms
        assert held_out < 0.01 * level.output_rms
    spectra = periodic_spectra(fitted, ["a", "b"], ["x", "y", "z"])
    _, residuals = best_linear(spectra.inputs, spectra.outputs)
    weakest = residuals[spectra.level == 0]
    assert np.sqrt(np.sum(np.abs(weakest) ** 2) / 9) > 0.03 * result.levels[0].output_rms
    for i, frequency in enumerate(FREQUENCY):
        by_level = [level.frequency_hz[i] for level in result.levels]
        assert by_level == sorted(by_level, reverse=True)
        assert by_level[1] == pytest.approx(frequency, rel=0.01)
    rows = result.to_dict()
    assert [row["records"] for row in rows["levels"]] == [3, 3, 3]
    assert rows["modes"][0]["imaginary_share"] < 0.05
    assert not result.warnings


def test_one_level_gives_a_linear_model_and_says_so() -> None:
    result = identify_coupled_drives(simulated_records()[:4], ["a", "b"], ["x", "y", "z"])
    assert result.warnings == (
        "one level only: the model is linear; record at three levels to see the stage soften",
    )
    assert result.levels[0].error < 0.01 * result.levels[0].output_rms


def test_records_of_one_period_have_no_noise_and_are_all_used() -> None:
    model, records = coupled_model(), []
    for seed in range(4):
        u = multisine(0.2, seed)
        y, _ = model.simulate(np.tile(u, (8, 1)))
        records.append(record_of(u, y[-PERIOD:]))
    result = identify_coupled_drives(records, ["a", "b"], ["x", "y", "z"])
    assert result.levels[0].records == 4
    assert np.isnan(result.levels[0].noise)
    assert result.levels[0].error < 0.01 * result.levels[0].output_rms


def test_a_record_that_has_not_settled_is_named_and_not_used() -> None:
    model, records = coupled_model(), list(simulated_records()[:4])
    u = np.tile(multisine(0.2, 0), (2, 1))
    y, _ = model.simulate(u)
    unsettled = record_of(u, y, "begun at rest")
    result = identify_coupled_drives([*records, unsettled], ["a", "b"], ["x", "y", "z"])
    assert result.levels[0].records == 4
    assert result.warnings[0].startswith("not in steady state, and not used: begun at rest;")


def test_the_period_is_found_in_the_inputs() -> None:
    u = multisine(0.3, 5)
    assert period_of(np.tile(u, (3, 1))) == PERIOD
    assert period_of(u) == PERIOD
    assert period_of(np.tile(u, (3, 1))[: 2 * PERIOD + 100]) == PERIOD


def constant_column(record: Record, name: str) -> Record:
    channels = (
        replace(c, values=np.zeros(record.size)) if c.name == name else c for c in record.channels
    )
    return replace(record, channels=tuple(channels))


def part_of(record: Record, size: int) -> Record:
    """Return a beginning whose inputs have the rms of one level."""
    channels = []
    for c in record.channels:
        values = c.values[:size]
        channels.append(replace(c, values=values / np.sqrt(np.mean(values**2))))
    return replace(record, channels=tuple(channels), time=record.time[:size])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: (r[:1], ["a", "b"]), "level 1 has 1 records, and 2 inputs need at least 2"),
        (lambda r: (r, ["a"]), "coupled drives need two inputs or more, got 1"),
        (lambda r: ([r[0], r[0], r[0]], ["a", "b"]), "inputs of level 1 are not independent"),
        (lambda r: ([constant_column(x, "b") for x in r], ["a", "b"]), "column 'b' is constant in"),
        (lambda r: ([constant_column(x, "y") for x in r], ["a", "b"]), "column 'y' is constant in"),
        (
            lambda r: ([part_of(x, 100) for x in r], ["a", "b"]),
            "100 samples is too short",
        ),
        (
            lambda r: ([r[0], replace(r[1], time=2.0 * r[1].time)], ["a", "b"]),
            "need one sample rate, got 1000 and 2000 Hz",
        ),
    ],
)
def test_records_that_cannot_tell_are_refused(change, message: str) -> None:  # type: ignore[no-untyped-def]
    records, inputs = change(list(simulated_records()[:4]))
    with pytest.raises(RecordError, match=message):
        identify_coupled_drives(records, inputs, ["x", "y", "z"])


def test_outputs_that_do_not_follow_are_refused() -> None:
    noise = np.random.default_rng(1)
    records = [
        record_of(np.tile(multisine(0.3, k), (2, 1)), noise.standard_normal((2 * PERIOD, 3)))
        for k in range(6)
    ]
    with pytest.raises(RecordError, match="do not follow these inputs"):
        identify_coupled_drives(records, ["a", "b"], ["x", "y", "z"])


def test_voltages_of_another_shape_are_refused() -> None:
    with pytest.raises(ModelError, match="finite, in 2 columns, got shape"):
        coupled_model().simulate(np.zeros((5, 3)))


def test_a_level_that_no_record_had_is_refused() -> None:
    model = coupled_model()
    u = np.tile(multisine(0.55, 2), (3, 1))
    model.simulate(u)
    with pytest.raises(ModelError, match=r"input 'a' reaches a level of 0\.\d+ V rms"):
        model.simulate(1.6 * u)


def test_a_model_file_holds_the_same_numbers(tmp_path: Path) -> None:
    result = identify_coupled_drives(simulated_records()[:4], ["a", "b"], ["x", "y", "z"])
    path = tmp_path / "model.yaml"
    path.write_text(coupled_model_text(result), "utf-8")
    model = read_coupled_model(path)
    u = multisine(0.15, 8)
    assert np.array_equal(model.simulate(u)[0], result.model.simulate(u)[0])
    assert model.level_range == result.model.level_range
    path.write_text(coupled_model_text(result).replace("imaginary:", "imag:", 1), "utf-8")
    with pytest.raises(ModelError, match="expected 'real' and 'imaginary' parts"):
        read_coupled_model(path)


def with_two_outputs(strength: float = 1.0) -> CoupledDriveModel:
    model = coupled_model(strength)
    system = model.system
    two = replace(
        system, output_shapes=system.output_shapes[:2], feedthrough=system.feedthrough[:2]
    )
    return replace(model, outputs=("x", "y"), system=two)


def references() -> np.ndarray:
    """Return motions below, at and above the first two resonances, and one that stays."""
    t = np.arange(2000) / RATE
    rise = np.minimum(t / 0.2, 1.0)[:, None] ** 2
    angle = (
        2.0 * np.pi * t[:, None] * np.array([[20.0, 40.0], [130.0, 128.0], [212.0, 205.0]])[:, None]
    )
    moves = np.sin(angle).sum(0) * rise * np.array([0.2, 0.15])
    return 0.15 * (moves + (1.0 - np.cos(np.pi * np.clip((t - 0.3) / 0.1, 0.0, 1.0)))[:, None])


def test_voltages_invert_the_drives_that_soften() -> None:
    model, u = coupled_model(), np.tile(multisine(0.5, 4), (2, 1))
    through = ModalSystem(
        poles=np.zeros(1, complex),
        output_shapes=np.zeros((2, 1), complex),
        input_shapes=np.zeros((1, 2), complex),
        feedthrough=np.eye(2),
    )
    totals, end = replace(model, outputs=("a", "b"), system=through).simulate(u)
    assert np.abs(totals - u).max() > 0.05 * np.abs(u).max()
    first, between = model.voltages(totals[:700])
    second, after = model.voltages(totals[700:], between)
    assert np.abs(np.vstack((first, second)) - u).max() < 1e-12
    assert after.force_square == pytest.approx(end.force_square, rel=1e-10)


def test_commands_lead_the_outputs_along_references_through_resonances() -> None:
    model, target = with_two_outputs(), references()
    result = coupled_commands(model, target)
    size = np.sqrt(np.mean(target**2))
    assert np.abs(result.predicted - result.reference).max() < 1e-3 * size
    assert result.rms_error.max() < 1e-3 * size
    stepped, _ = model.simulate(result.command)
    assert np.array_equal(stepped, result.predicted)
    # commands of the linear system alone miss by what the stage softens
    linear = coupled_commands(with_two_outputs(0.0), target)
    missed, _ = model.simulate(linear.command)
    assert np.sqrt(np.mean((missed - linear.reference) ** 2)) > 0.02 * size


def test_commands_begin_before_a_reference_that_does_not_begin_at_rest() -> None:
    target = references()[700:]
    result = coupled_commands(with_two_outputs(), target)
    assert result.lead > 200
    assert result.time[result.lead] == 0.0
    assert np.abs(result.command[0]).max() < 1e-3 * np.abs(result.command).max()
    # a corner at its first sample is smoothed, all others are met
    assert np.abs(result.predicted[result.lead + 40 :] - target[40:]).max() < 0.01 * target.max()


def test_more_outputs_than_drives_follow_a_motion_that_is_possible() -> None:
    model = coupled_model()
    possible, _ = model.simulate(coupled_commands(with_two_outputs(), references()).command)
    result = coupled_commands(model, possible)
    assert result.rms_error.max() < 1e-3 * np.sqrt(np.mean(possible**2))


def test_limits_bound_the_commands_and_are_reported() -> None:
    model, target = with_two_outputs(), references()
    free = coupled_commands(model, target)
    high = 0.7 * float(free.command.max())
    rate = 0.5 * RATE * float(np.abs(np.diff(free.command, axis=0)).max())
    result = coupled_commands(model, target, limits=(-high, high), largest_rate=rate)
    assert np.abs(result.command).max() == high
    assert RATE * np.abs(np.diff(result.command, axis=0)).max() < rate * (1.0 + 1e-9)
    assert result.limited > 10
    assert any(note.startswith(f"limits changed {result.limited} of") for note in result.notes)
    assert np.abs(result.predicted - result.reference).max() > 0.001


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"band_hz": 500.0}, "a bandwidth of 500 Hz is above the records of the model"),
        ({"limits": (1.0, 2.0)}, "must contain 0, got 1 to 2"),
        ({"references": np.zeros((9, 3))}, "references must be finite, in 2 columns"),
        ({"references": 20.0 * references()}, r"reaches a level of \d"),
    ],
)
def test_references_that_cannot_be_followed_are_refused(options: dict, message: str) -> None:
    options = {"references": references()} | options
    with pytest.raises(ModelError, match=message):
        coupled_commands(with_two_outputs(), **options)


def test_the_linear_system_of_a_level_has_the_response_that_the_loop_at_each_line_has() -> None:
    model, u = coupled_model(), multisine(0.55, 3)
    spectra = periodic_spectra([record_of(u, u[:, [0, 1, 0]])], ["a", "b"], ["x", "y", "z"])
    # w in proportion to the voltages, whose mean level is 0.5 in the power 0.8
    sigma = 0.55 / 0.5**1.25 * model.drives.force_reference**2.0
    state = steady_state(model.drives, spectra, fitted=False, sigma=sigma[None], sweeps=1)
    steady = np.einsum("lpm,lm->lp", model.system.response(spectra.z), state.total[0])
    form = model.linear(0.55)
    resolvent = spectra.z[:, None, None] * np.eye(len(form.A)) - form.A
    tiled = np.tile(form.B, (spectra.z.size, 1, 1))
    response = form.C @ np.linalg.solve(resolvent, tiled) + form.D
    readings = np.einsum("lpm,lm->lp", response, spectra.inputs[0])
    assert np.abs(readings - steady).max() < 1e-9 * np.abs(steady).max()
    mean = np.einsum("lpm,lm->lp", model.system.response(spectra.z), spectra.inputs[0])
    assert np.abs(readings - mean).max() > 0.02 * np.abs(steady).max()
    with pytest.raises(ModelError, match=r"reaches a level of 0\.9"):
        model.linear(0.9)


def test_a_saved_state_resumes_and_single_samples_are_those_of_a_sequence(tmp_path: Path) -> None:
    model, u = coupled_model(), multisine(0.5, 6)
    at_once, _ = model.simulate(u)
    _, state = model.simulate(u[:500])
    np.savez(tmp_path / "state.npz", **asdict(state))
    with np.load(tmp_path / "state.npz") as arrays:
        state = CoupledDriveState(**arrays)
    for t in range(500, 600):
        reading, state = model.simulate(u[t : t + 1], state)
        assert np.array_equal(reading[0], at_once[t])


def test_without_limits_commands_stay_within_the_largest_deviation_of_the_records() -> None:
    model = replace(with_two_outputs(), largest_input=(0.3, 0.2))
    result = coupled_commands(model, references())
    assert np.max(np.abs(result.command)) == pytest.approx(0.2)
    assert result.limited > 0
