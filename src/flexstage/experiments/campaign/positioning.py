"""Tests of an axis that rests: targets gone to from both sides, small steps, one place held."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.experiments.campaign.loading import column, only, runs_of
from flexstage.experiments.campaign.plan import Campaign, Test
from flexstage.experiments.campaign.results import TestResult, figure_of
from flexstage.measure.motion.approaches import Approaches, Visits, staircase_dwells, visits
from flexstage.measure.motion.positioning import Positioning, positioning
from flexstage.measure.noise.hold import allan_deviation, hold_noise
from flexstage.measure.noise.staircase import levels_of_command, staircase
from flexstage.measure.uncertainty.sensor import measured
from flexstage.quantities.estimate import Estimate
from flexstage.quantities.sensor import SensorSpecification
from flexstage.records import Record
from flexstage.records.sampling import require_uniform

#: Figures that stand in the table of a stage: quantity, field of `Positioning`, what it is.
_FIGURES: tuple[tuple[str, str, str], ...] = (
    ("positioning_accuracy", "accuracy", "bidirectional accuracy A"),
    ("positioning_repeatability", "repeatability", "bidirectional repeatability R"),
    ("positioning_systematic_deviation", "systematic", "bidirectional systematic deviation E"),
    ("positioning_mean_deviation", "mean_deviation", "mean bidirectional deviation M"),
    ("reversal", "reversal", "reversal value B"),
    ("mean_reversal", "mean_reversal", "mean reversal value"),
)
_UP = frozenset(
    ("up", "u", "upward", "upwards", "+", "↑", "⬆", "→", "forward", "forwards", "fwd", "f", "pos",
     "positive", "rising")
)  # fmt: skip
_DOWN = frozenset(
    ("down", "d", "downward", "downwards", "-", "−", "↓", "⬇", "←", "backward", "backwards", "bwd",
     "b", "reverse", "rev", "r", "neg", "negative", "falling")
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Reached:
    """What was read at the targets, shape (m, n) upward and downward, and how it was found."""

    target: Array
    upward: Array
    downward: Array
    notes: tuple[str, ...] = ()


def evaluate_positioning(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate targets that were gone to from both sides, in the manner of ISO 230-2.

    The columns are ``command``, the targets in metres, and ``along``: a row for each approach in
    the order of time, or rests of several samples; ``direction`` says the side of each. Or they are
    ``command``, ``upward`` and ``downward``: a row for each target.
    """
    record = only(test, records)
    command = column(test, record, "command")
    unit = record.channel(test.columns.command or 0).unit
    if unit != "m":
        raise RecordError(
            f"test '{test.name}': targets are positions in m, and the command is in "
            f"'{unit or 'no unit'}': give command=um, or the column of the wanted position"
        )
    table = bool(test.columns.upward or test.columns.downward)
    reached = _table(test, record, command) if table else _sequence(test, record, command)
    upward, downward, notes = _set_alike(reached, deviations=test.deviations)
    found = positioning(reached.target, upward, downward)
    sensor = campaign.instrument(test.along)
    if sensor is not None:
        found = _measured(found, sensor)
    return TestResult(
        test=test,
        figures=tuple(
            figure_of(campaign, test, quantity, getattr(found, name), f"{what} of ISO 230-2")
            for quantity, name, what in _FIGURES
        ),
        details={"positioning": found},
        notes=(*reached.notes, *notes),
    )


def _table(test: Test, record: Record, target: Array) -> _Reached:
    """Runs in columns, a row for each target."""
    named = test.columns
    if named.along or named.direction or test.cycle != "auto":
        raise RecordError(
            f"test '{test.name}': upward and downward name the runs of a table with a row for each "
            "target, where along, direction and cycle have no meaning: leave them out"
        )
    upward, downward = (runs_of(test, record, role) for role in ("upward", "downward"))
    note = f"{upward.shape[1]} runs to {target.size} targets: a row for each target"
    return _Reached(target=target, upward=upward, downward=downward, notes=(note,))


