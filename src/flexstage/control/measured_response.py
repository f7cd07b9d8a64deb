r"""Position control from a measured frequency response, with margins for a set of responses.

The set has every repeated measurement :math:`P(f)`, those with all frequencies shifted, and those
that differ by the radius r(f) of their uncertainty in eight directions,
:math:`P + r\,e^{j(\arg P + n\pi/4)}`. No model is fitted. Between two measured lines 1/P is a
straight line where the phase falls, which is close to one mode, else P is, which is close to a
zero.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from flexstage.base.arrays import Array, Complex
from flexstage.base.errors import ModelError
from flexstage.control.design import WIDTHS, Requirements, peak_notches, structures
from flexstage.control.loop_plant import (
    LoopPlant,
    Margins,
    is_stable,
    margins_of,
    negative_crossings,
)
from flexstage.files.encoder import Encoder
from flexstage.files.plain import plain
from flexstage.files.result import Result
from flexstage.hysteresis import StageModes
from flexstage.measure.frf import FrfResult, frf_of_files
from flexstage.measure.requests import FrfRequest, TuneRequest
from flexstage.measure.spectra.response import MeasuredResponse
from flexstage.records.read_options import ReadOptions
from flexstage.system.environment import LOOP_FILE, PositionLoop
from flexstage.system.servo import Lead, ServoSettings


@dataclass(frozen=True, slots=True)
class _Grid:
    """Interpolation of responses, and candidates of controllers."""

    turn: float = math.radians(3.0)
    """Largest turn of the response between two lines after interpolation."""
    ratio: float = 0.02
    """Largest logarithm of the ratio of two frequencies."""
    directions: int = 8
    """Directions of the uncertainty in the complex plane."""
    shifts: int = 5
    """Shifts of the frequencies over their range."""
    corners: int = 16
    """Number of corners of a lead and of a second integral, from the lowest line up."""
    highest: float = 0.3
    """Highest of them, over the rate."""
    integral: tuple[float, ...] = (4.0, 10.0)
    """Centre of a lead over the corner of the integral."""


_GRID = _Grid()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Member:
    """One response of a set, dense in frequency, without the delay of the loop."""

    name: str
    """Name."""
    frequency_hz: Array
    """Frequencies, rising [Hz]."""
    response: Complex
    """Reading over voltage."""
    measured: bool = True
    """True for a measurement, False for one with an error added."""


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
        return _worst(margins for member, margins in pairs if member.measured)

    @property
    def worst(self) -> LoopMargins:
        """The worst of each margin over the set; bandwidth and crossover are the lowest."""
        return _worst(self.margins)

    def loop_gain(self, member: Member) -> Complex:
        """Return the response of the open loop of a member."""
        return _controller(self.loop, member.frequency_hz) * member.response

    def loop_file(self) -> str:
        """Return the control as a YAML file of a loop, as ``budget --loop`` reads it.

        Its delay is that of the request, as a budget adds the hold to the default of one sample.
        """
        request = self.request
        delay = request.delay if isinstance(request, TuneRequest) else self.loop.delay
        return Encoder(LOOP_FILE).text(replace(self.loop, delay=delay))

    def data(self) -> dict[str, Any]:
        loop, rate = self.loop, self.loop.sample_rate
        pairs = zip(self.members, self.margins, strict=True)
        return {
            "kind": "tuning",
            "structure": loop.name,
            "unit": self.unit,
            "settings": plain(loop.settings),
            "pid": _parallel(loop.settings),
            "pi_parameters": _pi_parameters(loop.settings) if self.unit == "m/V" else None,
            "sample_rate_hz": rate,
            "delay": loop.latency,
            "sections": loop.settings.sections(rate).tolist(),
            "nominal": plain(self.nominal),
            "worst": plain(self.worst),
            "members": [
                {"name": m.name, "measured": m.measured} | plain(margins) for m, margins in pairs
            ],
            "notes": list(self.notes),
        }


def _parallel(settings: ServoSettings) -> dict[str, float] | None:
    """Return the parallel gains of a PID without notches and low-pass, or None."""
    if settings.second_integral_hz is not None or len(settings.leads) > 1:
        return None
    p, i = settings.proportional, settings.integral
    zero, pole = 0.0, 0.0
    for lead in settings.leads:
        zero, pole = (0.5 / (math.pi * f) for f in (lead.zero_hz, lead.pole_hz))
    proportional = p + i * (zero - pole)
    return {
        "proportional": proportional,
        "integral": i,
        "derivative": p * zero - proportional * pole,
        "derivative_time_constant": pole,
    }


def _pi_parameters(settings: ServoSettings) -> dict[str, float] | None:
    """Return the parameters of a controller by Physik Instrumente, units as of its axis in um.

    None for a control with a filter that its parameters do not have.
    """
    if settings.leads or settings.lowpass_hz or settings.second_integral_hz:
        return None
    numbers = {
        "0x07000300": 1e-6 * settings.proportional,
        "0x07000301": 1e-6 * settings.integral,
    }
    for slot, notch in enumerate(settings.notches):
        numbers |= {
            f"0x0800010{slot}": notch.frequency_hz,
            f"0x0800020{slot}": notch.zero_damping / notch.pole_damping,
            f"0x0800030{slot}": 2.0 * notch.pole_damping,
        }
    return numbers


def tune_files(request: TuneRequest, how: ReadOptions = ReadOptions()) -> ResponseDesign:
    """Return the control for measured files, as the command ``tune`` does."""
    reading = FrfRequest(
        input=request.input,
        output=request.output,
        response=request.response,
        resolution=request.resolution,
        fit_modes=0,
    )
    responses = []
    for path, one in zip(request.frf, how.of_each(len(request.frf)), strict=True):
        result = frf_of_files([Path(path)], reading, one)
        assert isinstance(result, FrfResult)
        responses.append(replace(result.response, source=Path(path).name))
    return tune_response(responses, request)


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
    measured, members, notes = _response_set(responses, request)
    units = sorted({unit for unit in map(_unit, responses) if unit})
    if len(units) > 1:
        raise ModelError(
            f"the responses have the units {', '.join(units)}: tune on repetitions of one response"
        )
    nominal = measured[0]
    for member in measured:
        _require_band(member, request)
    plant = _surrogate(nominal, request)
    best: tuple[float, PositionLoop] | None = None
    coarse = ""
    tables = _tables(members)
    for kind, unit in _candidates(plant, request, nominal):
        loop = PositionLoop(
            name=kind, settings=unit, sample_rate=request.servo_rate, delay=request.latency
        )
        gain = _largest_gain(tables, loop, request)
        if not gain > 0.0:
            continue
        settings = replace(
            unit, integral=gain * unit.integral, proportional=gain * unit.proportional
        )
        loop = replace(loop, settings=settings)
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


def _unit(response: MeasuredResponse) -> str:
    """Return the unit of a response, empty if unknown."""
    above, below = response.output_units, response.input_units
    return f"{above[0]}/{below[0]}" if above and below and above[0] and below[0] else ""


def _response_set(
    responses: Sequence[MeasuredResponse], request: TuneRequest
) -> tuple[list[Member], list[Member], tuple[str, ...]]:
    """Return the measurements on their lines, the set on dense lines, and its origin."""
    columns: list[tuple[str, MeasuredResponse, int]] = []
    for response in responses:
        outputs = len(response.outputs)
        if len(response.inputs) > 1 or (outputs > 1 and not request.repeated):
            names = ", ".join(itertools.starmap("{}/{}".format, itertools.product(
                response.outputs, response.inputs)))  # fmt: skip
            raise ModelError(
                f"'{response.source}' has several responses ({names}): choose one by --response, "
                "--input and --output, or say --repeated if they repeat one measurement"
            )
        for o in range(outputs):
            columns.append((f"{response.source} {response.outputs[o]}".strip(), response, o))
    single = len(columns) == 1
    shift = (
        request.shift
        if request.shift is not None
        else (Requirements().frequency_scatter if single else 0.0)
    )
    shifts = np.linspace(-shift, shift, _GRID.shifts if shift else 1)
    measured, members, origins = [], [], []
    for name, response, o in columns:
        highest = 0.5 * request.servo_rate
        inside = (response.frequency_hz > 0.0) & (response.frequency_hz <= highest)
        inside &= response.response[:, o, 0] != 0.0
        if inside.sum() < 2:
            raise ModelError(
                f"the response '{name}' has fewer than two lines below half the rate of the loop, "
                f"{request.servo_rate:g} Hz: raise --servo-rate"
            )
        one = response.lines(inside)
        f, h = one.frequency_hz, one.response[:, o, 0]
        radius, origin = _radius(one, o, request, single)
        origins.append(origin)
        measured.append(Member(name=name, frequency_hz=f, response=h))
        factors = [(0j, "")]
        if radius.any():
            angles = np.arange(_GRID.directions) * 2.0 * np.pi / _GRID.directions
            factors += [(np.exp(1j * a), f", error at {math.degrees(a):.0f} deg") for a in angles]
        dense, values, relative = _dense(f, h, radius / np.abs(h))
        for s, (factor, error) in itertools.product(shifts.tolist(), factors):
            shifted = f", frequencies {100.0 * s:+.2g} %" if s else ""
            below = (1.0 + s) * dense <= highest
            members.append(
                Member(
                    name=name + shifted + error,
                    frequency_hz=(1.0 + s) * dense[below],
                    response=(values * (1.0 + relative * factor))[below],
                    measured=not (error or shifted),
                )
            )
    count = "one measurement" if single else f"{len(columns)} measurements"
    notes = [f"set of {len(members)} responses: {count}; {'; '.join(dict.fromkeys(origins))}"]
    if shift:
        notes.append(f"all frequencies may be {100.0 * shift:.3g} % off (--shift)")
    return measured, members, tuple(notes)


def _radius(
    response: MeasuredResponse, o: int, request: TuneRequest, single: bool
) -> tuple[Array, str]:
    """Return the radius of the uncertainty at each line, and its origin in words."""
    size = np.abs(response.response[:, o, 0])
    if request.uncertainty is not None:
        share = request.uncertainty
        return share * size, f"relative uncertainty of {100.0 * share:.3g} % by --uncertainty"
    wide = math.sqrt(-math.log(1.0 - request.coverage))
    covered = f"{100.0 * request.coverage:.4g} % coverage at each line"
    if response.variance is not None:
        return wide * np.sqrt(response.variance[:, o, 0]), f"error by its variance, {covered}"
    if response.coherence is not None:
        averages = response.averages or request.averages
        coherence = np.clip(response.coherence[:, o], 1e-9, 1.0)
        variance = size**2 * (1.0 - coherence) / (coherence * averages)
        return (
            wide * np.sqrt(variance),
            f"error by coherence, averages: {averages:g}, {covered}",
        )
    if not single:
        return np.zeros_like(size), "scatter of the repetitions alone"
    share = Requirements().gain_scatter
    origin = f"relative uncertainty of {100.0 * share:.3g} %, as the file has none (--uncertainty)"
    return share * size, origin


def _dense(f: Array, h: Complex, relative: Array) -> tuple[Array, Complex, Array]:
    """Return a response and its relative error at lines close enough for straight lines."""
    turn = np.angle(h[1:] / h[:-1])
    parts = np.maximum(np.abs(turn) / _GRID.turn, np.log(f[1:] / f[:-1]) / _GRID.ratio)
    count = np.ceil(parts).astype(int).clip(1)
    at = np.repeat(np.arange(count.size), count)
    share = np.concatenate([np.arange(n) / n for n in count.tolist()])
    falls = turn[at] < 0.0
    straight = h[at] + share * (h[at + 1] - h[at])
    inverse = 1.0 / (1.0 / h[at] + share * (1.0 / h[at + 1] - 1.0 / h[at]))
    dense = f[at] + share * (f[at + 1] - f[at])
    values = np.append(np.where(falls, inverse, straight), h[-1])
    dense = np.append(dense, f[-1])
    return dense, values, np.interp(dense, f, relative)


def _require_band(member: Member, request: TuneRequest) -> None:
    """Refuse a response that does not begin below its resonances, or ends below one."""
    f, first = member.frequency_hz, member.response[0]
    phase = float(np.angle(first))
    if abs(phase) > math.pi - request.phase_step:
        raise ModelError(
            f"the reading falls as the voltage rises (phase {math.degrees(phase):.0f} deg at "
            f"{f[0]:.4g} Hz): reverse the sign of the response"
        )
    if abs(phase) > request.phase_step:
        raise ModelError(
            f"the phase at the lowest line, {f[0]:.4g} Hz, is {math.degrees(phase):.0f} deg: the "
            "response of a stage with a stiffness begins near 0, so measure from a lower frequency"
        )
    size, scatter = np.abs(member.response), 1.0 + Requirements().gain_scatter
    if size[-1] > scatter * size[0] and scatter * size[-1] > size.max():
        raise ModelError(
            f"the response is largest at its end, {size[-1] / size[0]:.3g} times that at "
            f"{f[0]:.4g} Hz, as below a resonance above {f[-1]:.4g} Hz: measure beyond it, with a "
            "--servo-rate of more than twice its frequency"
        )


def _coarse(member: Member, loop: PositionLoop, request: TuneRequest) -> str:
    """Return where a mode may hide between two lines that the loop would notice; empty if not."""
    f, h = member.frequency_hz, member.response
    step = np.abs(np.angle(h[1:] / h[:-1]))
    # the circle through both lines and zero, on which one mode moves
    diameter = np.abs(h[1:] - h[:-1]) / np.maximum(np.sin(step), 1e-12)
    size = np.abs(_controller(loop, 0.5 * (f[1:] + f[:-1])))
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
    return loop.settings.response(f, loop.sample_rate) * np.exp(-2j * np.pi * f * loop.latency)


def _integral_lag(settings: ServoSettings) -> float:
    """Return the phase lag of a control at zero frequency [rad]."""
    integrals = bool(settings.integral) + (settings.second_integral_hz is not None)
    return 0.5 * math.pi * integrals


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
    lag = _integral_lag(unit.settings)
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
    """Return what a loop leaves of small steps of the drive, or the inverse of its bandwidth."""
    f, response = member.frequency_hz, member.response
    gain = _controller(loop, f) * response
    if goal == "bandwidth":
        return 1.0 / max(margins_of(f, gain).bandwidth_hz, 1e-300)
    omega = 2.0 * np.pi * f
    left = np.abs(response / (1.0 + gain)) ** 2 / omega**2
    return float(np.trapezoid(left, omega)) + float(left[0] * omega[0])


def _margins(member: Member, loop: PositionLoop) -> LoopMargins:
    f = member.frequency_hz
    gain = _controller(loop, f) * member.response
    margins = margins_of(f, gain, _integral_lag(loop.settings))
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


def _worst(margins: Iterable[LoopMargins]) -> LoopMargins:
    every = list(margins)
    least = {
        name: min(getattr(m, name) for m in every)
        for name in ("gain_margin", "phase_margin", "crossover_hz", "bandwidth_hz", "delay_margin")
    }
    return LoopMargins(
        stable=all(m.stable for m in every),
        sensitivity_peak=max(m.sensitivity_peak for m in every),
        **least,
    )


def _surrogate(member: Member, request: TuneRequest) -> LoopPlant:
    """Return a plant with the peaks and delay of a response, for candidates of controls only."""
    f, h = member.frequency_hz, member.response
    size = np.abs(h)
    peaks = _peaks(f, size, request.notches)
    low = f <= (0.1 * peaks[0][0] if peaks else f[-1])
    low[0] = True
    delay = float(np.median(-np.angle(h[low]) / (2.0 * np.pi * f[low])))
    gain = float(size[0])
    modes = None
    if peaks:
        frequencies, damping, heights = zip(*sorted(peaks), strict=True)
        share = tuple(2.0 * z * h / gain for z, h in zip(damping, heights, strict=True))
        modes = StageModes(frequency_hz=frequencies, damping_ratio=damping, share=share)
    return LoopPlant(
        gain=gain,
        gain_range=(gain, gain),
        modes=modes,
        delay=max(delay, 0.0) + request.latency,
        sample_rate_hz=request.servo_rate,
    )


def _peaks(f: Array, size: Array, count: int) -> list[tuple[float, float, float]]:
    """Return frequency, damping ratio by half power, and height of the highest peaks.

    A peak has lines of half its power on both sides.
    """
    peaks = []
    for k in np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])) + 1:
        half = size[k] / math.sqrt(2.0)
        left, right = np.flatnonzero(size[:k] < half), np.flatnonzero(size[k:] < half)
        if not (left.size and right.size):
            continue
        a, b = int(left[-1]), k + int(right[0])
        if size[a:b].max() > size[k]:
            continue
        below = np.interp(half, size[a : a + 2], f[a : a + 2])
        above = np.interp(half, size[[b, b - 1]], f[[b, b - 1]])
        peaks.append((float(f[k]), float(0.5 * (above - below) / f[k]), float(size[k])))
    # highest in a loop with an integral
    return sorted(peaks, key=lambda peak: -peak[2] / peak[0])[:count]


def _candidates(
    plant: LoopPlant, request: TuneRequest, nominal: Member
) -> Iterator[tuple[str, ServoSettings]]:
    """Yield controls of unit gain with the names of their structures."""
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


def _notes(loop: PositionLoop, members: Sequence[Member], request: TuneRequest) -> tuple[str, ...]:
    low = max(m.frequency_hz[0] for m in members)
    high = min(m.frequency_hz[-1] for m in members)
    return (
        f"stability by the count of Nyquist from {low:.4g} to {high:.4g} Hz: the stage is assumed "
        "to be stable without feedback, constant below and small above",
        f"delay of {1e6 * loop.latency:.4g} us in addition to that in the response, which a record "
        'by the controller itself has already (--delay "0 s"); budget --loop knows no other',
    )
