"""Identify several drives and sensors of one stage from periodic records at several levels."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import RecordError
from flexstage.base.progress import subtask
from flexstage.files.plain import picked, plain
from flexstage.files.result import Result
from flexstage.hysteresis.coupled_drives.model import CoupledDriveModel
from flexstage.hysteresis.coupled_drives.periodic import (
    PeriodicSpectra,
    best_linear,
    periodic_spectra,
    require_records,
)
from flexstage.hysteresis.coupled_drives.softening import (
    Softening,
    SofteningFit,
    rms_levels,
    starting_values,
    steady_state,
)
from flexstage.hysteresis.coupled_drives.state_space import (
    HANKEL_BLOCKS,
    IdentifiedModes,
    ModalSystem,
    modes_of,
    subspace_systems,
    with_both_vectors,
)
from flexstage.records.record import Record

#: Orders of a linear system; the Bayesian criterion chooses one.
_ORDERS = (2, 4, 6, 8, 10, 12, 16, 20, 30, 40, 50, 60, 80, 100)
#: Largest order of the system of one level, whose modes are read: more states split single modes.
_MODE_ORDER = 40
#: A linear system that leaves more than this part of the outputs does not describe them.
_NO_RELATION = 0.5
#: A mode of another level is the same where its frequency differs by less than this part, and the
#: cosine of their input vectors is larger than that.
_SAME_MODE, _SAME_DIRECTION = 0.02, 0.7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveLevel:
    """What was found at one level of the inputs; errors are rms over the outputs."""

    input_rms: float
    """Mean rms of an input."""
    output_rms: float
    """Rms of the outputs."""
    records: int
    """Records in steady state."""
    noise: float
    """Noise of the mean of the periods; NaN where no record has two."""
    floor: float
    """Residual of any linear system at this level, for its degrees of freedom: noise and
    distortion. NaN where there are no more records than inputs.
    """
    linear_error: float
    """Error of a linear system of this level."""
    error: float
    """Error of the one model of all levels."""
    frequency_hz: Array
    """Natural frequencies at this level, of the modes of the middle level; NaN where not found."""
    damping_ratio: Array
    """Their damping ratios."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoupledDriveIdentification(Result):
    """One model of several drives at all levels, and what each level shows."""

    table_key: ClassVar[str] = "levels"

    model: CoupledDriveModel
    """The model."""
    levels: tuple[DriveLevel, ...]
    """The levels, from the weakest."""
    modes: IdentifiedModes
    """Modes of the middle level."""
    held_out: tuple[float, ...] = ()
    """Error on records that were not fitted, by level; empty without such records."""
    warnings: tuple[str, ...] = ()
    """What the records could not tell."""
    notes: tuple[str, ...] = ()
    """How the records were read."""

    def data(self) -> dict[str, Any]:
        """Return levels, modes and errors as plain data."""
        names = ["input_rms", "output_rms", "records", "noise", "floor", "linear_error", "error"]
        held_out = self.held_out or (None,) * len(self.levels)
        modes = [
            {
                "frequency_hz": [level.frequency_hz[i] for level in self.levels],
                "damping_ratio": [level.damping_ratio[i] for level in self.levels],
                "input_shape": self.modes.input_shapes[i],
                "imaginary_share": self.modes.imaginary_share[i],
                "compliance": self.model.drives.compliance[i],
            }
            for i in range(self.modes.frequency_hz.size)
        ]
        softening = "strength", "exponent", "force_gains", "memory_gains"
        return {
            "levels": [
                {**picked(level, *names), "held_out": plain(error)}
                for level, error in zip(self.levels, held_out, strict=True)
            ],
            "modes": plain(modes),
            "softening": picked(self.model.drives, *softening),
            **picked(self, "order=model.system.order", "warnings", "notes"),
        }