def _sequence(test: Test, record: Record, command: Array) -> _Reached:
    """Approaches in the order of time."""
    along = column(test, record, "along")
    side = _sides(test, record)
    seen: Visits | None = None
    how = "a row for each approach"
    if test.cycle == "auto" and command.size >= 8:
        dwells = staircase_dwells(command, side=side)
        # in a table that is sorted by target and side each of them stands once
        if dwells is not None and (side is None or not _sorted(test, dwells)):
            length = int(np.median(dwells.stop - dwells.start))
            how = f"{dwells.target.size} rests of some {length} samples"
            seen, along = dwells, dwells.means(along)
    if seen is None:
        cycle = "standard" if test.cycle == "auto" else test.cycle
        seen = visits(command, cycle=cycle, side=side)
    found = seen.sort(along)
    told = "the order of the rows" if side is None else f"column '{test.columns.direction}'"
    runs, targets = found.upward.shape[1], found.targets.size
    note = f"{runs} runs to {targets} targets: {how}, directions by {told}"
    return _Reached(
        target=seen.levels[found.targets],
        upward=found.upward,
        downward=found.downward,
        notes=(note, *_left_out(seen.levels, found, said=side is not None)),
    )


def _left_out(levels: Array, found: Approaches, *, said: bool) -> Iterator[str]:
    """Say which targets do not count, and which approaches to the others."""
    alone = np.setdiff1d(np.arange(levels.size), found.targets)
    if alone.size:
        seldom = " or seldom" if found.counts[:, alone].min(axis=0).any() else ""
        mend = "" if said else (
            "; where they were reached from both, name the column of the direction"
        )  # fmt: skip
        yield (
            f"positions that were gone to from one side only{seldom} are left out: "
            f"{_listed(levels[alone])}{mend}"
        )
    counts, runs = found.counts[:, found.targets], found.upward.shape[1]
    if counts.max() > runs:
        way, i = np.unravel_index(int(counts.argmin()), counts.shape)
        yield (
            f"target {_listed(levels[found.targets[i : i + 1]])} was reached from "
            f"{('below', 'above')[way]} {runs} times, and others up to {counts.max()} times: "
            f"approaches beyond the first {runs} are left out"
        )


def _sorted(test: Test, seen: Visits) -> bool:
    """Say whether rows are sorted by target and side, so that several in succession are runs."""
    pairs = list(zip(seen.target.tolist(), seen.direction.tolist(), strict=True))
    if len(set(pairs)) < len(pairs):
        return False
    if np.array_equal(seen.target, seen.target[::-1]):
        raise RecordError(
            f"test '{test.name}': the rows go up and down over the targets once, several at each: "
            "a test has two runs at least; where each row is an approach, use cycle=standard"
        )
    return True


def _listed(positions: Array) -> str:
    listed = ", ".join(f"{1e6 * p:.9g}" for p in positions[:6])
    return f"{listed} um" + (f" and {positions.size - 6} more" if positions.size > 6 else "")


def _sides(test: Test, record: Record) -> Array | None:
    """Return 1 where a row was reached from below and -1 from above, where a column says it."""
    if test.columns.direction is None:
        return None
    channel = record.channel(test.columns.direction)
    values = channel.values
    if channel.texts:
        side = {text: _side(text) for text in channel.texts}
        unknown = [text for text, way in side.items() if way == 0.0]
        values = np.array([side[text] for text in channel.texts])[values.astype(np.intp)]
    elif not values.min() < 0.0 < values.max():
        unknown = [f"{values.max():g}"]
    else:
        unknown = [f"{v:g}" for v in np.unique(values[values == 0.0])]
    if unknown:
        raise RecordError(
            f"test '{test.name}': column '{channel.name}' has '{unknown[0]}' for a direction: "
            "write up or down, + or -, 1 or -1, forward or backward, ↑ or ↓"
        )
    return np.sign(values)


