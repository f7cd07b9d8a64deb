"""Static tests of an axis: targets approached from both sides, small steps, a held position."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.base.errors import RecordError
from flexstage.centring.geometry import ARCSEC
from flexstage.experiments.campaign.loading import column, only, runs_of
from flexstage.experiments.campaign.plan import Campaign, Test
from flexstage.experiments.campaign.results import TestResult, figure_of
from flexstage.measure.motion.approaches import (
    Approaches,
    Visits,
    staircase_dwells,
    targets_text,
    visits,
)
from flexstage.measure.motion.positioning import Positioning, positioning
from flexstage.measure.noise.hold import allan_deviation, hold_noise
from flexstage.measure.noise.staircase import levels_of_command, staircase
from flexstage.measure.uncertainty.sensor import measured
from flexstage.quantities.estimate import Estimate
from flexstage.quantities.sensor import SensorSpecification
from flexstage.records import Record
from flexstage.records.sampling import require_uniform

#: Figures in the table of a stage: quantity, field of `Positioning`, description. Those of a rotary
#: axis are ``rotation_`` and the field.
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
    """Readings at the targets, shape (m, n) upward and downward, with notes on their source."""

    target: Array
    upward: Array
    downward: Array
    notes: tuple[str, ...] = ()


def evaluate_positioning(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate targets that were approached from both sides, according to ISO 230-2.

    The columns are ``command``, the targets in metres or radians, and ``along``: one row for each
    approach in the order of time, or dwells of several samples; ``direction`` is the side of each.
    Or they are ``command``, ``upward`` and ``downward``: one row for each target. Targets that are
    angles are those of a rotary axis.
    """
    record = only(test, records)
    command = column(test, record, "command")
    unit = record.channel(test.columns.command or 0).unit
    if unit not in {"m", "rad"}:
        raise RecordError(
            f"test '{test.name}': targets are positions in m or angles, and the command is in "
            f"'{unit or 'no unit'}': name the column of the target, with its unit where the file "
            f'does not state it, such as command="{test.columns.command} um" or deg'
        )
    table = bool(test.columns.upward or test.columns.downward)
    reached = _table(test, record, command) if table else _sequence(test, record, command, unit)
    upward, downward, notes = _same_zero(reached, unit, deviations=test.deviations)
    rotary = unit == "rad"
    figures = positioning(reached.target, upward, downward, unit="rad" if rotary else "m")
    sensor = campaign.instrument(test.angle or test.along if rotary else test.along)
    if sensor is not None:
        figures = _measured(figures, sensor)
    amounts = (
        (f"rotation_{name}" if rotary else quantity, getattr(figures, name), f"{what} of ISO 230-2")
        for quantity, name, what in _FIGURES
    )
    return TestResult(
        test=test,
        figures=tuple(figure_of(campaign, test, *amount) for amount in amounts),
        details={"positioning": figures},
        notes=(*reached.notes, *notes, *_remarks(figures)),
    )


def _remarks(figures: Positioning) -> Iterator[str]:
    """Yield what the test lacks for ISO 230-2, and how a closed circle was taken."""
    required, enough = figures.targets_required, 5
    if figures.positions < required or figures.runs < enough:
        travel = targets_text(np.ptp(figures.target), figures.unit)
        yield (
            f"ISO 230-2 asks for {required} targets or more over {travel} and for {enough} runs "
            f"each way: this test has {figures.positions} and {figures.runs}, and wider intervals"
        )
    if figures.closure is not None:
        yield (
            f"targets {targets_text(figures.target[[0, -1]], 'rad')} are one position: it counts "
            "once in the mean reversal, and the closure error of "
            f"{figures.closure.value / ARCSEC:+.4g} ± {figures.closure.expanded / ARCSEC:.2g} "
            "arcsec stays in A, E and M"
        )


def _table(test: Test, record: Record, target: Array) -> _Reached:
    """Return runs in columns, with one row for each target."""
    columns = test.columns
    if columns.along or columns.direction or test.cycle != "auto":
        raise RecordError(
            f"test '{test.name}': upward and downward name the runs of a table with one row for "
            "each target, where along, direction and cycle have no meaning: omit them"
        )
    upward, downward = (runs_of(test, record, role) for role in ("upward", "downward"))
    note = f"{upward.shape[1]} runs to {target.size} targets: one row for each target"
    return _Reached(target=target, upward=upward, downward=downward, notes=(note,))