def identify_coupled_drives(
    records: Sequence[Record],
    inputs: Sequence[str | int],
    outputs: Sequence[str | int],
    *,
    period: int | None = None,
    test_records: Sequence[Record] = (),
) -> CoupledDriveIdentification:
    """Identify one model of several drives and sensors from periodic records.

    Parameters
    ----------
    records : sequence of Record
        Whole periods in steady state, such as random-phase multisines: of each level at least as
        many records as there are inputs, and three levels at best. The rms of the inputs separates
        the levels.
    inputs, outputs : sequence of str or int
        Columns of the inputs and the outputs.
    period : int, optional
        Samples in a period; found from the repetition of the inputs where not given.
    test_records : sequence of Record, optional
        Records of the same levels that are not fitted, for `held_out`.

    Returns
    -------
    CoupledDriveIdentification
        The model, and what each level shows.

    Raises
    ------
    RecordError
        There are fewer than two inputs, too few records of a level, too short periods, constant
        columns, or outputs that do not follow the inputs.

    Notes
    -----
    Each level has a best linear approximation, a linear system by a subspace method, and its modes.
    The modes of the middle level begin the fit of the drives that soften (`softening`), which
    eliminates the linear system; that is then a state space of the order that the Bayesian
    criterion chooses (G. Schwarz, Ann. Stat. 6 (1978) 461).

    Validity: as `CoupledDriveModel`.
    """
    if len(inputs) < 2:
        raise RecordError(
            f"coupled drives need two inputs or more, got {len(inputs)}: use identify for one"
        )
    spectra = periodic_spectra(records, inputs, outputs, period)
    unsteady = spectra.unsteady()
    names = tuple(spectra.names[k] for k in np.flatnonzero(unsteady))
    steady = spectra.of(~unsteady)
    require_records(steady)
    if steady.period < 2 * HANKEL_BLOCKS:
        raise RecordError(
            f"a period of {steady.period} samples is too short for modes: record at least "
            f"{2 * HANKEL_BLOCKS} samples in a period"
        )
    systems = [_level_system(steady, k) for k in range(steady.levels)]
    linear_errors = [
        _error(_residuals(s, steady.of(steady.level == k), None)) for k, s in enumerate(systems)
    ]
    outputs_rms = [_error(steady.outputs[steady.level == k]) for k in range(steady.levels)]
    _require_relation(linear_errors, outputs_rms)
    highest = float(steady.frequency_hz[-1])
    rate = steady.sample_rate_hz
    all_modes = [modes_of(system, rate, highest) for system in systems]
    middle = steady.levels // 2
    modes = _confirmed(all_modes[middle], [m for k, m in enumerate(all_modes) if k != middle])
    # a compromise of levels: between equal absolute errors and equal parts of the outputs
    weights = np.array(outputs_rms)[steady.level] ** -0.5
    weights /= np.sqrt(np.mean((weights * np.array(linear_errors)[steady.level]) ** 2))
    drives, total, response = _drives(steady, modes, weights)
    # longer impulse responses than the modes need: a sharper response above them
    blocks = min(3 * HANKEL_BLOCKS // 2, steady.period // 2)
    system = _chosen_system(response, total, steady, weights, blocks=blocks)
    system = with_both_vectors(system, response, steady.z)
    units = (
        {records[0].channel(c).unit for c in inputs},
        {records[0].channel(c).unit for c in outputs},
    )
    if max(map(len, units)) > 1:
        raise RecordError(
            "all inputs must have one unit, and all outputs: convert them, such as an angle to the "
            f"motion at a radius; got {' and '.join(', '.join(sorted(u)) for u in units)}"
        )
    rms = rms_levels(steady.inputs)
    deviations = [
        [float(np.max(np.abs(x - x.mean()))) for x in (r.channel(c).values for c in inputs)]
        for r in records
    ]
    model = CoupledDriveModel(
        drives=drives,
        system=system,
        sample_rate_hz=rate,
        inputs=tuple(records[0].channel(c).name for c in inputs),
        outputs=tuple(records[0].channel(c).name for c in outputs),
        input_unit=", ".join(sorted(units[0])),
        output_unit=", ".join(sorted(units[1])),
        level_range=tuple(
            (float(low), float(high)) for low, high in zip(rms.min(0), rms.max(0), strict=True)
        ),
        band_hz=(float(steady.frequency_hz[0]), highest),
        largest_input=tuple(np.max(deviations, axis=0).tolist()),
    )
    residuals = _residuals(system, steady, total)
    levels = []
    for k in range(steady.levels):
        of_level = steady.of(steady.level == k)
        frequency, damping = _same_modes(modes, all_modes[k])
        levels.append(
            DriveLevel(
                input_rms=float(np.mean(rms[steady.level == k])),
                output_rms=outputs_rms[k],
                records=len(of_level.level),
                noise=float(np.sqrt(np.mean(of_level.noise**2))),
                floor=_floor(of_level),
                linear_error=linear_errors[k],
                error=_error(residuals[steady.level == k]),
                frequency_hz=frequency,
                damping_ratio=damping,
            )
        )
    held_out: tuple[float, ...] = ()
    if test_records:
        held_out = held_out_errors(
            model, periodic_spectra(test_records, inputs, outputs, steady.period), steady
        )
    return CoupledDriveIdentification(
        model=model,
        levels=tuple(levels),
        modes=modes,
        held_out=held_out,
        warnings=(*_unsteady_warning(names), *_level_warnings(steady.levels)),
        notes=(
            f"{len(records)} records of {len(steady.lines)} lines to {highest:.4g} Hz, period "
            f"{steady.period} samples at {rate:g} Hz",
            *dict.fromkeys(note for record in records for note in record.notes),
        ),
    )


def held_out_errors(
    model: CoupledDriveModel, spectra: PeriodicSpectra, fitted: PeriodicSpectra
) -> tuple[float, ...]:
    """Return the rms error of a model on other records in steady state, by level of the fit."""
    state = steady_state(model.drives, spectra, fitted=False)
    residuals = _residuals(model.system, spectra, state.total)
    typical = np.array(
        [rms_levels(fitted.inputs[fitted.level == k]).mean() for k in range(fitted.levels)]
    )
    level = np.argmin(np.abs(rms_levels(spectra.inputs).mean(1)[:, None] - typical), axis=1)
    return tuple(
        _error(residuals[level == k]) if np.any(level == k) else math.nan
        for k in range(fitted.levels)
    )


def _error(values: Complex) -> float:
    """Return the rms of a signal over records and channels from its spectra."""
    return float(np.sqrt(np.sum(np.abs(values) ** 2) / (values.shape[0] * values.shape[2])))


def _residuals(system: ModalSystem, spectra: PeriodicSpectra, total: Complex | None) -> Complex:
    inputs = spectra.inputs if total is None else total
    return spectra.outputs - np.einsum("lpm,rlm->rlp", system.response(spectra.z), inputs)


def _level_system(spectra: PeriodicSpectra, level: int) -> ModalSystem:
    of_level = spectra.of(spectra.level == level)
    response, _ = best_linear(of_level.inputs, of_level.outputs)
    weights = np.ones(len(of_level.level))
    return _chosen_system(response, of_level.inputs, of_level, weights, _MODE_ORDER)


def _floor(spectra: PeriodicSpectra) -> float:
    records, _, m = spectra.inputs.shape
    if records <= m:
        return math.nan
    _, residuals = best_linear(spectra.inputs, spectra.outputs)
    return _error(residuals) * math.sqrt(records / (records - m))


def _drives(
    spectra: PeriodicSpectra, modes: IdentifiedModes, weights: Array
) -> tuple[Softening, Complex, Complex]:
    """Return the drives, the voltages with what they add, and the linear response behind them."""
    start = starting_values(modes, spectra)
    if spectra.levels == 1:
        nothing = {n: 0.0 * getattr(start, n) for n in ("compliance", "strength", "memory_gains")}
        still = replace(start, **nothing)
        response, _ = best_linear(spectra.inputs, spectra.outputs, weights)
        return still, spectra.inputs, response
    fit = SofteningFit(spectra, weights)
    with subtask(0.1, 0.3):
        point = fit.fit(start, modes=False, iterations=10)
    with subtask(0.3, 0.9):
        point = fit.fit(point.drives, modes=True, iterations=30)
    return point.drives, point.state.total, point.response


def _chosen_system(
    response: Complex,
    total: Complex,
    spectra: PeriodicSpectra,
    weights: Array,
    largest: int = _ORDERS[-1],
    blocks: int = HANKEL_BLOCKS,
) -> ModalSystem:
    """Return the linear system of the order with the smallest Bayesian criterion."""
    records, lines, p = spectra.outputs.shape
    count = 2 * records * lines * p
    best, smallest = None, math.inf
    orders = [order for order in _ORDERS if order <= min(largest, lines // 4)]
    systems = subspace_systems(response, spectra.lines, spectra.period, orders, blocks)
    for order, system in zip(orders, systems, strict=True):
        weighted = _residuals(system, spectra, total) * weights[:, None, None]
        parameters = order * (p + total.shape[2])
        criterion = count * math.log(_error(weighted) ** 2) + parameters * math.log(count)
        if criterion < smallest:
            best, smallest = system, criterion
    assert best is not None
    return best


def _require_relation(errors: Sequence[float], outputs: Sequence[float]) -> None:
    shares = [error / output for error, output in zip(errors, outputs, strict=True)]
    if min(shares) > _NO_RELATION:
        raise RecordError(
            f"a linear system leaves {100.0 * min(shares):.0f} % of the outputs: they do not "
            "follow these inputs in steady state; check columns, period and synchronisation"
        )


def _confirmed(modes: IdentifiedModes, others: Sequence[IdentifiedModes]) -> IdentifiedModes:
    """Return the modes that another level has as well: noise makes poles of one level alone."""
    if not others:
        return modes
    seen_elsewhere = [~np.isnan(_same_modes(modes, m)[0]) for m in others]
    return modes.of(np.flatnonzero(np.any(seen_elsewhere, axis=0)))


def _same_modes(reference: IdentifiedModes, others: IdentifiedModes) -> tuple[Array, Array]:
    """Return frequency and damping of the modes of another level; NaN where there is no such."""
    frequency = np.full(reference.frequency_hz.size, np.nan)
    damping = frequency.copy()
    if 0 in (frequency.size, others.frequency_hz.size):
        return frequency, damping
    along = np.abs(reference.input_shapes @ others.input_shapes.T)
    apart = np.abs(others.frequency_hz / reference.frequency_hz[:, None] - 1.0)
    apart[along < _SAME_DIRECTION] = np.inf
    for _ in range(min(apart.shape)):
        i, j = np.unravel_index(np.argmin(apart), apart.shape)
        if apart[i, j] > _SAME_MODE:
            break
        frequency[i], damping[i] = others.frequency_hz[j], others.damping_ratio[j]
        apart[i], apart[:, j] = np.inf, np.inf
    return frequency, damping


def _unsteady_warning(names: tuple[str, ...]) -> tuple[str, ...]:
    if not names:
        return ()
    return (
        f"not in steady state, and not used: {', '.join(names)}; their periods differ more than "
        "three times as much as those of the other records",
    )


def _level_warnings(levels: int) -> tuple[str, ...]:
    if levels == 1:
        return (
            "one level only: the model is linear; record at three levels to see the stage soften",
        )
    if levels == 2:
        return ("two levels only: the exponent of the softening is not determined; record a third",)
    return ()
