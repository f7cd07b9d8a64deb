"""A sentence on what a published measured frequency says of the seat of a stack."""

from typing import TYPE_CHECKING

from flexstage.quantities.quantity import number
from flexstage.stage import PiezoStack
from flexstage.stage.designs.vgtu import IDEAL_SEATS, predicted_ranges
from flexstage.system.implied_seat import STROKE_TOLERANCE, ImpliedSeat, implied_seat

if TYPE_CHECKING:
    from flexstage.system import Analysis

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