def _sequence(test: Test, record: Record, command: Array, unit: str) -> _Reached:
    """Return approaches in the order of time."""
    along = column(test, record, "along")
    side = _sides(test, record)
    approached: Visits | None = None
    layout = "one row for each approach"
    if test.cycle == "auto" and command.size >= 8:
        dwells = staircase_dwells(command, side=side)
        # a table that is sorted by target and side has each of them once
        if dwells is not None and (side is None or not _sorted(test, dwells)):
            length = int(np.median(dwells.stop - dwells.start))
            layout = f"{dwells.target.size} dwells of about {length} samples"
            approached, along = dwells, dwells.means(along)
    if approached is None:
        cycle = "standard" if test.cycle == "auto" else test.cycle
        approached = visits(command, cycle=cycle, side=side, unit=unit)
    approaches = approached.sort(along)
    source = "the order of the rows" if side is None else f"column '{test.columns.direction}'"
    runs, targets = approaches.upward.shape[1], approaches.targets.size
    note = f"{runs} runs to {targets} targets: {layout}, directions by {source}"
    return _Reached(
        target=approached.levels[approaches.targets],
        upward=approaches.upward,
        downward=approaches.downward,
        notes=(note, *_ignored(approached.levels, approaches, unit, stated=side is not None)),
    )


def _ignored(levels: Array, approaches: Approaches, unit: str, *, stated: bool) -> Iterator[str]:
    """Yield notes on ignored targets, and on ignored approaches to the others."""
    alone = np.setdiff1d(np.arange(levels.size), approaches.targets)
    if alone.size:
        rarely = " or rarely" if approaches.counts[:, alone].min(axis=0).any() else ""
        remedy = "" if stated else (
            "; if they were approached from both sides, name the column of the direction"
        )  # fmt: skip
        yield (
            f"positions that were approached from one side only{rarely} are ignored: "
            f"{_listed(levels[alone], unit)}{remedy}"
        )
    counts, runs = approaches.counts[:, approaches.targets], approaches.upward.shape[1]
    if counts.max() > runs:
        side, i = np.unravel_index(int(counts.argmin()), counts.shape)
        yield (
            f"target {_listed(levels[approaches.targets[i : i + 1]], unit)} was reached from "
            f"{('below', 'above')[side]} {runs} times, and others up to {counts.max()} times: "
            f"approaches beyond the first {runs} are ignored"
        )


def _sorted(test: Test, rows: Visits) -> bool:
    """Return whether rows are sorted by target and side, so that successive rows are runs."""
    pairs = list(zip(rows.target.tolist(), rows.direction.tolist(), strict=True))
    if len(set(pairs)) < len(pairs):
        return False
    if np.array_equal(rows.target, rows.target[::-1]):
        raise RecordError(
            f"test '{test.name}': the rows go up and down over the targets once, several at each: "
            "a test needs at least two runs; if each row is an approach, use cycle=standard"
        )
    return True


def _listed(positions: Array, unit: str) -> str:
    listed = targets_text(positions[:6], unit)
    return listed + (f" and {positions.size - 6} more" if positions.size > 6 else "")


