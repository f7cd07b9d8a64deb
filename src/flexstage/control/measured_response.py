r"""Position control from a frequency response, with margins for a set of responses.

The set is that of `response_set`, around a measured response or one by the model of a stage. An
inner loop that damps a mode is part of the loop whose margins count.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.control.design import (
    WIDTHS,
    force_feedback,
    peak_notches,
    position_filter,
    robust_filters,
    structures,
)
from flexstage.control.loop_plant import (
    LoopPlant,
    Margins,
    is_stable,
    margins_of,
    negative_crossings,
    worst_of,
)
from flexstage.control.response_set import (
    Member,
    force_zero,
    require_band,
    response_set,
    strongest_mode,
    surrogate,
    unit_of,
)
from flexstage.files.encoder import Encoder
from flexstage.files.plain import plain
from flexstage.files.result import Result
from flexstage.measure.requests import TuneRequest
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.system.environment import LOOP_FILE, PositionLoop
from flexstage.system.servo import (
    ForceFeedback,
    InnerLoop,
    Lead,
    PositionFeedback,
    ServoSettings,
    parallel_gains,
    pi_parameters,
)


@dataclass(frozen=True, slots=True)
class _Grid:
    """Candidates of controllers."""

    corners: int = 16
    """Number of corners of a lead and of a second integral, from the lowest line up."""
    highest: float = 0.3
    """Highest of them, over the rate."""
    integral: tuple[float, ...] = (4.0, 10.0)
    """Centre of a lead over the corner of the integral."""
    static: tuple[float, ...] = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
    """Static gain of a position feedback."""
    force: tuple[float, ...] = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0)
    """Gain of a force feedback, over that of the largest damping without delay."""
    least: float = 0.1
    """End of the search of a gain around an inner loop, over its first one."""


_GRID = _Grid()
#: Ratio of one gain to the last where a search reduces them.
GAIN_STEP = 0.93


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopMargins(Margins):
    """Margins of a loop with a measured response; the gain margin holds in both directions."""

    delay_margin: float
    """Additional delay at which the loop becomes unstable [s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResponseDesign(Result):
    """Position control with margins for every member of a set of measured responses."""

    table_key: ClassVar[str] = "members"

    loop: PositionLoop
    """The control, by the name of its structure; its delay is that which the response does not
    contain.
    """
    members: Sequence[Member]
    """The set."""
    margins: Sequence[LoopMargins]
    """Margins of each member."""
    unit: str
    """Unit of the response, empty if unknown."""
    notes: tuple[str, ...]
    """Origin of the set, and limits."""

    @property
    def nominal(self) -> LoopMargins:
        """Worst margins of the measurements themselves."""
        pairs = zip(self.members, self.margins, strict=True)
        return worst_of(margins for member, margins in pairs if member.measured)

    @property
    def worst(self) -> LoopMargins:
        """The worst of each margin over the set; bandwidth and crossover are the lowest."""
        return worst_of(self.margins)

    def loop_gain(self, member: Member) -> Complex:
        """Return the response of the open loop of a member."""
        return _gains(self.loop, member)[0]

    def with_gain(self, factor: float) -> "ResponseDesign":
        """Return the design with the gain of its control raised by a factor, and its margins."""
        loop = _with_gain(self.loop, factor)
        return replace(self, loop=loop, margins=[_margins(m, loop) for m in self.members])

    def loop_file(self) -> str:
        """Return the control as a YAML file of a loop, as ``budget --loop`` reads it.

        Its delay is that of the request, as a budget adds the hold to the default of one sample.
        """
        request = self.request
        delay = request.delay if isinstance(request, TuneRequest) else self.loop.delay
        return Encoder(LOOP_FILE).text(replace(self.loop, delay=delay))

    def data(self) -> dict[str, Any]:
        loop, rate, inner = self.loop, self.loop.sample_rate, self.loop.damping
        pairs = zip(self.members, self.margins, strict=True)
        return {
            "kind": "tuning",
            "structure": loop.name,
            "unit": self.unit,
            "settings": plain(loop.settings),
            "damping": inner and {"kind": inner.kind} | plain(inner),
            # neither PID nor controllers have an inner loop
            "pid": None if inner else parallel_gains(loop.settings),
            "pi_parameters": None if inner or self.unit != "m/V" else pi_parameters(loop.settings),
            "sample_rate_hz": rate,
            "delay": loop.latency,
            "sections": loop.settings.sections(rate).tolist(),
            "transfer_function": dict(
                zip(
                    ("numerator", "denominator"),
                    loop.settings.transfer_function(rate),
                    strict=True,
                )
            ),
            "nominal": plain(self.nominal),
            "worst": plain(self.worst),
            "members": [
                {"name": m.name, "measured": m.measured} | plain(margins) for m, margins in pairs
            ],
            "notes": list(self.notes),
        }


def tune_response(responses: Sequence[MeasuredResponse], request: TuneRequest) -> ResponseDesign:
    r"""Return the best control that keeps the requirements with every member of the set.

    Parameters
    ----------
    responses : sequence of MeasuredResponse
        Repeated measurements of one response, reading over voltage, shape (k, 1, 1), or with
        `repeated` in the request (k, n, 1) for n of them.
    request : TuneRequest
        Structure, requirements, uncertainty, rate and delay.

    Returns
    -------
    ResponseDesign
        The control, and the margins of each member.

    Validity
    --------
    The stage is stable and in the measured state. Stability is by the count of Nyquist on the
    measured lines: below the first the response is constant, above the last the loop stays small. A
    hysteresis makes the response depend on its amplitude: measure with a small and a large one.

    Raises
    ------
    ModelError
        The lines are too coarse, do not begin low or end high enough, or no control keeps the
        requirements.

    Notes
    -----
    A gain k of the loop L is excluded by :math:`|1 + kL| < 1/M_s` between the roots of a quadratic
    at each line, by phase and delay where :math:`|kL| = 1`, and by the gain margin about each
    crossing of the negative axis. Each gap between these is stable or not as a whole: the highest
    stable one is used (compare `tune_plant`). An error of variance v, real and imaginary part
    together, is within :math:`\sqrt{-v \ln(1 - p)}` with probability p at each line.
    """
    measured, members, notes = response_set(responses, request)
    units = sorted({unit for unit in map(unit_of, responses) if unit})
    if len(units) > 1:
        raise ModelError(
            f"the responses have the units {', '.join(units)}: tune on repetitions of one response"
        )
    nominal = measured[0]
    for member in measured:
        require_band(member, request)
    plant = surrogate(nominal, request)
    best: tuple[float, PositionLoop] | None = None
    coarse = ""
    tables = _tables(members)
    for kind, unit, inner in _candidates(plant, request, nominal):
        loop = PositionLoop(
            name=kind,
            settings=unit,
            sample_rate=request.servo_rate,
            delay=request.latency,
            damping=inner,
        )
        largest = _largest_gain(tables, loop, request) if inner is None else (
            _largest_outer_gain(members, loop, request)
        )  # fmt: skip
        if not largest > 0.0:
            continue
        loop = _with_gain(loop, largest)
        faults = [_coarse(response, loop, request) for response in measured]
        coarse = coarse or max(faults)
        if any(faults):
            continue
        score = max(_left(loop, m, request.goal) for m in members if m.measured)
        if best is None or score < best[0]:
            best = score, loop
    if best is None:
        raise ModelError(
            coarse
            or "no gain keeps the margins for every member of the set: reduce the requirements or "
            "the uncertainty, or choose another structure (--control)"
        )
    _, loop = best
    margins = [_margins(member, loop) for member in members]
    design = ResponseDesign(
        request=request,
        loop=loop,
        members=members,
        margins=margins,
        unit=units[0] if units else "",
        notes=(*notes, *_notes(loop, members, request)),
    )
    if loop.settings.integral and not design.worst.bandwidth_hz > 0.0:
        raise ModelError(
            f"the response begins at {nominal.frequency_hz[0]:.4g} Hz, where the best loop no "
            "longer halves errors: measure from a tenth of that frequency"
        )
    return design


def _coarse(member: Member, loop: PositionLoop, request: TuneRequest) -> str:
    """Return where a mode may hide between two lines that the loop would notice; empty if not."""
    f, h = member.frequency_hz, member.response
    step = np.abs(np.angle(h[1:] / h[:-1]))
    # the circle through both lines and zero, on which one mode moves
    diameter = np.abs(h[1:] - h[:-1]) / np.maximum(np.sin(step), 1e-12)
    size = np.abs(loop.feedback(0.5 * (f[1:] + f[:-1]))[0])
    hidden = (step > request.phase_step) & (size * diameter > 1.0 - 1.0 / request.modulus)
    if not hidden.any():
        return ""
    k = int(np.argmax(hidden * step))
    spacing = (f[k + 1] - f[k]) * math.tan(0.5 * request.phase_step) / math.tan(0.5 * step[k])
    return (
        f"the phase changes by {math.degrees(step[k]):.0f} deg between {f[k]:.5g} and "
        f"{f[k + 1]:.5g} Hz, so that a resonance there may be higher than both lines: measure "
        f"with lines {spacing:.2g} Hz apart, or leave out lines of noise"
    )


def _controller(loop: PositionLoop, f: Array) -> Complex:
    """Return the response of a control with the delay of its loop."""
    return loop.settings.response(f, loop.sample_rate) * _late(loop, f)


def _late(loop: PositionLoop, f: Array) -> Complex:
    return np.exp(-2j * np.pi * f * loop.latency)


def _gains(loop: PositionLoop, member: Member) -> tuple[Complex, Complex | float]:
    """Return the response of the open loop of a member, and the part of it by the force."""
    f = member.frequency_hz
    reading, force = loop.feedback(f)
    late = _late(loop, f)
    inner = 0.0 if force is None or member.force is None else force * late * member.force
    return reading * late * member.response + inner, inner


def _with_gain(loop: PositionLoop, gain: float) -> PositionLoop:
    """Return a loop with the gain of its position control raised by a factor."""
    return replace(loop, settings=loop.settings.scaled(gain))


def _tables(members: Sequence[Member]) -> list[tuple[Array, Complex]]:
    """Return frequencies, shape (k,), and the responses of all members there, shape (n, k)."""
    tables: dict[bytes, tuple[Array, list[Complex]]] = {}
    for member in members:
        f = member.frequency_hz
        tables.setdefault(f.tobytes(), (f, []))[1].append(member.response)
    return [(f, np.stack(responses)) for f, responses in tables.values()]


def _largest_gain(
    tables: Sequence[tuple[Array, Complex]], unit: PositionLoop, request: TuneRequest
) -> float:
    """Return the largest gain of a control that no response excludes, 0 for none."""
    lag = unit.lag
    loops = [(f, _controller(unit, f) * responses) for f, responses in tables]
    low, high = np.concatenate([_excluded(*one, request) for one in loops], axis=1)
    order = np.argsort(low)
    low, high = low[order], np.maximum.accumulate(high[order])
    # each gap ends where a range begins above all earlier ones
    begins = np.flatnonzero(np.append(True, low[1:] > high[:-1]))
    for k in begins[::-1].tolist():
        gain = float(low[k]) * (1.0 - 1e-9)
        if all(is_stable(gain * loop, lag) for _, rows in loops for loop in rows):
            return gain
    return 0.0


def _largest_outer_gain(
    members: Sequence[Member], unit: PositionLoop, request: TuneRequest
) -> float:
    """Return a gain around an inner loop that keeps the requirements with all members, or 0.

    The search goes down from the first gain that the sensitivity excludes.
    """
    bound = math.inf
    parts = []
    for member in members:
        # the loop is linear in the gain
        (at_one, inner), (at_two, _) = (_gains(_with_gain(unit, k), member) for k in (1.0, 2.0))
        outer = at_two - at_one
        rest = 1.0 + at_one - outer
        left = np.abs(rest) ** 2 - (np.maximum(1.0, np.abs(1.0 + inner)) / request.modulus) ** 2
        if left.min() <= 0.0:
            return 0.0
        half, power = (outer.conj() * rest).real, np.abs(outer) ** 2
        meets = (half**2 >= power * left) & (half < 0.0)
        if meets.any():
            roots = -half[meets] - np.sqrt(half[meets] ** 2 - power[meets] * left[meets])
            bound = min(bound, float((roots / power[meets]).min()))
        parts.append((member.frequency_hz, rest - 1.0, outer, inner))
    if not math.isfinite(bound):
        return 0.0  # what no sensitivity limits has no largest gain
    gain = GAIN_STEP * bound
    while gain > _GRID.least * bound:
        for k, (f, inner_loop, outer, inner) in enumerate(parts):
            if not _holds(f, inner_loop + gain * outer, inner, unit.lag, request):
                # the member that refuses one gain is asked first about the next
                parts.insert(0, parts.pop(k))
                break
        else:
            return gain
        gain *= GAIN_STEP
    return 0.0


def _holds(
    f: Array, loop: Complex, inner: Complex | float, lag: float, request: TuneRequest
) -> bool:
    """Return whether an open loop keeps the requirements."""
    if abs(loop[-1]) * request.gain_margin > 1.0:
        return False
    margins = _margins_of(f, loop, lag, inner)
    return (
        margins.stable
        and margins.gain_margin >= request.gain_margin
        and margins.phase_margin >= request.phase_margin
        and margins.delay_margin >= request.delay_margin
        and margins.sensitivity_peak <= request.modulus
    )


def _excluded(f: Array, loops: Complex, request: TuneRequest) -> Array:
    """Return the ranges of gains that a requirement excludes, shape (2, m)."""
    size, re, im = np.abs(loops), loops.real, loops.imag
    inside = re**2 - size**2 * (1.0 - request.modulus**-2)
    near = (inside >= 0.0) & (re < 0.0)
    root, middle = np.sqrt(inside[near]), -re[near]
    power = size[near] ** 2
    away = np.angle(-loops)
    late = np.mod(away, 2.0 * np.pi) < 2.0 * np.pi * f * request.delay_margin
    row, at = np.nonzero((np.abs(away) < request.phase_margin) | late)
    # with both neighbours: the edge of the region lies between two lines
    around = [size[row, np.clip(at + n, 0, f.size - 1)] for n in (-1, 0, 1)]
    turns = (im[:, :-1] * im[:, 1:] < 0.0) & (np.minimum(re[:, :-1], re[:, 1:]) < 0.0)
    share = im[:, :-1][turns] / (im[:, :-1] - im[:, 1:])[turns]
    crossing = -re[:, :-1][turns] - share * (re[:, 1:] - re[:, :-1])[turns]
    crossed = 1.0 / crossing[crossing > 0.0]
    with np.errstate(divide="ignore"):
        ends = 1.0 / (request.gain_margin * size[:, -1])
        unity = 1.0 / np.array(around)
    return np.array(
        [
            np.concatenate(
                ((middle - root) / power, unity.min(axis=0), crossed / request.gain_margin, ends)
            ),
            np.concatenate(
                (
                    (middle + root) / power,
                    unity.max(axis=0),
                    crossed * request.gain_margin,
                    np.full(ends.size, np.inf),
                )
            ),
        ]
    )


def _left(loop: PositionLoop, member: Member, goal: str) -> float:
    """Return what a loop leaves of steps or noise of the drive, or the inverse of its bandwidth."""
    f, response = member.frequency_hz, member.response
    gain, inner = _gains(loop, member)
    if goal == "bandwidth":
        return 1.0 / max(margins_of(f, gain, inner=inner).bandwidth_hz, 1e-300)
    omega = 2.0 * np.pi * f
    left = np.abs(response / (1.0 + gain)) ** 2
    if goal == "noise":
        return float(np.trapezoid(left, omega))
    left /= omega**2
    return float(np.trapezoid(left, omega)) + float(left[0] * omega[0])


def _margins(member: Member, loop: PositionLoop) -> LoopMargins:
    gain, inner = _gains(loop, member)
    return _margins_of(member.frequency_hz, gain, loop.lag, inner)


def _margins_of(f: Array, gain: Complex, lag: float, inner: Complex | float) -> LoopMargins:
    margins = margins_of(f, gain, lag, inner)
    size = np.abs(gain)
    k = np.flatnonzero((size[:-1] - 1.0) * (size[1:] - 1.0) <= 0.0)
    delays = np.mod(np.angle(-gain[k]), 2.0 * np.pi) / (2.0 * np.pi * f[k])
    factors = [max(at, 1.0 / at) for at in negative_crossings(gain)]
    return LoopMargins(
        stable=margins.stable,
        gain_margin=min(factors, default=math.inf),
        phase_margin=margins.phase_margin,
        sensitivity_peak=margins.sensitivity_peak,
        crossover_hz=margins.crossover_hz,
        bandwidth_hz=margins.bandwidth_hz,
        delay_margin=float(delays.min()) if k.size else math.inf,
    )


def _candidates(
    plant: LoopPlant, request: TuneRequest, nominal: Member
) -> Iterator[tuple[str, ServoSettings, InnerLoop | None]]:
    """Yield controls of unit gain with the names of their structures."""
    if request.control in ("ppf", "iff"):
        yield from _damped(plant, request, nominal)
        return
    if request.control == "h-infinity":
        for unit in _robust(plant, request, nominal):
            yield request.control, unit, None
        return
    for name, unit in _undamped(plant, request, nominal):
        yield name, unit, None


def _damped(
    plant: LoopPlant, request: TuneRequest, nominal: Member
) -> Iterator[tuple[str, ServoSettings, InnerLoop]]:
    """Yield integral and pi around inner loops of rising gain."""
    mode, _, share = strongest_mode(plant)
    inner: list[InnerLoop] = []
    if request.control == "ppf":
        for static in _GRID.static:
            with suppress(ModelError):  # the delay leaves no phase to the smallest
                inner.append(position_filter(mode, static, abs(share) * plant.gain, plant.delay))
        # refused with its message where it leaves none to any
        inner = inner or [position_filter(mode, _GRID.static[-1], plant.gain, plant.delay)]
    else:
        largest, _ = force_feedback(mode, *force_zero(nominal, mode))
        inner += [replace(largest, gain=factor * largest.gain) for factor in _GRID.force]
    bare = replace(plant, modes=None)
    outer = [*structures(bare, "integral", None), *structures(bare, "pi", None)]
    for one, unit in itertools.product(inner, list(dict.fromkeys(outer))[::2]):
        yield request.control, unit, one


def _robust(plant: LoopPlant, request: TuneRequest, nominal: Member) -> Iterator[ServoSettings]:
    """Yield integral and pi of rising crossover, with the filters that make them robust."""
    bare = replace(plant, modes=None)
    weights = [*structures(bare, "integral", None), *structures(bare, "pi", None)]
    crossovers = np.geomspace(
        nominal.frequency_hz[0], _GRID.highest * request.servo_rate, _GRID.corners
    )
    for crossover, unit in itertools.product(
        crossovers.tolist(), list(dict.fromkeys(weights))[::2]
    ):
        gain = 2.0 * math.pi * crossover / plant.gain
        weight = unit.scaled(gain)
        if filters := robust_filters(plant, weight):
            yield replace(unit, filters=filters)


def _undamped(
    plant: LoopPlant, request: TuneRequest, nominal: Member
) -> Iterator[tuple[str, ServoSettings]]:
    """Yield controls without an inner loop."""
    kind = request.control
    for name in ("integral", "pi", "damping"):
        if kind in ("auto", name) and not (name == "damping" and plant.modes is None):
            for unit in structures(plant, name, None):
                yield name, unit
    if kind not in ("auto", "pid", "lead", "double-integral"):
        return
    corners = np.geomspace(
        nominal.frequency_hz[0], _GRID.highest * request.servo_rate, _GRID.corners
    ).tolist()
    for width in WIDTHS:
        notches = peak_notches(plant, width)
        if kind in ("auto", "double-integral"):
            for unit in structures(plant, "pi", None):
                for corner in corners if unit.notches == notches else ():
                    yield "double-integral", replace(unit, second_integral_hz=corner)
        spread = math.sqrt(request.derivative_ratio)
        for centre in corners:
            if centre * spread >= 0.5 * request.servo_rate or kind == "double-integral":
                continue
            lead = Lead(zero_hz=centre / spread, pole_hz=centre * spread)
            if kind == "lead":
                yield "lead", ServoSettings(proportional=1.0, leads=(lead,), notches=notches)
                continue
            for below in _GRID.integral:
                proportional = 0.5 * below / (math.pi * centre)
                yield (
                    "pid",
                    ServoSettings(
                        integral=1.0, proportional=proportional, leads=(lead,), notches=notches
                    ),
                )
        if not notches:
            return


def coprime_margin(loop: PositionLoop, member: Member) -> float:
    r"""Return the largest error of normalised coprime factors that a loop with filters allows.

    .. math:: \epsilon = \min_f \frac{|1 + G K|}{\sqrt{(1 + |G|^2)(1 + |K|^2)}}

    of stage and weight, G, and the filters K.
    """
    weight = replace(loop, settings=replace(loop.settings, filters=()))
    f = member.frequency_hz
    shaped = _controller(weight, f) * member.response
    opened = _controller(loop, f) * member.response
    sizes = np.abs(shaped) ** 2, np.abs(opened / shaped) ** 2
    return float((np.abs(1.0 + opened) / np.sqrt((1.0 + sizes[0]) * (1.0 + sizes[1]))).min())


def _notes(loop: PositionLoop, members: Sequence[Member], request: TuneRequest) -> tuple[str, ...]:
    low = max(m.frequency_hz[0] for m in members)
    high = min(m.frequency_hz[-1] for m in members)
    notes = [
        f"stability by the count of Nyquist from {low:.4g} to {high:.4g} Hz: the stage is assumed "
        "to be stable without feedback, constant below and small above",
        f"delay of {1e6 * loop.latency:.4g} us in addition to that in the response, "
        + (
            "which has the hold"
            if not request.frf
            else "which a record by the controller itself "
            'has already (--delay "0 s"); budget --loop knows no other'
        ),
    ]
    first = next(member for member in members if member.measured)
    size = np.abs(first.response)
    closed = np.abs(first.response / (1.0 + _gains(loop, first)[0]))
    peaks = f"the peak to its voltage falls from {size.max() / size[0]:.3g} to "
    peaks += f"{closed.max() / size[0]:.3g} times the static response"
    if isinstance(loop.damping, PositionFeedback):
        static = loop.damping.gain * float(size[0])
        notes.append(
            f"ppf: {peaks}; static gain {static:.2g} of the limit 1, where the stage would become "
            "unstable; modes above the last line may be excited (spillover)"
        )
    elif loop.settings.filters:
        notes.append(
            f"h-infinity: {peaks}; largest error of the normalised coprime factors "
            f"{coprime_margin(loop, first):.2g}, filters for a model of its {request.notches} "
            "highest peaks at most"
        )
    elif isinstance(loop.damping, ForceFeedback):
        mode = float(first.frequency_hz[int(np.argmax(size))])
        zero, static = force_zero(first, mode)
        largest, ratio = force_feedback(mode, zero, static)
        notes.append(
            f"iff: {peaks}; zero of the force at {zero:.4g} Hz below the mode at {mode:.4g} Hz: "
            f"damping ratio up to {min(ratio, 1.0):.2g} without delay, at a gain of "
            f"{largest.gain:.3g} V/(N s); needs a sensor in line with the stack that reads slow "
            "forces, and makes the stage softer to forces below its bandwidth"
        )
    return tuple(notes)