def _side(text: str) -> float:
    word = text.strip().lower()
    if word in _UP or word in _DOWN:
        return 1.0 if word in _UP else -1.0
    try:
        return float(np.sign(float(word)))
    except ValueError:
        return 0.0


def _set_alike(reached: _Reached, *, deviations: bool) -> tuple[Array, Array, tuple[str, ...]]:
    """Return positions reached, on the scale of the targets."""
    # readings that are off by more than so many ranges of their deviations have another zero
    other_zero = 10.0
    at = reached.target[:, None]
    if deviations:
        return reached.upward + at, reached.downward + at, ()
    off = np.concatenate((reached.upward - at, reached.downward - at), axis=1)
    zero = float(off[np.argmin(reached.target)].mean())
    if not abs(zero) > other_zero * float(np.ptp(off)):
        return reached.upward, reached.downward, ()
    note = (
        f"the zero of the reading is elsewhere ({1e6 * zero:+.6g} um): deviations are counted from "
        "their mean at the first target"
    )
    return reached.upward - zero, reached.downward - zero, (note,)


def _measured(found: Positioning, sensor: SensorSpecification) -> Positioning:
    """Return the figures with what the sensor adds to their uncertainty.

    A figure of deviations along the travel has the error of the length over all of it: a gain that
    is off by c turns the line of deviations by c, however small they are.
    """
    travel = Estimate(value=float(np.ptp(found.target)), unit="m")
    over_travel = measured(travel, sensor, role="length").components
    whole = {}
    for field in fields(found):
        estimate = getattr(found, field.name)
        if isinstance(estimate, Estimate):
            near = field.name.startswith(("repeat", "reversal", "mean_reversal"))
            whole[field.name] = (
                measured(estimate, sensor, role="transverse range")
                if near
                else estimate.plus(*over_travel)
            )
    return replace(found, **whole)


def evaluate_staircase(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a staircase of small steps.

    The resolution is what the noise lets one tell apart, or the mean step where the steps are the
    smallest that the drive can make: then they must not drown in the noise.
    """
    record = only(test, records)
    require_uniform(record)
    command = column(test, record, "command")
    along = column(test, record, "along")
    found = staircase(
        along,
        record.sample_rate_hz,
        levels_of_command(command, shortest=4),
        command=command,
        probability=test.confidence,
    )
    raw = found.resolution
    note = raw.note
    if test.smallest_steps:
        if found.smallest_resolved is None:
            raise RecordError(
                f"test '{test.name}': no step size is resolved from the noise at "
                f"{100.0 * test.confidence:g} % confidence: average more samples on each level"
            )
        raw = found.smallest_resolved
        note = f"mean of the smallest steps; {raw.note}"
    whole = measured(raw, campaign.instrument(test.along), role="noise")
    return TestResult(
        test=test,
        figures=(figure_of(campaign, test, "resolution", whole, note),),
        details={"staircase": found, "along": along, "time": record.time},
        notes=found.notes,
    )


def evaluate_hold(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a record of an axis that is held.

    The figures are noise and drift, with spectrum and Allan deviation.
    """
    record = only(test, records)
    require_uniform(record)
    along = column(test, record, "along")
    found = hold_noise(along, record.sample_rate_hz)
    sensor = campaign.instrument(test.along)
    noise = measured(found.rms, sensor, role="noise")
    drift = measured(found.drift, sensor, role="drift")
    return TestResult(
        test=test,
        figures=(
            figure_of(campaign, test, "noise", noise, "rms about a straight line"),
            figure_of(campaign, test, "drift", drift, "while the stage is held"),
        ),
        details={
            "hold": found,
            "allan": allan_deviation(along, record.sample_rate_hz),
            "values": np.asarray(along),
            "time": record.time,
        },
        notes=found.notes,
    )