def _sides(test: Test, record: Record) -> Array | None:
    """Return 1 for rows approached from below and -1 from above; None without such a column."""
    if test.columns.direction is None:
        return None
    channel = record.channel(test.columns.direction)
    values = channel.values
    if channel.texts:
        side = {text: _side(text) for text in channel.texts}
        unknown = [text for text, value in side.items() if value == 0.0]
        values = np.array([side[text] for text in channel.texts])[values.astype(np.intp)]
    elif not values.min() < 0.0 < values.max():
        unknown = [f"{values.max():g}"]
    else:
        unknown = [f"{v:g}" for v in np.unique(values[values == 0.0])]
    if unknown:
        raise RecordError(
            f"test '{test.name}': column '{channel.name}' has '{unknown[0]}' as a direction: "
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


def _same_zero(
    reached: _Reached, unit: str, *, deviations: bool
) -> tuple[Array, Array, tuple[str, ...]]:
    """Return the positions with the zero of the targets."""
    # a mean deviation of more than this many ranges of the deviations is a different zero
    other_zero = 10.0
    at = reached.target[:, None]
    if deviations:
        return reached.upward + at, reached.downward + at, ()
    deviation = np.concatenate((reached.upward - at, reached.downward - at), axis=1)
    if unit == "rad":
        # a reading that begins again after a turn
        deviation -= 2.0 * np.pi * np.rint((deviation - deviation[0, 0]) / (2.0 * np.pi))
        runs = reached.upward.shape[1]
        up, down = at + deviation[:, :runs], at + deviation[:, runs:]
        reached = replace(reached, upward=up, downward=down)
    zero = float(deviation[np.argmin(reached.target)].mean())
    if not abs(zero) > other_zero * float(np.ptp(deviation)):
        return reached.upward, reached.downward, ()
    difference = f"{np.degrees(zero):+.6g} deg" if unit == "rad" else f"{1e6 * zero:+.6g} um"
    note = (
        f"the zero of the reading differs by {difference}: deviations are relative to "
        "their mean at the first target"
    )
    return reached.upward - zero, reached.downward - zero, (note,)


def _measured(figures: Positioning, sensor: SensorSpecification) -> Positioning:
    """Return the figures with the uncertainty of the sensor.

    A figure of deviations along the travel has the error of the length over the full travel: a
    relative error c of the gain tilts the line of deviations by c, however small they are.
    """
    travel = Estimate(value=float(np.ptp(figures.target)), unit=figures.unit)
    role = "length" if figures.unit == "m" else "angle"
    over_travel = measured(travel, sensor, role=role).components
    totals: dict[str, Any] = {}
    for field in fields(figures):
        estimate = getattr(figures, field.name)
        if isinstance(estimate, Estimate):
            local = field.name.startswith(("repeat", "reversal", "mean_reversal"))
            totals[field.name] = (
                measured(estimate, sensor, role="transverse range")
                if local
                else estimate.plus(*over_travel)
            )
    return replace(figures, **totals)


def evaluate_staircase(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a staircase of small steps.

    The resolution is the smallest step that is distinguishable from the noise, or the mean step
    where the steps are the smallest of the drive; these must exceed the noise.
    """
    record = only(test, records)
    require_uniform(record)
    command = column(test, record, "command")
    along = column(test, record, "along")
    steps = staircase(
        along,
        record.sample_rate_hz,
        levels_of_command(command, shortest=4),
        command=command,
        probability=test.confidence,
    )
    raw = steps.resolution
    note = raw.note
    if test.smallest_steps:
        if steps.smallest_resolved is None:
            raise RecordError(
                f"test '{test.name}': no step size is distinguishable from the noise at "
                f"{100.0 * test.confidence:g} % confidence: average more samples on each level"
            )
        raw = steps.smallest_resolved
        note = f"mean of the smallest steps; {raw.note}"
    total = measured(raw, campaign.instrument(test.along), role="noise")
    return TestResult(
        test=test,
        figures=(figure_of(campaign, test, "resolution", total, note),),
        details={"staircase": steps, "along": along, "time": record.time},
        notes=steps.notes,
    )


def evaluate_hold(test: Test, records: list[Record], campaign: Campaign) -> TestResult:
    """Evaluate a record of an axis at a held position.

    The figures are noise and drift, with spectrum and Allan deviation.
    """
    record = only(test, records)
    require_uniform(record)
    along = column(test, record, "along")
    stability = hold_noise(along, record.sample_rate_hz)
    sensor = campaign.instrument(test.along)
    noise = measured(stability.rms, sensor, role="noise")
    drift = measured(stability.drift, sensor, role="drift")
    return TestResult(
        test=test,
        figures=(
            figure_of(campaign, test, "noise", noise, "rms about a straight line"),
            figure_of(campaign, test, "drift", drift, "while the position is held"),
        ),
        details={
            "hold": stability,
            "allan": allan_deviation(along, record.sample_rate_hz),
            "values": np.asarray(along),
            "time": record.time,
        },
        notes=stability.notes,
    )
