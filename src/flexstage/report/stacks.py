"""Tables, section and sentences on stacks: working lines, amplifiers, seats that they imply."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from flexstage.base.errors import FlexstageError
from flexstage.quantities.quantity import number
from flexstage.quantities.table import Content, Picture, Pictures, Table, table
from flexstage.report.figures.drives import draw_working_line
from flexstage.stage import PiezoStack
from flexstage.stage.designs.vgtu import IDEAL_SEATS, predicted_ranges
from flexstage.stage.stack_supply import StackSupply
from flexstage.studies.requests import StackOptions
from flexstage.studies.stacks import StackAtWork, stacks_at_work
from flexstage.system.implied_seat import STROKE_TOLERANCE, ImpliedSeat, implied_seat

if TYPE_CHECKING:
    from flexstage.studies.study import Study
    from flexstage.system import Analysis


_LINE = (
    "<drive", "free stroke, µm", "stroke left, µm", "%", "stage, N/µm", "stack, N/µm", "force, N",
    "% of blocking force",
)  # fmt: skip
_SUPPLY = (
    "<drive", "rate, Hz", "voltage, V", "charge, µC", "peak current, mA", "mean current, mA",
    "slew, V/ms", "reactive power, var", "largest rate, Hz", "largest voltage, V", "<limited by",
)  # fmt: skip


def stack_tables(stacks: Sequence[StackAtWork]) -> Iterator[Table]:
    """Yield the tables of stacks at work; that of the supply if a capacitance is known."""
    if not stacks:
        return
    lines = [s.line for s in stacks]
    # seats and preload are columns of their own where there are any
    seated = any(line.drive.seats or line.drive.preload for line in lines)
    rows = []
    for line in lines:
        figures = (
            1e6 * line.drive.free_stroke,
            1e6 * line.stroke,
            100.0 * line.stroke_share,
            1e-6 * line.stage_stiffness,
            1e-6 * line.drive.stiffness,
            line.force,
            100.0 * line.force_share,
            *((1e6 * line.lost_on_seats, line.contact_force) if seated else ()),
        )
        rows.append((line.drive.name, *map(number, figures)))
    heads = (*_LINE, *(("lost on seats, µm", "force on seats, N") if seated else ()))
    yield table("working line of each stack at full voltage", heads, rows)
    supplies = {s.line.drive.name: s.supply for s in stacks if s.supply is not None}
    if supplies:
        yield _supply_table(supplies)


def _supply_table(supplies: dict[str, StackSupply]) -> Table:
    heat = any(s.heat is not None for s in supplies.values())
    rise = any(s.temperature_rise is not None for s in supplies.values())
    rows = []
    for name, s in supplies.items():
        figures = (
            s.rate,
            s.voltage,
            1e6 * s.charge,
            1e3 * s.peak_current,
            1e3 * s.mean_current,
            1e-3 * s.slew,
            s.reactive_power,
            s.largest_rate,
            min(s.limits.values()),
        )
        warm = (*((s.heat,) if heat else ()), *((s.temperature_rise,) if rise else ()))
        rows.append((name, *map(number, figures), s.limited_by, *(number(w or 0.0) for w in warm)))
    heads = (*_SUPPLY, *(("heat, W",) if heat else ()), *(("rise, K",) if rise else ()))
    each = {name: _limits(supply) for name, supply in supplies.items()}
    limits = next(iter(each.values()))
    if len(set(each.values())) > 1:
        limits = ", ".join(f"{name} {words}" for name, words in each.items())
    note = f"Largest rate at this voltage, and largest voltage at this rate: {limits}."
    return table("supply of each stack, a sine from peak to peak", heads, rows, notes=[note])


def _limits(supply: StackSupply) -> str:
    slew = "" if math.isinf(supply.largest_slew) else f" and {1e-3 * supply.largest_slew:g} V/ms"
    return f"amplifier of {1e3 * supply.largest_current:g} mA{slew}"


def stack_section(study: "Study") -> Iterator[Content]:
    """Yield working line and supply of each stack of a study, at the frequency of its axis."""
    if not any(isinstance(drive, PiezoStack) for drive in study.stage.drives):
        return
    try:
        stacks = stacks_at_work(study.main, StackOptions(rate="natural"))
    except FlexstageError as error:
        yield f"The working lines of the stacks could not be computed: {error}."
        return
    yield Pictures(
        pictures=tuple(
            Picture(
                result=partial(draw_working_line, stack.line),
                title=f"working line of {stack.line.drive.name}",
                caption=f"Working line of {stack.line.drive.name}, the other drives at rest in "
                f"place; {study.main.system.model} model.",
                size="small",
            )
            for stack in stacks
        ),
        columns=2,
    )
    for each in stack_tables(stacks):
        yield replace(each, caption=each.caption.capitalize())
    yield (
        "The supply is that of a capacitor. The natural frequency of the axis, drives in place, is "
        "an upper bound of the rate; at the resonance the current of the motion adds to it."
    )


_MEASURED = "published-measured"


def seat_sentences(analysis: "Analysis") -> tuple[str, ...]:
    """Return a sentence on each axis that one stack moves and whose measured frequency is known."""
    stage, sentences = analysis.stage, []
    ranges = predicted_ranges(stage)
    stacks = {d.name for d in stage.drives if isinstance(d, PiezoStack)}
    published = {(r.quantity, r.axis): r for r in stage.published if r.origin == _MEASURED}
    for axis in analysis.axes:
        frequency = published.get(("natural_frequency_hz", axis.axis))
        if frequency is None or len(axis.drives) > 1 or not stacks & set(axis.drives):
            continue
        stroke = published.get(("output_displacement", axis.axis))
        seat = implied_seat(
            stage,
            analysis.system,
            axis.axis,
            frequency.estimate,
            measured_stroke=None if stroke is None else stroke.value,
        )
        expected = ranges.text(IDEAL_SEATS, axis.axis, 1.0) if ranges else ""
        sentences.append(_sentence(seat, expected))
    return tuple(sentences)


def _sentence(seat: ImpliedSeat, expected: str) -> str:
    """Return the sentence; `expected` is the range of the frequency on ideal seats, if known."""
    parts = [
        f"Seat of stack {seat.drive}: measured {seat.measured_hz:.10g} Hz in {seat.axis}, computed "
        f"{number(seat.bare_hz)} Hz without its stiffness and {number(seat.ideal_hz)} Hz on ideal "
        f"seats{expected and f' (geometry fitted, 95 %: {expected} Hz)'}",
        _stiffness(seat),
    ]
    if seat.least_stroke_stiffness is not None:
        parts.append(_stroke(seat))
    if seat.contradicted:
        parts.append("so the stack was out, lifted off or not preloaded")
    if seat.closed_hz:
        low, high = (number(pick(seat.closed_hz.values()), 3) for pick in (min, max))
        parts.append(
            f"the frequency at half stroke decides: {low} to {high} Hz in contact, "
            f"{number(seat.bare_hz, 3)} Hz without"
        )
    return f"{'; '.join(parts)}."


def _newtons(stiffness: float) -> str:
    return f"{number(1e-6 * stiffness, 2)} N/µm"


def _stiffness(seat: ImpliedSeat) -> str:
    low, high = seat.seat_interval
    if high == float("inf") and (seat.seat_stiffness is None or low == 0.0):
        return "that says nothing of its seat"
    if seat.seat_stiffness is None:
        return f"that implies a linear seat of at most {_newtons(high)} (95 %)"
    if seat.measured_hz >= seat.ideal_hz:
        return f"that implies a linear seat of at least {_newtons(low)} (95 %)"
    most = f"to {_newtons(high)}" if high < float("inf") else "or more"
    return (
        f"that implies a linear seat of {_newtons(seat.seat_stiffness)} (95 %: "
        f"{number(1e-6 * low, 2)} {most}), which leaves {100.0 * seat.share_left:.0f} % of the "
        "stroke"
    )


def _stroke(seat: ImpliedSeat) -> str:
    assert seat.measured_share is not None
    assert seat.least_stroke_stiffness is not None
    share = " of the free stroke" if seat.seat_stiffness is None else ""
    measured = f"{100.0 * seat.measured_share:.0f} %{share} was measured"
    tolerance = f"even with {100.0 * STROKE_TOLERANCE:.0f} % more free stroke"
    if seat.least_stroke_stiffness == float("inf"):
        return f"{measured}, which no seat leaves {tolerance}"
    return f"{measured}, which takes {_newtons(seat.least_stroke_stiffness)} or more {tolerance}"
